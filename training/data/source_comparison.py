"""Raw capture beside what the import made of it, written as BVH: what is lost shows here and nowhere else."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np

from runtime.formats.bvh_clip import save_bvh
from runtime.safe_read import open_npz
from runtime.takes.clip import Clip
from training.data import gait
from training.data.catalog import BY_NAME, list_clips

FILES = 4  # of each source and style at most, evenly spread
BEGIN, END = "<!-- raw:begin -->", "<!-- raw:end -->"
_WALKS = ("walk forward", "mixed walk jog", "mixed locomotion")
COLUMNS = {
    "knee_min": "knee least", "knee_max": "knee most", "foot_up": "toes up", "lean": "lean", "elbow": "elbow",
    "bob_cm": "bob cm", "pelvis_yaw": "pelvis yaw", "pelvis_roll": "pelvis roll", "shoulder_yaw": "shoulder yaw",
    "arm_swing_cm": "arm swing cm", "clearance_cm": "foot lift cm", "speed": "m/s",
}  # fmt: skip

Measures = dict[str, float]


def compare(data: Path, clips: Path) -> dict[tuple[str, str], tuple[Measures, Measures]]:
    """Median measures of source files and of the imported clips, by source and style, of walks on a floor."""
    files: dict[tuple[str, str], list[tuple[Path, Path, int]]] = defaultdict(list)
    for source in list_clips(data)[0]:
        imported = clips / f"{source.name}.npz"
        if not imported.exists():
            imported = clips / f"{source.name}_0.npz"
        if source.terrain == "flat" and imported.exists() and source.content.startswith(_WALKS):
            key = source.source, source.style
            files[key].append((source.path, imported, BY_NAME[source.source].first_frame))
    result = {}
    with tempfile.TemporaryDirectory() as folder:
        for key, paths in sorted(files.items()):
            pairs = []
            for raw, imported, first in paths[:: max(1, -(-len(paths) // FILES))]:
                both = gait.measure_file(raw, first), gait.measure_file(_exported(imported, Path(folder)))
                if both[0] is not None and both[1] is not None:
                    pairs.append((both[0], both[1]))
            if pairs:
                result[key] = _median([a for a, _ in pairs]), _median([b for _, b in pairs])
    return result


def _exported(path: Path, folder: Path) -> Path:
    """An imported clip as the BVH that the program would export."""
    with open_npz(path, "Run the importer again.") as file:
        hips, local = file["hips_positions"], file["local_rotations"]
        contacts = file["contacts"].astype(np.float32)
    target = folder / f"{path.stem}.bvh"
    save_bvh(Clip(path.stem, 60.0, hips, local, contacts), target)
    return target


def _median(items: list[Measures]) -> Measures:
    return {k: float(np.median([m[k] for m in items if k in m])) for k in COLUMNS if k in items[0]}


def markdown(rows: dict[tuple[str, str], tuple[Measures, Measures]]) -> str:
    """A table with a row for every source and style, raw > imported."""
    lines = [
        "| source | style | " + " | ".join(COLUMNS.values()) + " |",
        "| --- " * (2 + len(COLUMNS)) + "|",
    ]
    for (source, style), (raw, ours) in rows.items():
        cells = [f"{raw[k]:.3g} > {ours[k]:.3g}" if k in raw and k in ours else "" for k in COLUMNS]
        lines.append(f"| {source} | {style} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def section(data: Path, clips: Path) -> str:
    """The chapter of the data report, between its markers."""
    return f"{_TITLE}\n{BEGIN}\n{markdown(compare(data, clips))}\n{END}\n"


_TITLE = """## Raw beside imported

Medians over forward walks on a floor, measured by `training.data.gait` on the source files and on the imported clips
written as BVH (raw > imported; degrees, or as named, on a leg of 0.82 m). Angles of knees, trunk and elbows are the
source's. Arms keep their angles, so hands swing as far as our shorter arms let them. Feet stand still and have our
length: a heel over standing toes rises until the knee has the source's angle.
"""
