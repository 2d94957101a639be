"""A trunk that does what its description says, where a walk by the network alone does not: lean, twist, sway and rock.

As the edit of legs, it measures the network's own trunk as it walks and adds what is missing, to what is shown alone. Hips
that sway move sideways over feet that stay; the head turns back a part of what is added, so that it looks where it looked.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, degrees, pi, radians, sin, sqrt

import numpy as np

from runtime.arrays import Array
from runtime.edits.request import ROW_TRUNK, TRUNK, EditRequest, Targets, asks
from runtime.pose import FPS
from runtime.scalar_math import Quaternion, Vector, decay, from_vector, multiply, relative, rotate, scale
from runtime.skeleton import SPORT_SKELETON

LEAN, ASIDE, TWIST, SWAY, ROCK = range(len(TRUNK))
UPRIGHT = (-1.0, 0.0, 0.0)  # degrees of lean, aside and twist in neutral walking
MOST = (25.0, 20.0, 40.0)  # degrees of them that are added
MOST_GAIN, MOST_SHIFT, MOST_ROCK = 2.5, 0.07, 12.0  # of sway and rock: times the network's; metres, degrees
MEAN_HALF_LIFE = 0.4  # seconds in which the measures follow the pose,
RANGE_HALF_LIFE = 0.6  # and the ranges of sway and rock
HALF_LIFE = 0.3  # seconds in which what is added follows what is missing
RANGE = 2.0 * sqrt(2.0)  # from end to end of a swing, times its root mean square
LEAST_SWAY, LEAST_ROCK = 0.008, 1.0  # metres, degrees: what swings less is not amplified more
LOOKS_AHEAD = 0.6  # of what is added, that the neck takes back
_SPINE = tuple(SPORT_SKELETON.index(name) for name in ("LowerBack", "Spine", "Spine1"))
_NECK = SPORT_SKELETON.index("Neck")
_JOINTS = (0, *_SPINE, _NECK)
_UP: Vector = (0.0, 1.0, 0.0)
_AHEAD: Vector = (0.0, 0.0, 1.0)


@dataclass
class TrunkEdit:
    """What was measured of the network's trunk of a character, and what is added to it."""

    lean: float = 0.0  # degrees, means
    aside: float = 0.0
    twist: float = 0.0
    x: float = 0.0  # m, mean place of the hips
    z: float = 0.0
    east: float = 0.0  # m/s, its mean velocity
    south: float = 0.0
    sway: float = 0.0  # m2 and degrees2, mean squares about the means
    rock: float = 0.0
    known: float = 0.0  # how well these are known, 0 to 1
    more_lean: float = 0.0  # degrees that are added
    more_aside: float = 0.0
    more_twist: float = 0.0
    more_sway: float = 0.0  # times the network's own that is added
    more_rock: float = 0.0

    def apply(self, hips: Vector, local: Array, request: EditRequest) -> tuple[float, float, Array]:
        """Metres, X and Z, that the hips move, and the local rotations `(31, 4)` with the trunk as it is asked for."""
        if not self.active and not asks(request.targets[ROW_TRUNK]):
            self.known = 0.0  # what is asked for later is measured anew
            return 0.0, 0.0, local
        rotations: list[Quaternion] = [tuple(q) for q in local[list(_JOINTS)].tolist()]
        side: Vector = (cos(request.yaw), 0.0, -sin(request.yaw))  # towards the left
        ahead: Vector = (sin(request.yaw), 0.0, cos(request.yaw))
        shown = _angles(rotations, side, ahead)
        if self.known == 0.0:
            vars(self).update(vars(TrunkEdit(x=hips[0], z=hips[2])))
        mean = 1.0 - decay(MEAN_HALF_LIFE)
        east, south = request.velocity
        self.east += mean * (east - self.east)
        self.south += mean * (south - self.south)
        x, z = self.x + self.east / FPS, self.z + self.south / FPS  # the mean goes along
        self.x, self.z = x + mean * (hips[0] - x), z + mean * (hips[2] - z)
        self.lean += mean * (shown[LEAN] - self.lean)
        self.aside += mean * (shown[ASIDE] - self.aside)
        self.twist += mean * (shown[TWIST] - self.twist)
        swayed = (hips[0] - self.x) * side[0] + (hips[2] - self.z) * side[2]
        swayed = min(max(swayed, -MOST_SHIFT), MOST_SHIFT)  # what is more turns or sets off
        self.known += mean * (1.0 - self.known)
        rocked = shown[ASIDE] - self.aside / self.known
        seen = 1.0 - decay(RANGE_HALF_LIFE)
        self.sway += seen * (swayed * swayed - self.sway)
        self.rock += seen * (rocked * rocked - self.rock)
        self._follow(request.targets[ROW_TRUNK])
        shift = min(max(self.more_sway * swayed, -MOST_SHIFT), MOST_SHIFT)
        rolled = self.more_aside + min(max(self.more_rock * rocked, -MOST_ROCK), MOST_ROCK)
        if self.more_lean or rolled or self.more_twist:
            local = _turned(local, rotations, (self.more_lean, rolled, self.more_twist), (side, ahead))
        return shift * side[0], shift * side[2], local

    @property
    def active(self) -> bool:
        """Whether anything is added."""
        added = (self.more_lean, self.more_aside, self.more_twist, self.more_sway, self.more_rock)
        return any(abs(value) > 1e-3 for value in added)

    def _follow(self, targets: Targets) -> None:
        """Let what is added go towards what is missing."""
        follow = 1.0 - decay(HALF_LIFE)
        for k, name in enumerate(("lean", "aside", "twist")):
            weight, weighted = targets[k]
            goal = 0.0
            if weight > 1e-6:
                value = weighted / weight
                lacks = (value + UPRIGHT[k] - getattr(self, name) / self.known) * self.known
                one_way = max if value > 0.0 else min  # what leans or turns more than said stays
                goal = weight * min(max(one_way(lacks, 0.0), -MOST[k]), MOST[k])
            added = getattr(self, f"more_{name}")
            setattr(self, f"more_{name}", added + follow * (goal - added))
        swings = (SWAY, "sway", LEAST_SWAY), (ROCK, "rock", LEAST_ROCK)
        for k, name, least in swings:
            weight, weighted = targets[k]
            goal = 0.0
            if weight > 1e-6:
                has = max(RANGE * sqrt(getattr(self, name) / self.known), least)
                goal = weight * self.known * min(max(weighted / weight / has - 1.0, 0.0), MOST_GAIN)
            added = getattr(self, f"more_{name}")
            setattr(self, f"more_{name}", added + follow * (goal - added))


def _angles(rotations: list[Quaternion], side: Vector, ahead: Vector) -> tuple[float, float, float]:
    """Degrees of lean, aside and twist of a trunk, from the rotations of hips and spine."""
    chest = pelvis = rotations[0]
    for q in rotations[1 : 1 + len(_SPINE)]:
        chest = multiply(chest, q)
    up, front, hips = rotate(chest, _UP), rotate(chest, _AHEAD), rotate(pelvis, _AHEAD)
    lean = atan2(up[0] * ahead[0] + up[2] * ahead[2], up[1])
    aside = atan2(up[0] * side[0] + up[2] * side[2], up[1])
    twist = (atan2(front[0], front[2]) - atan2(hips[0], hips[2]) + pi) % (2.0 * pi) - pi
    return degrees(lean), degrees(aside), degrees(twist)


def _turned(
    local: Array, rotations: list[Quaternion], angles: tuple[float, float, float], axes: tuple[Vector, Vector]
) -> Array:
    """Local rotations with the spine turned by degrees of lean, aside and twist, a third at each of its joints."""
    side, ahead = axes
    lean, aside, twist = (radians(angle) / len(_SPINE) for angle in angles)
    turn = multiply(from_vector(scale(_UP, twist)), _leant(side, lean, ahead, aside))
    result, parent = np.array(local, copy=True), rotations[0]
    for joint, q in zip(_SPINE, rotations[1:], strict=False):
        made = relative(parent, multiply(turn, multiply(parent, q)))
        result[joint] = made
        parent = multiply(parent, made)
    back = -LOOKS_AHEAD * len(_SPINE)
    turn = multiply(_leant(side, back * lean, ahead, back * aside), from_vector(scale(_UP, back * twist)))
    result[_NECK] = relative(parent, multiply(turn, multiply(parent, rotations[-1])))
    return result


def _leant(side: Vector, lean: float, ahead: Vector, aside: float) -> Quaternion:
    return multiply(from_vector(scale(ahead, -aside)), from_vector(scale(side, lean)))
