"""What words ask of a body in numbers, and what edits of its parts share: a measure of a swing, and what is followed.

A target is a weight (0 to 1) and a range, its lowest and highest value times that weight, so that targets of two prompts
blend by their weights. Edits measure the network's own parts as it moves and add what lies outside the range.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.measures.table import targets_of
from runtime.scalar_math import Vector, decay

GAITS = ("walk", "jog", "crouch")  # what is asked differs between them
PACE = "pace"  # of a leg, and of the way that they go
LEG, TRUNK, ARM = (
    tuple(name for name in targets_of(kind) if name != PACE) for kind in ("leg", "torso", "arm")
)
# of an arm besides the place of its hand in each of these axes, those of a left arm: metres, the way that the elbow points, and
# metres from the place within which a hand is there
FRAMES = ("shoulder", "hips", "chest", "head")
PLACE = ("x", "y", "z", "pole_x", "pole_y", "pole_z", "near")
PARTS = ("left_leg", "right_leg", "torso", "left_arm", "right_arm")  # the rows of what is asked for
ROW_TRUNK, ROW_ARMS = 2, 3
FOLD = ROW_TRUNK, TRUNK.index("fold")  # what every trunk is asked for, whatever is said of it
WIDTH = len(ARM) + len(FRAMES) * len(PLACE)
SHAPE = (len(GAITS), len(PARTS), WIDTH, 3)  # of what is asked for: each target's weight, and ends times that
OUTWARD = LEG.index("outward")
PACED = len(LEG)  # the column of a leg's pace
# metres of a foot from the middle line while both stand, in usual and in narrow walking
USUAL_OUTWARD_M, NARROW_OUTWARD_M = 0.05, 0.02
MOST_OF_LEG = tuple(targets_of("leg")[name].most for name in LEG)  # that is added
MAX_TARGET = 200.0  # degrees, metres of any target; of an open end
MIN_WEIGHT = 1e-6  # of a target: less asks for nothing
MIN_ADDED = 1e-4  # degrees, metres: what is taken back ends there
MIN_SEEN = 1e-3  # degrees, metres, times: less is not seen
Target = list[float]  # weight, and both ends of the range times that
Targets = list[Target]  # of one part


class EditRequest(NamedTuple):
    """What a prompt asks of each body part, and how the body moves in this frame."""

    targets: list[Targets]  # [part][target]
    yaw: float  # radians, the way that the body faces
    velocity: tuple[float, float]  # m/s of the root, X and Z
    ground: float  # metres, the height under the body
    feet: tuple[Vector, Vector] | None = None  # where the ankles were shown last


def range_of(target: Target) -> tuple[float, float]:
    """Return the lowest and highest value that a target asks for; the widest range if it asks for nothing."""
    weight, low, high = target
    return (low / weight, high / weight) if weight > MIN_WEIGHT else (-MAX_TARGET, MAX_TARGET)


def least_of(target: Target) -> float:
    """Return the lowest value that a target asks for, or 0 if it asks for nothing."""
    return target[1] / target[0] if target[0] > MIN_WEIGHT else 0.0


def lacking(target: Target, shown: float) -> float:
    """Return how far `shown` is outside a target's range, times the target's weight; 0 within the range."""
    low, high = range_of(target)
    return target[0] * (max(low - shown, 0.0) + min(high - shown, 0.0))


def asks(targets: Targets) -> bool:
    """Return whether any of the targets asks for something."""
    return any(target[0] > MIN_WEIGHT for target in targets)


def narrow(targets: list[Targets]) -> float:
    """Return how narrow a track the leg targets ask for: 0 for the usual width, 1 for the narrowest."""
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
    square: float = 0.0  # mean square of what is away from the mean, times `known`
    known: float = 0.0  # how well they are known, 0 to 1

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
        """Return how much of the swing to add, as a factor of it, to reach the target range.

        Swings under `smallest` do not count as rhythm; at most `most` is added.
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
        return np.zeros(SHAPE)  # of a file in which a target was one value: its words ask anew
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
