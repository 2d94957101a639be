"""Straight walks of every captured style at full stick beside the raw capture files: is the walk alive?

    python -m training.evaluation.motion.gait_table --data DIR [--model NAME=FOLDER ...] [--out docs/results/walks.md]

Each style walks by its prompt as `sport generate --gait walk --path forward` does, is written as BVH and measured by
`training.evaluation.metrics.gait`, and so are the source files of its forward walks. The table goes between the markers.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.assets import asset_path
from runtime.errors import UsageError, run_command
from training.evaluation.metrics import gait
from training.evaluation.report.markers import check_section, write_section

SECONDS = 12.0
RAW_FILES = 8  # of a style at most, evenly spread
SECTION = "straight walks"  # of a document, between its markers
WALK = "walk forward"
_CMU_FIRST_FRAME = 3

Measures = dict[str, float]


@dataclass(frozen=True)
class Row:
    """A measure: its title, the range in which a single style is right, and that of the median."""

    key: str
    title: str
    low: float
    high: float
    difference: bool = False  # ours - raw in degrees; else ours / raw
    median: tuple[float, float] | None = None


ROWS = (
    Row("knee_min", "knee at its straightest, degrees", -5.0, 5.0, True),
    Row("foot_up", "toes up at heel strike, degrees", -4.0, 4.0, True),
    Row("lean", "forward lean, degrees", -3.0, 3.0, True),
    Row("speed", "speed at full stick", 0.95, 1.05, median=(0.95, 1.05)),
    Row("cadence", "steps a minute", 0.95, 1.05, median=(0.95, 1.05)),
    Row("bob_cm", "pelvis bob", 0.75, 1.3, median=(0.9, 1.1)),
    Row("pelvis_yaw", "pelvis yaw", 0.75, 1.3, median=(0.9, 1.1)),
    Row("pelvis_roll", "pelvis roll", 0.75, 1.3, median=(0.9, 1.1)),
    Row("shoulder_yaw", "shoulder yaw", 0.75, 1.3, median=(0.9, 1.1)),
    Row("arm_swing_cm", "arm swing", 0.75, 1.3, median=(0.9, 1.1)),
    Row("knee_max", "knee at its most bent", 0.75, 1.3),
    Row("clearance_cm", "height of the ankle's lift", 0.75, 1.3),
    Row("elbow", "elbow, degrees", -10.0, 10.0, True),
)


def raw_walks(data: Path) -> dict[str, Measures]:
    """Measures of each style's forward walks in the source files, the median over its files."""
    from training.data.catalog import list_clips

    files: dict[str, list[Path]] = {}
    for clip in list_clips(data)[0]:
        if clip.content == WALK and clip.terrain == "flat":
            files.setdefault(clip.style, []).append(clip.path)
    result = {}
    for style, paths in sorted(files.items()):
        chosen = paths[:: max(1, -(-len(paths) // RAW_FILES))]
        first = _CMU_FIRST_FRAME if style.startswith("cmu") else 0
        measured = [m for m in (gait.measure_file(p, first) for p in chosen) if m is not None]
        if measured:
            result[style] = median_of(measured)
    return result


def median_of(measured: Iterable[Measures]) -> Measures:
    """Median of every measure."""
    items = list(measured)
    return {k: float(np.median([m[k] for m in items if k in m])) for k in items[0]}


def our_walks(model: Path | None, styles: Iterable[str], speed: float = 1.0) -> dict[str, Measures]:
    """The same of a model's character, which walks straight ahead by each style's prompt; `speed` of the stick."""
    from runtime.generate import clip_of, simulate
    from runtime.motion.controller import Controller
    from runtime.motion.model import load_model
    from runtime.motion.paths import control_script
    from runtime.prompts.english.library_data import load_styles
    from runtime.prompts.prompter import Prompter
    from runtime.takes.clip import save_bvh
    from runtime.terrain.height_map import Terrain

    loaded = load_model(model)
    to_style = Prompter(loaded)
    prompts = load_styles(asset_path("prompts/styles.json"))
    ground = Terrain.flat(size_m=400.0, cell_m=10.0)
    result = {}
    with tempfile.TemporaryDirectory() as folder:
        for style in styles:
            controller = Controller(loaded, ground, 0)
            script = control_script("forward", "walk", speed, 0)
            z = to_style(prompts[style].descriptions[0])
            poses = simulate(controller, script, [(0.0, z)], round(SECONDS * 60))
            path = Path(folder) / f"{style}.bvh"
            save_bvh(clip_of(poses, style, (), "flat"), path)
            measured = gait.measure_file(path)
            if measured is not None:
                result[style] = measured
    return result


def table(raw: dict[str, Measures], models: dict[str, dict[str, Measures]]) -> str:
    """The Markdown table: medians over the styles of ours over raw, and how many styles are within the bar."""
    names = list(models)
    head = f"| straight walks of {len(raw)} styles, ours beside the raw files | bar |"
    lines = [head + "".join(f" {n} |" for n in names), "| --- " * (2 + len(names)) + "|"]
    for row in ROWS:
        unit = f"{row.low:+g} to {row.high:+g}" if row.difference else f"{row.low:g} to {row.high:g}"
        cells = [cell(row, raw, models[n]) for n in names]
        lines.append(f"| {row.title} | {unit} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def cell(row: Row, raw: dict[str, Measures], ours: dict[str, Measures]) -> str:
    """Median over the styles, and how many of them are within the bar."""
    values = compared(row, raw, ours)
    if not len(values):
        return "no walk"
    inside = int(((values >= row.low) & (values <= row.high)).sum())
    middle = float(np.median(values))
    shown = f"{middle:+.1f}" if row.difference else f"{middle:.2f}"
    return f"{shown}; {inside} of {len(raw)}"


def compared(row: Row, raw: dict[str, Measures], ours: dict[str, Measures]) -> np.ndarray:
    """Difference or ratio of every style that both have."""
    pairs = [(ours[s][row.key], raw[s][row.key]) for s in raw if s in ours and row.key in raw[s]]
    return np.array([a - b if row.difference else a / b for a, b in pairs])


def by_style(raw: dict[str, Measures], ours: dict[str, Measures]) -> str:
    """A row for each style: raw > ours."""
    lines = ["| style | " + " | ".join(r.key for r in ROWS) + " |", "| --- " * (1 + len(ROWS)) + "|"]
    for style in raw:
        if style in ours:
            cells = [f"{raw[style].get(r.key, np.nan):.3g} > {ours[style][r.key]:.3g}" for r in ROWS]
            lines.append(f"| {style} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder with the unpacked archives")
    parser.add_argument(
        "--model", action="append", default=[], metavar="NAME=DIR", help="a model (default: the shipped one)"
    )
    parser.add_argument("--known", type=Path, help="JSON of an earlier run: raw walks and other models")
    parser.add_argument(
        "--speed", type=float, default=1.0, help="of the stick; ratios are to the raw walk at 1"
    )
    parser.add_argument("--json", type=Path, help="also write all measures to this file")
    parser.add_argument("--out", type=Path, help="document whose section between the markers is exchanged")
    args = parser.parse_args(argv)
    if args.out is not None:
        check_section(args.out, SECTION)
    models: dict[str, dict[str, Measures]] = {}
    if args.known is not None:
        known = json.loads(args.known.read_text("utf-8"))
        raw, models = known["raw"], known["models"]
    elif args.data is not None:
        raw = raw_walks(args.data)
    else:
        raise UsageError("gait_table: neither --data nor --known is given.", "Give one of them.")
    chosen: list[tuple[str, Path | None]] = [_named(text) for text in args.model]
    for name, folder in chosen or [("compact", None)]:
        models[name] = our_walks(folder, raw, args.speed)
    text = table(raw, models)
    if args.json is not None:
        args.json.write_text(json.dumps({"raw": raw, "models": models}, indent=1), encoding="utf-8")
    if args.out is not None:
        write_section(args.out, SECTION, text)
    print(f"{text}\n\n{by_style(raw, models[list(models)[-1]])}")


def _named(text: str) -> tuple[str, Path]:
    name, _, folder = text.rpartition("=")
    return name or Path(folder).name, Path(folder)


if __name__ == "__main__":
    raise SystemExit(run_command("gait_table", main))
