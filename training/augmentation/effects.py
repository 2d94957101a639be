"""What the edits of rhythm and weight do to captured neutral walks, as a table for the report on layered styles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from training.augmentation.catalogue import PartEdit, catalogue, part_edits
from training.augmentation.measured_edits import load_reference, targets, value

INTRODUCTION = """## Rhythm and weight

The other edits are of posture; these are of how long, quick, even and hard steps are, and of what hips, shoulders and arms do
in them (`training/augmentation/edits.toml`). What a walk does about its mean over a gait cycle is scaled, its frames
are played at another rate, or its path is changed and every footprint with it. A planted foot stays planted:

| kind | numbers | what is done |
| --- | --- | --- |
| `steps` | `length`, `cadence`: times the capture's | the root's path is scaled, each foot carried by what the path changed where it passes the foot, held through the stance; for longer steps the pelvis turns more and the heel behind rises; then all frames are played at the cadence |
| `line` | `outward`: metres from the middle line | footprints are set beside the path of a cycle |
| `stance` | `uneven`: times as long on this foot alone as on the other; `drop` metres | single stances are played slower and faster, steps get shorter and longer with them, the hips sink on the foot |
| `hesitation` | `pause`: seconds | time is spent while both feet stand |
| `stagger` | `wander` metres, `roll` degrees | the course leaves its line in slow waves, footprints scatter, the torso follows late, the rate is uneven |
| `landing` | `lift`, `drop` metres, `jolt` degrees, `soft`, `bob` | a late lift before a steep fall, knees and torso give after it; or the height is gone by two thirds of the swing |
| `bob` | `scale` | the hips' height about its mean over a cycle |
| `hips` | `sideways`, `roll`, `yaw` | the hips' sway and the pelvis' turns about their means; the chest stays level and mostly behind |
| `shoulders` | `yaw`, `roll` degrees | the turning of the shoulder line about its mean; a roll in step |
| `rock` | `roll` degrees, `sideways` metres | the torso tilts over the foot that carries, the hips go along |
| `swing` | `scale` | the arm's rotations about their mean |

Edits that put feet elsewhere are made of forward walks on level ground only, edits that scale of neutral ones. They change no gait
label: a pause is still a walk, so that words and not the label make it.
"""


def rhythm_section(clips: Path) -> str:
    """The definitions, and of every edit what it does to its measure on captured neutral walks, medians."""
    reference = load_reference(clips)
    rows = []
    for name, edit in part_edits().items():
        if not edit.rhythm or edit.slot.startswith("right"):
            continue
        target = targets((name,))[0]
        pairs = reference.edited((name,))
        before, after = (float(np.median([value(pair[k], target) for pair in pairs])) for k in (0, 1))
        rows.append(
            f"| {name}{_held_out(edit)} | {edit.kind}: {_numbers(edit)} | {'.'.join(target)} | "
            f"{before:.2f} → {after:.2f} | {next(iter(edit.phrases.values()))[0]} |"
        )
    table = [
        "| edit | numbers | measure | neutral walks, median | in its words |",
        "| --- | --- | --- | --- | --- |",
        *rows,
    ]
    note = (
        f"\nMeasured on {len(reference.walks)} captured neutral walks. An asterisk: never trained, on one side or on "
        "both; a right side is the mirror image. Measures are those of `training/text/measure.py`: `walk_ratio` is metres of "
        "a step over steps per second, `stance_lead` by which share a foot carries alone longer than the other, `halting` "
        "the deviation of the root's speed over its mean, `landing` metres per second at which an ankle comes down.\n"
    )
    return "\n".join([INTRODUCTION, *table, note])


def _held_out(edit: PartEdit) -> str:
    twin = edit.name.replace("left_", "right_", 1)
    return " \\*" if {edit.name, twin} & catalogue().held_out else ""


def _numbers(edit: PartEdit) -> str:
    return ", ".join(f"{key} {number:g}" for key, number in edit.parameters.items())
