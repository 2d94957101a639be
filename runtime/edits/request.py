"""Edit targets: the numbers that a prompt asks of each body part, and the measures that the edits share.

A target is a weight (0 to 1) and a range (minimum and maximum, each times the weight), so that targets of two prompts
blend linearly. Edits measure the network's own parts as they move and add what is missing to reach the range.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.measures.table import targets_of
from runtime.scalar_math import Vector, decay

GAITS = ("walk", "jog", "crouch")  # gaits with targets of their own
PACE = "pace"  # target of the leg's pace and of the walking speed
LEG, TRUNK, ARM = (
    tuple(name for name in targets_of(kind) if name != PACE) for kind in ("leg", "torso", "arm")
)
# arm targets besides the hand's place in each of these frames, for a left arm: metres, elbow direction, and
# tolerance in metres
FRAMES = ("shoulder", "hips", "chest", "head")
PLACE = ("x", "y", "z", "pole_x", "pole_y", "pole_z", "near")
PARTS = ("left_leg", "right_leg", "torso", "left_arm", "right_arm")  # rows of the targets
ROW_TRUNK, ROW_ARMS = 2, 3
FOLD = ROW_TRUNK, TRUNK.index("fold")  # target of every trunk, whatever its description
WIDTH = len(ARM) + len(FRAMES) * len(PLACE)
SHAPE = (len(GAITS), len(PARTS), WIDTH, 3)  # weight, and range times weight, of each target
OUTWARD = LEG.index("outward")
PACED = len(LEG)  # column of a leg's pace
# metres of a foot from the centre line while both stand, in usual and in narrow walking
USUAL_OUTWARD_M, NARROW_OUTWARD_M = 0.05, 0.02
MAX_ADDED_OF_LEG = tuple(targets_of("leg")[name].most for name in LEG)  # limits of the added amounts
MAX_TARGET = 200.0  # degrees or metres, of any target; value of an open end
MIN_WEIGHT = 1e-6  # of a target: less requests nothing
MIN_ADDED = 1e-4  # degrees or metres: a fading edit ends here
MIN_SEEN = 1e-3  # degrees, metres or ratio: less is invisible
Target = list[float]  # weight, and both ends of the range times weight
Targets = list[Target]  # of one part


class EditRequest(NamedTuple):
    """What a prompt asks of each body part, and how the body moves in this frame."""

    targets: list[Targets]  # [part][target]
    yaw: float  # radians, facing direction of the body
    velocity: tuple[float, float]  # m/s of the root, X and Z
    ground: float  # metres, ground height under the body
    feet: tuple[Vector, Vector] | None = None  # ankles as shown last


def range_of(target: Target) -> tuple[float, float]:
    """Return a target's minimum and maximum; the widest range if it requests nothing."""
    weight, low, high = target
    return (low / weight, high / weight) if weight > MIN_WEIGHT else (-MAX_TARGET, MAX_TARGET)


def least_of(target: Target) -> float:
    """Return a target's minimum, or 0 if it requests nothing."""
    return target[1] / target[0] if target[0] > MIN_WEIGHT else 0.0


def lacking(target: Target, shown: float) -> float:
    """Return how far `shown` is outside a target's range, times the target's weight; 0 within the range."""
    low, high = range_of(target)
    return target[0] * (max(low - shown, 0.0) + min(high - shown, 0.0))


def asks(targets: Targets) -> bool:
    """Return whether any of the targets requests something."""
    return any(target[0] > MIN_WEIGHT for target in targets)


def narrow(targets: list[Targets]) -> float:
    """Return how narrow a track the leg targets request: 0 for the usual width, 1 for the narrowest."""
    found = []
    for leg in targets[:ROW_TRUNK]:
        outward = leg[OUTWARD]
        found.append(
            outward[0]
            * min(
                max((USUAL_OUTWARD_M - range_of(outward)[1]) / (USUAL_OUTWARD_M - NARROW_OUTWARD_M), 0.0), 1.0
            )
        )
    return min(found)


def followed(added: float, missing: float, half_life: float) -> float:
    """Return the added amount one frame later, moving towards `missing`; exactly 0 once an edit has faded out."""
    now = added + (1.0 - decay(half_life)) * (missing - added)
    return 0.0 if missing == 0.0 and abs(now) < MIN_ADDED else now


def limited(value: float, most: float) -> float:
    """Return the value clamped to ±`most`."""
    return min(max(value, -most), most)


@dataclass(frozen=True)
class Swing:
    """Running mean and range of a periodic quantity."""

    mean: float = 0.0  # times `known`
    square: float = 0.0  # mean squared deviation, times `known`
    known: float = 0.0  # weight of these, 0 to 1

    def observed(self, value: float, mean_half_life: float, range_half_life: float) -> Swing:
        """Return the swing updated with the value of one more frame; the half-lives are in seconds."""
        follow = 1.0 - decay(mean_half_life)
        mean, known = self.mean + follow * (value - self.mean), self.known + follow * (1.0 - self.known)
        away = value - mean / known
        return Swing(mean, self.square + (1.0 - decay(range_half_life)) * (away * away - self.square), known)

    @property
    def middle(self) -> float:
        """The running mean."""
        return self.mean / self.known if self.known > 0.0 else 0.0

    @property
    def range(self) -> float:
        """Peak-to-peak amplitude of the swing."""
        return 2.0 * sqrt(2.0 * self.square / self.known) if self.known > 0.0 else 0.0

    def gain(self, target: Target, smallest: float, most: float) -> float:
        """Return the gain (factor of the swing to add) that reaches the target range.

        Swings below `smallest` do not count as rhythm; the gain is at most `most`.
        """
        low, high = range_of(target)
        more = min(max(low / max(self.range, smallest) - 1.0, 0.0), most) * min(self.range / smallest, 1.0)
        return target[0] * self.known * (more + min(max(high, 0.0) / max(self.range, MIN_SEEN) - 1.0, 0.0))


def written_targets(targets: Array) -> list[list[float]]:
    """Return targets for a file: gait, row and column of each target in use, with its weight and weighted bounds."""
    return [[*at, *targets[tuple(at)].tolist()] for at in np.argwhere(targets.any(-1)).tolist()]


def checked_targets(values: Any) -> Array:
    """Read targets from a file, sparse or complete; files from before targets had ranges yield none. Raises ValueError."""
    given: Array = np.array(values, np.float64)
    if given.shape[-1:] in ((2,), (4,)) and given.ndim < len(SHAPE):
        return np.zeros(SHAPE)  # an old file with one value per target: its prompt has to be read again
    targets = given if given.shape == SHAPE else _placed(given.reshape(-1, 6))
    weights = targets[..., 0]
    if not (np.abs(targets) <= MAX_TARGET).all() or not ((weights >= 0.0) & (weights <= 1.0)).all():
        raise ValueError("edits that no description asks for")
    return targets


def _placed(written: Array) -> Array:
    targets, at = np.zeros(SHAPE), written[:, :3].astype(int)
    if not ((at >= 0) & (at < SHAPE[:3]) & (at == written[:, :3])).all():
        raise ValueError("edits of no part")
    targets[tuple(at.T)] = written[:, 3:]
    return targets
