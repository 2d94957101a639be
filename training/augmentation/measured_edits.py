"""Effect of part edits on captured neutral walks, in their measures."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import FileError
from runtime.measures.signals import smoothed_facing
from runtime.measures.table import BodyMeasures, measure
from runtime.safe_read import open_npz
from runtime.skeleton import SPORT_SKELETON
from training.augmentation.catalogue import PartEdit, catalogue, part_edits
from training.augmentation.edits import apply
from training.augmentation.motion import EditedMotion, cut
from training.augmentation.pool import load_source
from training.markdown import table

Target = tuple[str, str]  # part, field of its measures
REFERENCE_WALKS = 3  # captured neutral walks of each data set
MIN_FRAMES, MAX_FRAMES = 240, 480
_WALKING = ("walk", "walk forward")
# Replaces measures that increase on one captured walk and decrease on another: a punching fist moves as far forward
# and back as a swinging arm, but high and in front of the chest.
_SHOWN_BY = {"punching": ("hand_level", "hand_front")}
_AGREEMENT_FRACTION = (
    0.75  # of the captured walks on which an edit must change its measure in the same direction
)


@dataclass(frozen=True)
class Summary:
    """A motion's measures, and mean and spread over time of every joint's local rotation.

    The hips' rotation is relative to the smoothed facing direction, so that heading has no influence.
    """

    body: BodyMeasures
    mean: Array  # (31, 4)
    spread: Array  # (31,) radians, root mean square


def summarise(hips: Array, local: Array, contacts: NDArray[Any]) -> Summary:
    """Summarise hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)`."""
    local = local.astype(np.float64)
    positions, _ = SPORT_SKELETON.forward_kinematics(hips.astype(np.float64), local)
    ahead = local.copy()
    ahead[:, 0] = rotations.multiply(
        rotations.inverse(rotations.from_yaw(smoothed_facing(positions))), local[:, 0]
    )
    mean = mean_rotation(ahead)
    away = 2.0 * np.arccos(np.clip(np.abs((ahead * mean).sum(-1)), 0.0, 1.0))
    return Summary(measure(hips, local, contacts.astype(np.float32)), mean, np.sqrt((away**2).mean(0)))


def mean_rotation(local: Array) -> Array:
    """Return the mean `(J, 4)` of unit quaternions `(T, J, 4)` of either sign: the principal axis of their second moment."""
    outer = np.einsum("tja,tjb->jab", local, local)
    return np.linalg.eigh(outer)[1][..., -1]


def rotation_change(one: Summary, other: Summary) -> Array:
    """Return the difference `(31,)` between joint motions, radians: angle between mean rotations, and change of spread.

    Both are averages over time, so that a phase shift between walks has no influence.
    """
    dot = np.abs((one.mean * other.mean).sum(-1))
    return np.hypot(2.0 * np.arccos(np.clip(dot, 0.0, 1.0)), other.spread - one.spread)


def targets(edits: Iterable[str]) -> list[Target]:
    """Return the measures of the edits; an edit of both legs is measured on both."""
    found = []
    for name in edits:
        edit = part_edits()[name]
        part, field = edit.measure
        found += [(part, f) for f in _SHOWN_BY.get(name.split(".")[1], (field,))]
        if edit.slot == "legs":
            found.append((part.replace("left", "right"), field))
    return found


def value(summary: Summary, target: Target) -> float:
    """Return the value of a measure."""
    return float(getattr(getattr(summary.body, target[0]), target[1]))


@dataclass(frozen=True)
class CapturedReference:
    """Captured neutral walks, and the effect of edits on them."""

    walks: list[tuple[str, EditedMotion, Summary]]

    def edited(self, edits: Sequence[str]) -> list[tuple[Summary, Summary]]:
        """Summarise each walk before and after the edits, varied as in training but with a fixed seed."""
        pairs = []
        for number, (_, motion, plain) in enumerate(self.walks):
            random = np.random.default_rng([number, *"+".join(edits).encode()])
            changed = motion
            for name in edits:
                changed = apply(changed, part_edits()[name], random)
            pairs.append((plain, summarise(changed.hips, changed.local, changed.contacts)))
        return pairs

    def described(
        self, pairs: Sequence[tuple[Summary, Summary]], edits: Sequence[str]
    ) -> dict[Target, float]:
        """Return the median change of the edits' measures; empty if the walks disagree on its direction."""
        found = {}
        for target in targets(edits):
            changes = [value(after, target) - value(before, target) for before, after in pairs]
            found[target] = float(np.median(changes))
            if np.mean(np.sign(changes) == np.sign(found[target])) < _AGREEMENT_FRACTION:
                return {}
        return found


def load_reference(clips: Path) -> CapturedReference:
    """Load neutral straight walks of every data set, unmirrored, on their own ground; FileError if there are none."""
    walks: list[tuple[str, EditedMotion, Summary]] = []
    taken: dict[str, int] = {}
    for path in sorted(clips.glob("*.npz")):
        dataset = path.stem.split("_")[0]
        if path.stem.startswith("layer_") or path.stem.endswith(("_m", "_t")):
            continue
        if taken.get(dataset, 0) >= REFERENCE_WALKS or not _is_neutral_walk(path):
            continue
        source = load_source(path)
        length = len(source.motion.hips)
        if length < MIN_FRAMES:
            continue
        first = max(0, (length - MAX_FRAMES) // 2)
        motion = cut(source.motion, first, min(first + MAX_FRAMES, length))
        walks.append((path.stem, motion, summarise(motion.hips, motion.local, motion.contacts)))
        taken[dataset] = taken.get(dataset, 0) + 1
    if not walks:
        raise FileError(
            f"{clips}: no captured neutral walk.", "Run `sport train import --data DIR --out DIR`."
        )
    return CapturedReference(walks)


def _is_neutral_walk(path: Path) -> bool:
    with open_npz(path, "Run the importer again.") as clip:
        return str(clip["style"]).startswith("neutral") and str(clip["content"]) in _WALKING


def rhythm_section(clips: Path) -> str:
    """Return Markdown: the median effect of every rhythm edit on its measure in captured neutral walks."""
    reference = load_reference(clips)
    rows = []
    for name, edit in part_edits().items():
        if not edit.rhythm or edit.slot.startswith("right"):
            continue
        target = targets((name,))[0]
        pairs = reference.edited((name,))
        before, after = (float(np.median([value(pair[k], target) for pair in pairs])) for k in (0, 1))
        numbers = ", ".join(f"{key} {number:g}" for key, number in edit.parameters.items())
        rows.append(
            [
                f"{name}{_held_out(edit)}",
                f"{edit.kind}: {numbers}",
                ".".join(target),
                f"{before:.2f} → {after:.2f}",
                next(iter(edit.phrases.values()))[0],
            ]
        )
    lines = table(("edit", "numbers", "measure", "neutral walks, median", "in its words"), rows)
    note = (
        f"Measured on {len(reference.walks)} captured neutral walks. An asterisk: never trained, on one side or on "
        "both; a right side is the mirror image. Measures are those of `runtime/measures/table.py`, numbers those of "
        "`training/augmentation/edits.toml`.\n"
    )
    return "\n".join(["## Rhythm and weight", "", *lines, note])


def _held_out(edit: PartEdit) -> str:
    twin = edit.name.replace("left_", "right_", 1)
    return " \\*" if {edit.name, twin} & catalogue().held_out else ""
