"""Import report: what was imported, cut and refused, and imported walks compared with their source files."""

import json
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from runtime.controls import Gait
from runtime.safe_read import open_npz
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from training.data import gait
from training.data.clips import CLIP_TEXTS, TrainingClip
from training.data.labels import FOOT_JOINTS
from training.data.retarget import FPS
from training.data.shown import ClipSource, Refusal
from training.data.sources import BY_NAME, list_clips
from training.markdown import table

# of a written clip: `name` and texts, whether it is `mirrored`, its `seconds`, seconds of each gait, fraction of
# contacts, mean sliding of feet in contact, and number of ground `patches`
ClipSummary = dict[str, Any]


@dataclass
class Report:
    """Results of one import."""

    clips: list[ClipSummary] = field(default_factory=list)
    refused: list[Refusal] = field(default_factory=list)
    calibrations: dict[str, Any] = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Write the report as JSON."""
        path.write_text(json.dumps(asdict(self), indent=1), encoding="utf-8")

    def markdown(self) -> str:
        """Return the tables and the calibration of the feet."""
        turned = ("foot_turn_euler_yxz_degrees", "toe_offset_m")
        rows = [
            [key, *(str(c[k][0]) for k in turned), str(c["ankle_height_m"])]
            for key, c in sorted(self.calibrations.items())
        ]
        head = ("Skeleton", "foot turn YXZ, degrees", "toe offset, m", "ankle height, m")
        calibration = "\n".join(table(head, rows))
        title = "Calibration of the feet (left; the right mirrors it), measured where they stand flat:"
        return f"# Training data\n\n{self.text()}\n{title}\n\n{calibration}"

    def text(self) -> str:
        """Return the report as Markdown tables."""
        originals = [c for c in self.clips if not c["mirrored"]]
        total = sum(c["seconds"] for c in originals) / 60
        held_out = sum(c["seconds"] for c in originals if c["split"] == "held_out")
        lines = [
            f"{len(originals)} clips, {total:.1f} minutes, and as many mirrored"
            f" ({held_out / 60:.1f} minutes held out).",
            "",
        ]
        for title, key in (("Source", "source"), ("Style", "style")):
            groups: dict[str, list[ClipSummary]] = defaultdict(list)
            for clip in originals:
                groups[clip[key]].append(clip)
            lines += _table(title, groups)
        # reasons without numbers
        reasons = Counter((r.reason.split(":")[0].split(" left of ")[0], r.source) for r in self.refused)
        counted = [(reason, source, str(n)) for (reason, source), n in sorted(reasons.items())]
        return "\n".join([*lines, *table(("Not imported, or cut", "source", "items"), counted)])


def _table(title: str, groups: Mapping[str, list[ClipSummary]]) -> list[str]:
    gaits = [g.label for g in Gait]
    head = [title, "clips", "minutes", "held out", *gaits, "contact", "skating cm/frame"]
    return table(head, [_row(name, group) for name, group in sorted(groups.items())])


def _row(name: str, group: list[ClipSummary]) -> list[str]:
    seconds = np.array([c["seconds"] for c in group])
    minutes = [sum(c["seconds"] for c in group), sum(c["seconds"] for c in group if c["split"] == "held_out")]
    minutes += [sum(c["gait_seconds"][g.label] for c in group) for g in Gait]
    contact = np.average([c["contact_ratio"] for c in group], weights=seconds)
    skating = np.average([c["skating_cm_per_frame"] for c in group], weights=seconds)
    return [name, str(len(group)), *(f"{m / 60:.1f}" for m in minutes), f"{contact:.2f}", f"{skating:.3f}"]


def summarise(clip: TrainingClip) -> ClipSummary:
    """Summarise a clip for the report."""
    positions, _ = SPORT_SKELETON.forward_kinematics(clip.hips, clip.local)
    feet = positions[:, FOOT_JOINTS]
    travel = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1)
    standing = clip.contacts[1:].astype(bool) & clip.contacts[:-1].astype(bool)
    return {
        "name": clip.name,
        **{name: getattr(clip, name) for name in CLIP_TEXTS},
        "mirrored": clip.mirrored,
        "seconds": len(clip.hips) / FPS,
        "gait_seconds": {g.name.lower(): float(clip.gait[:, g].sum() / FPS) for g in Gait},
        "contact_ratio": float(clip.contacts.mean()),
        "skating_cm_per_frame": float(100.0 * travel[standing].mean()) if standing.any() else 0.0,
        "patches": len(clip.patches.heights),
    }


FILES = 4  # at most, per source and style, evenly spaced
_WALKS = ("walk forward", "mixed walk jog", "mixed locomotion")
COLUMNS = {
    "knee_min": "knee least", "knee_max": "knee most", "foot_up": "toes up", "lean": "lean", "elbow": "elbow",
    "bob_cm": "bob cm", "pelvis_yaw": "pelvis yaw", "pelvis_roll": "pelvis roll", "shoulder_yaw": "shoulder yaw",
    "arm_swing_cm": "arm swing cm", "clearance_cm": "foot lift cm", "speed": "m/s",
}  # fmt: skip

Measures = dict[str, float]


def compare(data: Path, clips: Path) -> dict[tuple[str, str], tuple[Measures, Measures]]:
    """Measure source files and imported clips of walks on a floor; returns medians by source and style."""
    result = {}
    for key, files in sorted(_walks(data, clips).items()):
        pairs = []
        for source, imported in files[:: max(1, -(-len(files) // FILES))]:
            raw = gait.measure_file(source.path, BY_NAME[source.source].first_frame)
            (made,) = gait.measured_exports([_clip(imported)], gait.measure_file)
            if raw is not None and made is not None:
                pairs.append((raw, made))
        if pairs:
            raw_files, imports = zip(*pairs, strict=True)
            result[key] = gait.median(raw_files), gait.median(imports)
    return result


def _walks(data: Path, clips: Path) -> dict[tuple[str, str], list[tuple[ClipSource, Path]]]:
    """Return files of walks on a floor with their imported clips, by source and style."""
    files: dict[tuple[str, str], list[tuple[ClipSource, Path]]] = defaultdict(list)
    for source in list_clips(data)[0]:
        candidates = (clips / f"{source.name}{part}.npz" for part in ("", "_0"))
        imported = next((path for path in candidates if path.exists()), None)
        if imported and source.terrain == "flat" and source.content.startswith(_WALKS):
            files[source.source, source.style].append((source, imported))
    return files


def _clip(path: Path) -> Clip:
    """Load an imported clip as the program would export it."""
    with open_npz(path, "Run the importer again.") as file:
        hips, local = file["hips_positions"], file["local_rotations"]
        return Clip(path.stem, 60.0, hips, local, file["contacts"].astype(np.float32))


def comparison(data: Path, clips: Path) -> str:
    """Return a table of medians over forward walks on a floor, raw > imported: degrees or as named, leg of 0.82 m."""
    rows = [
        [source, style, *(f"{raw[k]:.3g} > {own[k]:.3g}" if k in raw and k in own else "" for k in COLUMNS)]
        for (source, style), (raw, own) in compare(data, clips).items()
    ]
    lines = table(("source", "style", *COLUMNS.values()), rows)
    return "\n".join(["## Raw and imported", "", *lines])
