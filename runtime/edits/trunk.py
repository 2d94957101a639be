"""Trunk edits: lean, twist, sway, rock and bounce that a prompt asks for and the network's walk lacks.

The network's own trunk is measured as it moves, and what is missing is added. Lean is measured on the line from
hips to neck, and applied at the hips. Hips that sway or bounce move over fixed feet; the head turns back by a part of
the added rotation, and the arms keep hanging. The trunk never folds or tips much further than its description says.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import atan2, copysign, cos, degrees, pi, radians, sin
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from runtime.arrays import Array
from runtime.edits.request import (
    MIN_SEEN,
    MIN_WEIGHT,
    ROW_TRUNK,
    TRUNK,
    EditRequest,
    Swing,
    Targets,
    asks,
    followed,
    lacking,
    least_of,
    limited,
    narrow,
    range_of,
)
from runtime.measures.table import targets_of
from runtime.pose import FPS
from runtime.scalar_math import (
    Quaternion,
    Vector,
    add,
    decay,
    dot,
    from_vector,
    multiply,
    relative,
    rotate,
    scale,
)
from runtime.skeleton import SPORT_SKELETON

LEAN, ASIDE, TWIST, SWAY, ROCK, BOUNCE, FOLD, SHRUG = range(len(TRUNK))
LIMITS_DEG = tuple(row.most for row in targets_of("torso").values())  # limits of the added rotation
# limits of sway and rock: times the network's; metres, degrees
MAX_SWING_GAIN, MAX_SHIFT_M, MAX_ROCK_DEGREES = 2.5, 0.07, 12.0
HIPS_TO_NECK_M = 0.5
MAX_BOUNCE_M = 0.06  # limit of the hips' vertical displacement
SINKING_FRACTION = 0.35  # of a bounce's range, by which hips are lowered: legs cannot lengthen
MEAN_HALF_LIFE_S = 0.4  # of the measures,
RANGE_HALF_LIFE_S = 0.6  # and of the ranges of sway, rock and bounce
ADDED_HALF_LIFE_S = 0.36  # of the added amounts
# peak-to-peak metres over feet on a line: under half a foot's width to either side, unless more is requested
MAX_LINE_SWAY_M = 0.06
# metres, degrees: smaller swings are amplified less, and absent ones not at all
MIN_SWAY_M, MIN_ROCK_DEGREES, MIN_BOUNCE_M = 0.008, 1.0, 0.008
NECK_FRACTION = 0.6  # of the added rotation, taken back by the neck
HANGING_ARM_FRACTION = 0.65  # of an added lean, taken back by the arms
# half-life of the permanent lean (seconds); degrees that a trunk may fold beyond it
STEADY_HALF_LIFE_S, STEADY_LEAN_MARGIN_DEGREES = 2.0, 8.0
# degrees that a trunk may tip to a side, and lean back, beyond its description
MAX_TIP_DEGREES, MAX_BACK_LEAN_DEGREES = 20.0, 15.0
BOUND_EASE_DEGREES = 5.0  # before either bound, where its motion is slowed down
_AT = SPORT_SKELETON.index
_SPINE, _NECK = tuple(map(_AT, ("LowerBack", "Spine", "Spine1"))), _AT("Neck")
_COLLARS = _AT("LeftShoulder"), _AT("RightShoulder")
_ARMS = _AT("LeftArm"), _AT("RightArm")
_JOINTS = (0, *_SPINE, _NECK)
_MEASURED = ("lean", "aside", "twist", "sway", "bounce")
_added = attrgetter(*(f"more_{name}" for name in TRUNK[:FOLD]), "shrug")
_LOWER, _UPPER = ((float(x), float(y), float(z)) for x, y, z in SPORT_SKELETON.offsets[list(_SPINE[1:])])
_UP: Vector = (0.0, 1.0, 0.0)
_AHEAD: Vector = (0.0, 0.0, 1.0)


class Moved(NamedTuple):
    """Hips displacement (metres along X, Y and Z) and local rotations `(31, 4)` of an edited trunk."""

    east: float
    up: float
    south: float
    local: Array


@dataclass
class TrunkEdit:
    """State of the trunk edits of one character: measurements of the network's trunk, and the added amounts."""

    lean: Swing = field(default_factory=Swing)  # degrees
    aside: Swing = field(default_factory=Swing)
    twist: Swing = field(default_factory=Swing)
    sway: Swing = field(default_factory=Swing)  # metres of the hips from their mean path
    bounce: Swing = field(default_factory=Swing)  # metres, hip height
    x: float = 0.0  # m, mean position of the hips
    z: float = 0.0
    east: float = 0.0  # m/s, their mean velocity
    south: float = 0.0
    steady: float = 0.0  # degrees, permanent lean
    more_lean: float = 0.0  # added degrees
    more_aside: float = 0.0
    more_twist: float = 0.0
    more_sway: float = 0.0  # added, relative to the network's own
    more_rock: float = 0.0
    more_bounce: float = 0.0
    shrug: float = 0.0  # degrees, shoulder elevation

    def watch(self, lean: float, aside: float, fold: float) -> bool:
        """Return whether the trunk, leaning `lean` degrees, is near its fold limit or tipping over; call every frame."""
        shown = max(min(lean, self._bound(fold)), -self._back(0.0))
        self.steady += (1.0 - decay(STEADY_HALF_LIFE_S)) * (shown - self.steady)
        return (
            lean > self._bound(fold) - BOUND_EASE_DEGREES
            or -lean > self._back(0.0) - BOUND_EASE_DEGREES
            or abs(aside) > MAX_TIP_DEGREES - BOUND_EASE_DEGREES
        )

    def apply(self, hips: Vector, local: Array, request: EditRequest) -> Moved:
        """Return the edited trunk: hips displacement and local rotations `(31, 4)`."""
        targets = request.targets[ROW_TRUNK]
        rotations: list[Quaternion] = [tuple(q) for q in local[list(_JOINTS)].tolist()]
        side: Vector = (cos(request.yaw), 0.0, -sin(request.yaw))  # towards the left
        ahead: Vector = (sin(request.yaw), 0.0, cos(request.yaw))
        shown = _angles(rotations, side, ahead)
        shift = up = lean = rolled = 0.0
        if self.active or asks([*targets[:FOLD], targets[SHRUG]]) or narrow(request.targets):
            shift, up, lean, rolled = self._edit(hips, shown, side, request)
        elif self.lean.known > 0.0:
            vars(self).update(vars(TrunkEdit(steady=self.steady)))  # later edits measure anew
        weight, most = targets[FOLD][0], range_of(targets[FOLD])[1]
        if weight > MIN_WEIGHT:
            leans = shown[LEAN] + lean
            lean -= weight * _too_far(leans, self._bound(most))
            lean += weight * _too_far(-leans, self._back(min(range_of(targets[LEAN])[1], 0.0)))
            aside, tips = shown[ASIDE] + rolled, MAX_TIP_DEGREES + abs(least_of(targets[ASIDE]))
            rolled -= weight * copysign(_too_far(abs(aside), tips), aside)
        if lean or rolled or self.more_twist:
            local = _turned(local, rotations, (lean, rolled, self.more_twist), (side, ahead))
        if self.shrug:
            local = _shrugged(local, radians(self.shrug))
        return Moved(shift * side[0], up, shift * side[2], local)

    @property
    def active(self) -> bool:
        """Whether the edit currently changes the trunk."""
        return max(map(abs, _added(self))) > MIN_SEEN

    def _bound(self, fold: float) -> float:
        return max(fold, self.steady + STEADY_LEAN_MARGIN_DEGREES)

    def _back(self, said: float) -> float:
        """Limit of leaning back (degrees), given the described lean `said` (negative: back)."""
        return max(MAX_BACK_LEAN_DEGREES - min(said, 0.0), STEADY_LEAN_MARGIN_DEGREES - self.steady)

    def _edit(
        self, hips: Vector, shown: tuple[float, float, float], side: Vector, request: EditRequest
    ) -> tuple[float, float, float, float]:
        """Return the hips' displacement to the left and up (m), and the trunk's forward and left lean (degrees)."""
        if self.lean.known == 0.0:
            self.x, self.z, self.east, self.south = hips[0], hips[2], 0.0, 0.0
        mean, halves = 1.0 - decay(MEAN_HALF_LIFE_S), (MEAN_HALF_LIFE_S, RANGE_HALF_LIFE_S)
        east, south = request.velocity
        self.east += mean * (east - self.east)
        self.south += mean * (south - self.south)
        x, z = self.x + self.east / FPS, self.z + self.south / FPS  # the mean position follows
        self.x, self.z = x + mean * (hips[0] - x), z + mean * (hips[2] - z)
        swayed = (hips[0] - self.x) * side[0] + (hips[2] - self.z) * side[2]
        swayed = limited(swayed, MAX_SHIFT_M)  # larger values are turns or starts
        height = hips[1] - request.ground
        for name, value in zip(_MEASURED, (*shown, swayed, height), strict=True):
            setattr(self, name, getattr(self, name).observed(value, *halves))
        self._follow(request.targets[ROW_TRUNK], narrow(request.targets))
        rocked = limited(self.more_rock * (shown[ASIDE] - self.aside.middle), MAX_ROCK_DEGREES)
        sinks = SINKING_FRACTION * self.bounce.range if self.more_bounce > 0.0 else 0.0
        bounced = self.more_bounce * (height - self.bounce.middle - sinks)
        shift = limited(self.more_sway * swayed, MAX_SHIFT_M)
        # shoulders, and most of the mass, stay in place
        stays = degrees(atan2(-shift, HIPS_TO_NECK_M))
        return (
            shift,
            limited(bounced, MAX_BOUNCE_M),
            self.more_lean,
            self.more_aside + rocked + stays,
        )

    def _follow(self, targets: Targets, on_a_line: float) -> None:
        """Move the added amounts towards what is missing; hips over a line stay over the standing foot."""
        for k, (name, measure) in enumerate(
            (("lean", self.lean), ("aside", self.aside), ("twist", self.twist))
        ):
            goal = measure.known * limited(lacking(targets[k], measure.middle), LIMITS_DEG[k])
            setattr(self, f"more_{name}", followed(getattr(self, f"more_{name}"), goal, ADDED_HALF_LIFE_S))
        self.shrug = followed(self.shrug, limited(targets[SHRUG][1], LIMITS_DEG[SHRUG]), ADDED_HALF_LIFE_S)
        for k, name, measure, least in (
            (SWAY, "sway", self.sway, MIN_SWAY_M),
            (ROCK, "rock", self.aside, MIN_ROCK_DEGREES),
            (BOUNCE, "bounce", self.bounce, MIN_BOUNCE_M),
        ):
            goal = measure.gain(targets[k], least, MAX_SWING_GAIN)
            if k == SWAY:
                widest = max(MAX_LINE_SWAY_M, range_of(targets[k])[0])
                most = measure.known * (widest / max(measure.range, MIN_SWAY_M) - 1.0)
                goal += on_a_line * min(most - goal, 0.0)
            setattr(self, f"more_{name}", followed(getattr(self, f"more_{name}"), goal, ADDED_HALF_LIFE_S))


def _too_far(angle: float, bound: float) -> float:
    """Degrees by which a trunk exceeds a bound, eased in before it."""
    over = max(angle - bound + BOUND_EASE_DEGREES, 0.0)
    return (
        over * over / (4.0 * BOUND_EASE_DEGREES)
        if over < 2.0 * BOUND_EASE_DEGREES
        else over - BOUND_EASE_DEGREES
    )


def _angles(rotations: list[Quaternion], side: Vector, ahead: Vector) -> tuple[float, float, float]:
    """Return lean, sideways lean (hips to neck) and twist in degrees, from the rotations of hips and spine."""
    pelvis, *spine = rotations[: 1 + len(_SPINE)]
    lower = multiply(pelvis, spine[0])
    middle = multiply(lower, spine[1])
    chest = multiply(middle, spine[2])
    line = add(rotate(lower, _LOWER), rotate(middle, _UPPER))
    front, hips = rotate(chest, _AHEAD), rotate(pelvis, _AHEAD)
    lean, aside = atan2(dot(line, ahead), line[1]), atan2(dot(line, side), line[1])
    twist = (atan2(front[0], front[2]) - atan2(hips[0], hips[2]) + pi) % (2.0 * pi) - pi
    return degrees(lean), degrees(aside), degrees(twist)


def _turned(
    local: Array, rotations: list[Quaternion], angles: tuple[float, float, float], axes: tuple[Vector, Vector]
) -> Array:
    """Return local rotations with the trunk leant at the hips, and twisted by a third at each joint (degrees)."""
    side, ahead = axes
    lean, aside, twist = map(radians, angles)
    result, parent = np.array(local, copy=True), rotations[0]
    turn, third = _leant(side, lean, ahead, aside), from_vector(scale(_UP, twist / len(_SPINE)))
    for joint, q in zip(_SPINE, rotations[1:], strict=False):
        turn = multiply(third, turn)
        made = relative(parent, multiply(turn, multiply(parent, q)))
        result[joint] = made
        parent = multiply(parent, made)
        turn = (1.0, 0.0, 0.0, 0.0)
    back = _leant(side, -NECK_FRACTION * lean, ahead, -NECK_FRACTION * aside)
    back = multiply(back, from_vector(scale(_UP, -NECK_FRACTION * twist)))
    result[_NECK] = relative(parent, multiply(back, multiply(parent, rotations[-1])))
    back = _leant(side, -HANGING_ARM_FRACTION * lean, ahead, -HANGING_ARM_FRACTION * aside)
    for collar, arm in zip(_COLLARS, _ARMS, strict=True):
        base = multiply(parent, tuple(local[collar].tolist()))
        result[arm] = relative(base, multiply(back, multiply(base, tuple(local[arm].tolist()))))
    return result


def _shrugged(local: Array, angle: float) -> Array:
    """Return local rotations with both shoulders raised by `angle` radians and the arms kept hanging."""
    result = np.array(local, copy=True)
    for collar, arm, sign in zip(_COLLARS, _ARMS, (1.0, -1.0), strict=True):
        before = tuple(local[collar].tolist())
        raised = multiply(from_vector((0.0, 0.0, sign * angle)), before)
        result[collar] = raised
        result[arm] = relative(raised, multiply(before, tuple(local[arm].tolist())))
    return result


def _leant(side: Vector, lean: float, ahead: Vector, aside: float) -> Quaternion:
    return multiply(from_vector(scale(ahead, -aside)), from_vector(scale(side, lean)))
