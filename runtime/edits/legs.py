"""Leg edits: posture of legs and feet that a prompt asks for and the network's walk lacks.

The network's own legs are measured over their steps: track width, hip height, pitch and yaw of planted feet. What a
description asks for and the walk lacks is added to the pose before the foot lock, in the same way as in the augmented
training data. The network is fed its own pose, so that the measurement does not depend on the edit.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import acos, asin, atan2, cos, degrees, dist, hypot, pi, radians, sin, sqrt

from runtime.edits.line import FootLine
from runtime.edits.request import (
    LEG,
    MAX_ADDED_OF_LEG,
    MIN_SEEN,
    MIN_WEIGHT,
    EditRequest,
    Target,
    Targets,
    followed,
    lacking,
    limited,
    narrow,
    range_of,
)
from runtime.feet.leg import LegPose
from runtime.scalar_math import (
    MIN_SIZE,
    Quaternion,
    Vector,
    add,
    decay,
    dot,
    length,
    multiply,
    rotate,
    scale,
    subtract,
)
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT

OUTWARD, LOWER, PITCH, TOE_OUT, KNEE, LIFT = range(len(LEG))
ADDED_HALF_LIFE_S = 0.2  # of the edits
MEASURE_HALF_LIFE_S = 0.25  # of the measures
LINE_HALF_LIFE_S = 0.15  # of the track width, measured while both feet are down,
ONE_FOOT_WEIGHT = 0.2  # weight of a second with one foot or none on the ground
# half-lives of the height of a swing, and of the largest bend of a knee
LIFT_HALF_LIFE_S = 2.0
STIFFENING_DEGREES = 5.0  # over the requested flexion, at which a knee is straightened fully
MIN_WALKING_SPEED_M_PER_S = 0.3  # above which it is
RISE_HALF_LIFE_S, MAX_RISE_M = 0.1, 0.05  # of the hips' response to displaced legs; its limit
TIPTOE_RISE_M_PER_RAD = 0.1  # rise of the hips per radian of a raised heel, half of the ankles' rise,
HEEL_SINK_M_PER_RAD = 0.045  # and their sinking per radian of raised toes
ROLLED_FOOT_DEGREES = 8.0  # of a raised heel, beyond which it does not stand
SIDESTEP_HALF_LIFE_S, MAX_SIDESTEP_M = 0.06, 0.24  # of a straight leg's outward swing; its limit
MAX_TOE_UP_RAD = 0.7  # upward pitch of its foot, so that the toe clears the ground
MAX_KNEE_DEGREES = 90.0  # of a requested bend; more counts as this
MIN_SQUARED_RISE = 0.04  # m2: hips stay 0.2 m above an ankle, however far sideways it moves
STANDING_BEND_RAD = radians(10.0)  # of a straight standing leg, which carries the hips as high as possible
BENT_M = 0.1  # lowering of the hips from which knees bend regardless of their description
SWING_CLEARANCE_M = 0.03  # over its resting height, of a straight swinging leg
UPRIGHT_HIPS_M = 0.955  # hip height over level ground in neutral walking
_NOTHING = (0.0,) * len(LEG)
_UP: Vector = (0.0, 1.0, 0.0)
_FROM_HEEL: Vector = (0.0, ANKLE_HEIGHT, 0.05)  # from heel to ankle, m


@dataclass
class LegEdit:
    """State of the leg edits of one character: measurements of the network's legs, and the current edits."""

    across: float = 0.0  # m, lateral distance of the left ankle from the right one, times `known`
    middle: float = 0.0  # m, mean of both ankles to the left of the hips, times `known`
    known: float = 0.0  # weight (0 to 1) of these two, measured while both feet are down
    line: FootLine = field(default_factory=FootLine, metadata={"later": True})
    height: float = 0.0  # m of the hips above the ground; 0 before the first frame
    pitch: tuple[float, float] = (0.0, 0.0)  # degrees of planted feet, heel up
    yaw: tuple[float, float] = (0.0, 0.0)  # degrees of planted feet, outward
    rise: float = 0.0  # m, of the hips for displaced legs
    aside: tuple[float, float] = (0.0, 0.0)  # m, outward swing of a straight leg
    lift: tuple[float, float] = (0.0, 0.0)  # m, rise of the ankles in swing
    bend: tuple[float, float] = (0.0, 0.0)  # degrees, knee flexion in swing
    # added amounts, by `LEG`; for a lift the removed fraction, for a knee its maximum flexion
    left: tuple[float, ...] = _NOTHING
    right: tuple[float, ...] = _NOTHING

    @property
    def active(self) -> bool:
        """Whether the edit currently changes a leg."""
        return any(self.left) or any(self.right)

    @property
    def lowered(self) -> float:
        """How far (metres) the hips are below those of a neutral walk."""
        return UPRIGHT_HIPS_M - self.height

    def apply(
        self, height: float, legs: tuple[LegPose, LegPose], chances: list[float], request: EditRequest
    ) -> tuple[float, list[LegPose]]:
        """Return how far the hips rise (metres), and both legs edited except for their knees, which are solved later.

        `height` is that of the hips. `chances` are contact probabilities (left heel, left toe, right heel, right toe);
        those of raised heels are lowered in place.
        """
        bears = (max(chances[0], chances[1]), max(chances[2], chances[3]))
        self._measure(height - request.ground, legs, bears, request)
        self._follow(request)
        added = (self.left, self.right)
        side: Vector = (cos(request.yaw), 0.0, -sin(request.yaw))  # towards the left
        pitches = [radians(each[PITCH]) for each in added]
        lower = self.left[LOWER]
        up = -lower if lower > MIN_SEEN else TIPTOE_RISE_M_PER_RAD * max(min(pitches), 0.0)
        up += HEEL_SINK_M_PER_RAD * min(max(pitches), 0.0)
        feet = [
            _low(_foot(leg, sign, each), each[LIFT], request.ground) if each[LIFT] else _foot(leg, sign, each)
            for leg, sign, each in zip(legs, (1.0, -1.0), added, strict=True)
        ]
        ankles = [foot.ankle for foot in feet]
        moved = [
            add(ankle, scale(side, sign * each[OUTWARD]))
            for ankle, sign, each in zip(ankles, (1.0, -1.0), added, strict=True)
        ]
        moved = self.line.apply(scale(add(legs[0].hip, legs[1].hip), 0.5), moved, bears, request)
        spans = [
            _straight(foot, each[KNEE], request.targets[k][KNEE])
            for k, (foot, each) in enumerate(zip(feet, added, strict=True))
        ]
        up += self._rise(up, feet, moved, bears, spans)
        result, swings = [], list(self.aside)
        for k, (foot, ankle) in enumerate(zip(feet, moved, strict=True)):
            if added[k][KNEE] > 0.0:
                ankle, aside = _straightened(foot, up, ankle, spans[k][1], bears[k], request)
                swings[k] += (aside - swings[k]) * (1.0 - decay(SIDESTEP_HALF_LIFE_S))
                ankle = add(ankle, scale(side, (1.0 - 2.0 * k) * swings[k]))
                foot = _toe_over(
                    foot, request.ground + TOE_HEIGHT + SWING_CLEARANCE_M - ankle[1], 1.0 - bears[k]
                )
            toe = add(foot.toe, subtract(ankle, foot.ankle))
            hip, knee = ((p[0], p[1] + up, p[2]) for p in (foot.hip, foot.knee))
            result.append(foot._replace(hip=hip, knee=knee, toe=toe, ankle=ankle))
            if added[k][PITCH] > ROLLED_FOOT_DEGREES:
                chances[2 * k] = 0.0
            if added[k][PITCH] < -ROLLED_FOOT_DEGREES:
                chances[2 * k + 1] = 0.0
        self.aside = (swings[0], swings[1])
        return up, result

    def _measure(
        self, height: float, legs: tuple[LegPose, LegPose], bears: tuple[float, float], request: EditRequest
    ) -> None:
        x, z = request.velocity
        speed = hypot(x, z)
        if speed > MIN_WALKING_SPEED_M_PER_S:
            left, right = (
                (z * (leg.ankle[0] - middle[0]) - x * (leg.ankle[2] - middle[2])) / speed
                for middle in (scale(add(legs[0].hip, legs[1].hip), 0.5),)
                for leg in legs
            )
            seen = (1.0 - decay(LINE_HALF_LIFE_S)) * max(min(4.0 * bears[0] * bears[1], 1.0), ONE_FOOT_WEIGHT)
            self.across += seen * (left - right - self.across)
            self.middle += seen * (0.5 * (left + right) - self.middle)
            self.known += seen * (1.0 - self.known)
        follow = 1.0 - decay(MEASURE_HALF_LIFE_S)
        self.height = height if self.height == 0.0 else self.height + follow * (height - self.height)
        pitch, yaw, lift, bend = map(list, (self.pitch, self.yaw, self.lift, self.bend))
        for k, (leg, sign) in enumerate(zip(legs, (1.0, -1.0), strict=True)):
            lift[k] = max(leg.ankle[1] - request.ground - ANKLE_HEIGHT, lift[k] * decay(LIFT_HALF_LIFE_S))
            bend[k] = max(_bend(leg), bend[k] * decay(LIFT_HALF_LIFE_S))
            if bears[k] > 0.5:
                ahead = subtract(leg.toe, leg.ankle)
                turned = (atan2(ahead[0], ahead[2]) - request.yaw + pi) % (2.0 * pi) - pi
                pitch[k] += follow * (degrees(_heel_up(leg)) - pitch[k])
                yaw[k] += follow * (sign * degrees(turned) - yaw[k])
        self.pitch, self.yaw = (pitch[0], pitch[1]), (yaw[0], yaw[1])
        self.lift, self.bend = (lift[0], lift[1]), (bend[0], bend[1])

    def _follow(self, request: EditRequest) -> None:
        """Move the added amounts towards what is missing."""
        middle = self.middle * (1.0 - narrow(request.targets))  # `line` keeps narrow feet under the hips
        wanted = [self._missing(request.targets[k], k, middle) for k in (0, 1)]
        lower = min(wanted[0][LOWER], wanted[1][LOWER])  # one leg alone does not lower the hips
        for name, goal in zip(("left", "right"), wanted, strict=True):
            goal[LOWER] = lower
            goal[KNEE] *= max(1.0 - lower / BENT_M, 0.0)
            before = getattr(self, name)
            setattr(
                self,
                name,
                tuple(followed(a, b, ADDED_HALF_LIFE_S) for a, b in zip(before, goal, strict=True)),
            )

    def _missing(self, targets: Targets, leg: int, middle: float) -> list[float]:
        beside = (0.5 * self.across + (-middle if leg else middle)) / max(self.known, MIN_WEIGHT)
        shown = (beside, self.lowered, self.pitch[leg], self.yaw[leg], 0.0, 0.0)
        wanted = [
            limited(lacking(target, has), most)
            for target, has, most in zip(targets, shown, MAX_ADDED_OF_LEG, strict=False)
        ]
        wanted[OUTWARD] *= self.known
        wanted[LOWER] = max(wanted[LOWER], 0.0)
        most, bend = range_of(targets[KNEE])[1], self.bend[leg]
        stiffens = limited(max(bend - most, 0.0) / STIFFENING_DEGREES, 1.0)
        wanted[KNEE] = targets[KNEE][0] * limited(most, MAX_ADDED_OF_LEG[KNEE]) * stiffens
        lift, has = range_of(targets[LIFT])[1], self.lift[leg]
        wanted[LIFT] = targets[LIFT][0] * max(1.0 - lift / max(has, MIN_SEEN), 0.0)
        return wanted

    def _rise(
        self,
        up: float,
        feet: list[LegPose],
        moved: list[Vector],
        bears: tuple[float, float],
        spans: list[tuple[float, float]],
    ) -> float:
        """Hip displacement (metres, up) that keeps the bend of supporting legs with displaced feet, or straightens them."""
        total = rise = 0.0
        for foot, ankle, weight, (least, _) in zip(feet, moved, bears, spans, strict=True):
            hip = (foot.hip[0], foot.hip[1] + up, foot.hip[2])
            was, now = subtract(hip, foot.ankle), subtract(hip, ankle)
            height = sqrt(
                max(dot(was, was), least * least)
                - min(now[0] ** 2 + now[2] ** 2, dot(was, was) - MIN_SQUARED_RISE)
            )
            total, rise = total + weight, rise + weight * (height - now[1])
        rise = min(max(rise / max(total, 0.5), -MAX_RISE_M), MAX_RISE_M)
        self.rise += (rise - self.rise) * (1.0 - decay(RISE_HALF_LIFE_S))
        return self.rise


def _foot(leg: LegPose, sign: float, added: tuple[float, ...]) -> LegPose:
    """Return the leg with its foot rotated about the ankle, and its heel raised about the toe."""
    if added[TOE_OUT]:
        turn = _about(_UP, radians(sign * added[TOE_OUT]))
        toe = add(leg.ankle, rotate(turn, subtract(leg.toe, leg.ankle)))
        leg = leg._replace(foot=multiply(turn, leg.foot), toe=toe)
    if added[PITCH] > 0.0:
        leg = _about_toe(leg, radians(added[PITCH]))
    # first about the toe until the heel is down, then about the heel, on which the foot stands
    if added[PITCH] < 0.0:
        up = min(-radians(added[PITCH]), max(_heel_up(leg), 0.0))
        leg = _about_toe(leg, -up)
        turn = _about(rotate(leg.foot, (1.0, 0.0, 0.0)), up + radians(added[PITCH]))
        from_heel = rotate(leg.foot, _FROM_HEEL)
        ankle = add(subtract(leg.ankle, from_heel), rotate(turn, from_heel))
        toe = add(ankle, rotate(turn, subtract(leg.toe, leg.ankle)))
        leg = leg._replace(foot=multiply(turn, leg.foot), ankle=ankle, toe=toe)
    return leg


def _low(leg: LegPose, gone: float, ground: float) -> LegPose:
    """Return the leg with its foot lower and flatter, by a fraction of its height above the ground."""
    leg = _about_toe(leg, -gone * max(_heel_up(leg), 0.0))
    down = (0.0, -gone * max(leg.ankle[1] - ground - ANKLE_HEIGHT, 0.0), 0.0)
    return leg._replace(ankle=add(leg.ankle, down), toe=add(leg.toe, down))


def _bend(leg: LegPose) -> float:
    """Knee flexion in degrees."""
    thigh, shin, reach = dist(leg.knee, leg.hip), dist(leg.ankle, leg.knee), dist(leg.ankle, leg.hip)
    return degrees(acos(limited((reach * reach - thigh * thigh - shin * shin) / (2.0 * thigh * shin), 1.0)))


def _heel_up(leg: LegPose) -> float:
    """Pitch (radians) of the foot, heel up."""
    ahead = subtract(leg.toe, leg.ankle)
    return -atan2(ahead[1] + ANKLE_HEIGHT - TOE_HEIGHT, hypot(ahead[0], ahead[2]))


def _about_toe(leg: LegPose, up: float) -> LegPose:
    """Return the leg with its heel raised about the toe by `up` radians."""
    turn = _about(rotate(leg.foot, (1.0, 0.0, 0.0)), up)
    ankle = add(leg.toe, rotate(turn, subtract(leg.ankle, leg.toe)))
    return leg._replace(foot=multiply(turn, leg.foot), ankle=ankle)


def _straight(leg: LegPose, added: float, asked: Target) -> tuple[float, float]:
    """Minimum hip-ankle distance (m), standing and swinging, with flexion limited to `asked`; `added` degrees are in force."""
    if added <= 0.0:
        return 0.0, 0.0
    most = radians(min(range_of(asked)[1], MAX_KNEE_DEGREES))
    thigh, shin, reach = dist(leg.knee, leg.hip), dist(leg.ankle, leg.knee), dist(leg.ankle, leg.hip)
    stands, swings = (
        sqrt(thigh * thigh + shin * shin + 2.0 * thigh * shin * cos(bend))
        for bend in (min(most, STANDING_BEND_RAD), most)
    )
    weight = min(radians(added) / most, 1.0)
    return reach + weight * max(stands - reach, 0.0), reach + weight * max(swings - reach, 0.0)


def _straightened(
    leg: LegPose, up: float, ankle: Vector, straight: float, bears: float, request: EditRequest
) -> tuple[Vector, float]:
    """Return the ankle of a leg that spans at least `straight` metres, and its outward swing (m) where it would scuff.

    A leg that `bears` weight keeps its position.
    """
    hip = (leg.hip[0], leg.hip[1] + up, leg.hip[2])
    along = subtract(ankle, hip)
    reach = max(length(along), MIN_SIZE)
    target = add(hip, scale(along, max(straight / reach, 1.0)))
    floor = request.ground + ANKLE_HEIGHT + SWING_CLEARANCE_M
    floor += min(bears, 1.0) * min(ankle[1] - floor, 0.0)  # a standing foot keeps its height
    sunk, drop = max(floor - target[1], 0.0), hip[1] - target[1]
    # at constant length and position along the path, a leg that rises moves sideways
    aside = (1.0 - min(bears, 1.0)) * sqrt(max(drop * drop - (drop - sunk) ** 2, 0.0))
    return (target[0], target[1] + sunk, target[2]), min(aside, MAX_SIDESTEP_M)


def _toe_over(leg: LegPose, lowest: float, swings: float) -> LegPose:
    """Return the leg with its foot pitched so that the toe is at least at height `lowest`, while it swings."""
    ahead = subtract(leg.toe, leg.ankle)
    if ahead[1] >= lowest or swings <= 0.0:
        return leg
    long = length(ahead)
    turn = asin(max(min(lowest / long, 1.0), -1.0)) - asin(max(min(ahead[1] / long, 1.0), -1.0))
    up = _about(rotate(leg.foot, (1.0, 0.0, 0.0)), -swings * min(turn, MAX_TOE_UP_RAD))
    return leg._replace(foot=multiply(up, leg.foot), toe=add(leg.ankle, rotate(up, ahead)))


def _about(axis: Vector, angle: float) -> Quaternion:
    s = sin(0.5 * angle)
    return cos(0.5 * angle), s * axis[0], s * axis[1], s * axis[2]
