"""Straight walks of every captured style at full stick, generated and raw: `python -m training.evaluation gait`."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runtime.generate import clip_of
from runtime.motion.control_scripts import control_script
from runtime.motion.features import FPS
from training.data import gait
from training.data.sources import list_clips
from training.evaluation.experiment import Experiment, Setting
from training.evaluation.motion.driving import characters, flat_ground, walk_together
from training.evaluation.motion.evaluated_model import EvaluatedModel
from training.markdown import table

Measures = dict[str, float]

WALK_SECONDS = 12.0
RAW_FILES = 8  # at most, per style, evenly spaced
WALK = "walk forward"
_CMU_FIRST_FRAME = 3


@dataclass(frozen=True)
class WalkMeasure:
    """A measure: title and allowed range per style."""

    key: str
    title: str
    low: float
    high: float
    difference: bool = False  # difference generated minus raw, degrees; else their ratio


ROWS = (
    WalkMeasure("knee_min", "knee at its straightest, degrees", -5.0, 5.0, True),
    WalkMeasure("foot_up", "toes up at heel strike, degrees", -4.0, 4.0, True),
    WalkMeasure("lean", "forward lean, degrees", -3.0, 3.0, True),
    WalkMeasure("speed", "speed at full stick", 0.95, 1.05),
    WalkMeasure("cadence", "steps a minute", 0.95, 1.05),
    WalkMeasure("bob_cm", "pelvis bob", 0.75, 1.3),
    WalkMeasure("pelvis_yaw", "pelvis yaw", 0.75, 1.3),
    WalkMeasure("pelvis_roll", "pelvis roll", 0.75, 1.3),
    WalkMeasure("shoulder_yaw", "shoulder yaw", 0.75, 1.3),
    WalkMeasure("arm_swing_cm", "arm swing", 0.75, 1.3),
    WalkMeasure("knee_max", "knee at its most bent", 0.75, 1.3),
    WalkMeasure("clearance_cm", "height of the ankle's lift", 0.75, 1.3),
    WalkMeasure("elbow", "elbow, degrees", -10.0, 10.0, True),
    WalkMeasure("hands_vary_cm", "from stride to stride: way of the hands", 0.6, 1.2),
    WalkMeasure("tops_vary_cm", "top of the hands", 0.6, 1.2),
    WalkMeasure("steps_vary_cm", "length of the steps", 0.6, 1.2),
)


def raw_walks(data: Path, free_only: bool = False) -> dict[str, Measures]:
    """Measure each style's forward walks in the source files; returns medians over its files.

    `free_only` omits archives with a non-commercial licence.
    """
    files: dict[str, list[Path]] = {}
    for clip in list_clips(data, free_only)[0]:
        if clip.content == WALK and clip.terrain == "flat":
            files.setdefault(clip.style, []).append(clip.path)
    result = {}
    for style, paths in sorted(files.items()):
        first = _CMU_FIRST_FRAME if style.startswith("cmu") else 0
        chosen = paths[:: max(1, -(-len(paths) // RAW_FILES))]
        measured = [m for m in (gait.measure_file(p, first) for p in chosen) if m is not None]
        if measured:
            result[style] = gait.median(measured)
    return result


def generated_walks(evaluated: EvaluatedModel, styles: Iterable[str]) -> dict[str, Measures]:
    """Measure the exported BVH of a straight walk at full stick for each style's prompt."""
    names = list(styles)
    members = characters(evaluated.model, flat_ground(), [evaluated.style(style, 0) for style in names])
    walks = walk_together(members, control_script("forward", "walk"), round(WALK_SECONDS * FPS))
    clips = [clip_of(poses, style, (), "flat") for style, poses in zip(names, walks, strict=True)]
    measured = zip(names, gait.measured_exports(clips, gait.measure_file), strict=True)
    return {style: found for style, found in measured if found is not None}


def gait_figures(setting: Setting) -> dict[str, Any]:
    """Measure raw files and every model, by style."""
    raw = raw_walks(setting.args.data)
    return {"raw": raw, "models": {m.name: generated_walks(m, raw) for m in setting.models}}


def gait_table(figures: dict[str, Any]) -> str:
    """Return a table of medians over styles relative to raw, and the number of styles within the allowed range."""
    raw, models = figures["raw"], figures["models"]
    rows = []
    for row in ROWS:
        unit = f"{row.low:+g} to {row.high:+g}" if row.difference else f"{row.low:g} to {row.high:g}"
        rows.append([row.title, unit, *(cell(row, raw, ours) for ours in models.values())])
    head = [f"straight walks of {len(raw)} styles, ours and the raw files", "bar", *models]
    return "\n".join(table(head, rows))


def cell(row: WalkMeasure, raw: dict[str, Measures], ours: dict[str, Measures]) -> str:
    """Format the median difference or ratio over common styles, and how many are within the allowed range."""
    key = row.key
    pairs = [(ours[s][key], raw[s][key]) for s in raw if key in ours.get(s, {}) and key in raw[s]]
    if not pairs:
        return "no walk"
    values = np.array([a - b if row.difference else a / b for a, b in pairs])
    inside = int(((values >= row.low) & (values <= row.high)).sum())
    middle = float(np.median(values))
    shown = f"{middle:+.1f}" if row.difference else f"{middle:.2f}"
    return f"{shown}; {inside} of {len(values)}"


GAIT = Experiment(
    "Straight walks of every captured style at full stick, compared with the raw capture files.",
    gait_figures,
    gait_table,
    "straight walks",
    options=("models", "data"),
    needs=("data",),
)
