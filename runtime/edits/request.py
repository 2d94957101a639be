"""What words ask of a body in numbers, and what edits of its parts share: a measure of a swing, and what is followed.

A target is a weight (0 to 1) and a value times that weight, so that targets of two prompts blend by their weights. Edits
measure the network's own parts as it moves and add what is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.scalar_math import Vector, decay

# of a leg: metres of a foot from the middle line, metres that the hips are lowered, degrees of the heel raised over the
# toe, degrees that the foot is turned out, the largest bend of the knee in degrees, metres that the ankle rises in its
# swing at most, and degrees of the toes raised over the heel
LEG = ("outward", "lower", "heel", "toe_out", "knee", "low", "toes")
# and of the way that they go: fractions of a neutral walk's speed, at most and at least
PACE = ("slow", "fast")
# of the trunk: degrees that it leans forward and to the left of neutral walking, and that shoulders are turned to the
# left of the hips; metres and degrees from end to end in which hips sway and the trunk rocks, metres in which hips rise and
# fall, degrees from upright that the trunk leans forward at most, at any moment, and degrees that the shoulders are raised
TRUNK = ("lean", "aside", "twist", "sway", "rock", "bounce", "fold", "shrug")
# of an arm: degrees that the elbow bends at least and at most, metres of the elbow outward of the shoulder at least and at
# most, metres from end to end in which the hand swings forward and back at least and at most
ARM = ("bend", "straight", "out", "close", "swing", "still")
# and the place of its hand in each of these axes, those of a left arm: metres, the way that the elbow points, and
# metres from the place within which a hand is there
FRAMES = ("shoulder", "hips", "chest", "head")
PLACE = ("x", "y", "z", "pole_x", "pole_y", "pole_z", "near")
PARTS = ("left_leg", "right_leg", "torso", "left_arm", "right_arm")  # the rows of what is asked for
ROW_TRUNK, ROW_ARMS = 2, 3
FOLD = ROW_TRUNK, TRUNK.index("fold")  # what every trunk is asked for, whatever is said of it
WIDTH = len(ARM) + len(FRAMES) * len(PLACE)
SHAPE = (len(PARTS), WIDTH, 2)  # of what is asked for: each target's weight, and value times that
OUTWARD = LEG.index("outward")
SLOW, FAST = (len(LEG) + k for k in range(len(PACE)))
# metres of a foot from the middle line while both stand, in usual and in narrow walking
USUAL, NARROW = 0.05, 0.02
MOST_OF_LEG = (0.3, 0.4, 50.0, 50.0, 90.0, 1.0, 50.0)  # that is added
FIRST_TARGETS = 5  # of legs and trunk, in files without arms
LARGEST = 200.0  # degrees, metres of any target
Targets = list[list[float]]  # of one part


class EditRequest(NamedTuple):
    """What the parts of a body are asked to show, and how the body goes."""

    targets: list[Targets]  # [part][target]: weight, and value times weight
    yaw: float  # radians, the way that the body faces
    velocity: tuple[float, float]  # m/s of the root, X and Z
    ground: float  # metres, the height under the body
    feet: tuple[Vector, Vector] | None = None  # where the ankles were shown last


def value_of(target: list[float]) -> float:
    """What a target asks for; 0 where it asks for nothing."""
    weight, weighted = target
    return weighted / weight if weight > 1e-6 else 0.0


def asks(targets: Targets) -> bool:
    """Whether any of the targets asks for anything."""
    return any(weight > 1e-6 for weight, _ in targets)


def narrow(targets: list[Targets]) -> float:
    """How narrow a line the feet are asked to go on, of the targets of all parts: 0 where they go as wide as usual, to 1."""
    found = []
    for leg in targets[:ROW_TRUNK]:
        outward = leg[OUTWARD]
        found.append(outward[0] * min(max((USUAL - value_of(outward)) / (USUAL - NARROW), 0.0), 1.0))
    return min(found)


def followed(added: float, missing: float, half_life: float) -> float:
    """What is added a frame later, on its way to what is missing; exactly 0 at the end of the way there."""
    now = added + (1.0 - decay(half_life)) * (missing - added)
    return 0.0 if missing == 0.0 and abs(now) < 1e-4 else now


def limited(value: float, most: float) -> float:
    """The value, no further from 0 than `most`."""
    return min(max(value, -most), most)


@dataclass(frozen=True)
class Swing:
    """Mean and range of what a part does, as they follow it."""

    mean: float = 0.0  # times `known`
    square: float = 0.0  # mean square of what is away from the mean, times `known`
    known: float = 0.0  # how well they are known, 0 to 1

    def observed(self, value: float, mean_half_life: float, range_half_life: float) -> Swing:
        """The same with another frame's value taken in."""
        follow = 1.0 - decay(mean_half_life)
        mean, known = self.mean + follow * (value - self.mean), self.known + follow * (1.0 - self.known)
        away = value - mean / known
        return Swing(mean, self.square + (1.0 - decay(range_half_life)) * (away * away - self.square), known)

    @property
    def middle(self) -> float:
        """The mean."""
        return self.mean / self.known if self.known > 0.0 else 0.0

    @property
    def range(self) -> float:
        """From end to end of a swing."""
        return 2.0 * sqrt(2.0 * self.square / self.known) if self.known > 0.0 else 0.0

    def gain(self, least: float, smallest: float, most: float) -> float:
        """Times its own that is to be added so that it swings `least` at least; what swings less than `smallest` is no rhythm."""
        return self.known * min(max(least / max(self.range, smallest) - 1.0, 0.0), most)


def written_targets(targets: Array) -> list[list[float]]:
    """Targets `(5, 34, 2)` for a file: row, column, weight and value times weight of those that ask for something."""
    return [[*at, *targets[tuple(at)].tolist()] for at in np.argwhere(targets.any(-1)).tolist()]


def checked_targets(values: Any) -> Array:
    """Targets `(5, 34, 2)` of a file, as written or whole; ValueError for what no description asks for."""
    given: Array = np.array(values, np.float64)
    if given.ndim == 3 and given.shape != SHAPE and given.shape[1:] == (FIRST_TARGETS, 2):
        targets: Array = np.zeros(SHAPE)  # of a file with fewer parts and targets
        targets[: len(given), :FIRST_TARGETS] = given[: len(PARTS)]
    else:
        targets = given if given.shape == SHAPE else _placed(given.reshape(-1, 4))
    weights, legs = targets[..., 0], np.abs(targets[:ROW_TRUNK, : len(LEG), 1])
    within = (np.abs(targets) <= LARGEST).all() and (legs <= MOST_OF_LEG).all()
    if not within or not ((weights >= 0.0) & (weights <= 1.0)).all():
        raise ValueError("edits that no description asks for")
    return targets


def _placed(written: Array) -> Array:
    targets, at = np.zeros(SHAPE), written[:, :2].astype(int)
    if not ((at >= 0) & (at < SHAPE[:2]) & (at == written[:, :2])).all():
        raise ValueError("edits of no part")
    targets[at[:, 0], at[:, 1]] = written[:, 2:]
    return targets
