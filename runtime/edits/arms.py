"""Arm edits: elbow bend, arm swing and hand placement that a prompt asks for and the network's walk lacks.

Elbow and swing edits measure the network's own arm as it moves and add what is missing. A hand outside its requested
place is brought to the edge of that place; within the place the network's own movement is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import acos, asin, atan2, cos, degrees, hypot, pi, radians, sin, sqrt
from typing import NamedTuple

from runtime.edits.request import (
    ARM,
    FRAMES,
    MIN_ADDED,
    MIN_SEEN,
    MIN_WEIGHT,
    PLACE,
    Swing,
    Target,
    Targets,
    asks,
    followed,
    least_of,
    limited,
    range_of,
)
from runtime.measures.table import targets_of
from runtime.scalar_math import (
    MIN_SIZE,
    Quaternion,
    Vector,
    add,
    add_scaled,
    between,
    cross,
    dot,
    from_vector,
    inverse,
    length,
    multiply,
    perpendicular,
    relative,
    rotate,
    scale,
    smoothstep,
    subtract,
    to_vector,
    unit,
)
from runtime.skeleton import SPORT_SKELETON

ELBOW, OUT, SWING = range(len(ARM))
MEAN_HALF_LIFE_S, RANGE_HALF_LIFE_S = 0.4, 0.6  # of the measures
ADDED_HALF_LIFE_S = 0.25  # of the added amounts
LIMITS_DEG = tuple(row.most for row in targets_of("arm").values())  # limits for elbow and shoulder
# times the arm's own swing: limit of the added swing; the rest follows the opposite leg
MAX_SWING_GAIN = 2.5
MIN_SWING_M = 0.06  # an arm that swings less has no rhythm of its own
MIN_STRIDE_M = 0.15  # peak to peak: a leg that swings less gives no rhythm
# metres below the shoulder, from which an arm swings; fully when lower by the second
RAISED_HAND_M, LOWERED_HAND_M = 0.05, 0.1
MAX_SWING_SINE = 0.95  # of the angle to straight down, forward and back
# weights of the elbow's own axis and of the place's, for a straight arm
OWN_HINGE_WEIGHT, POLE_WEIGHT = 0.2, 0.02
MAX_BEND_RAD = radians(150.0)
FAR_HAND_M = 0.15  # a hand from farther away gets the elbow direction of its place
# an elbow off its direction by more than the first is turned there, eased over the second
ELBOW_TOLERANCE_RAD, ELBOW_EASE_RAD = radians(30.0), radians(40.0)
WRIST_STRAIGHTENING_FRACTION = 0.7  # of the wrist's straightening at a place
# metres from the trunk's axis to its surface, for a wrist
TRUNK_HALF_WIDTH_M, TRUNK_HALF_DEPTH_M = 0.165, 0.13
TRUNK_BOTTOM_M, TRUNK_TOP_M = -0.12, 0.32  # from the hips up the trunk: range of this surface
SHOULDER_HEIGHT_M = 0.5  # up the trunk: below it a palm lies on it
TRUNK_EASE_M = 0.06  # over which it fades in at these heights
MIN_TRUNK_RADIUS = 1e-3  # of its radii: a wrist nearer to the axis leaves to its own side
# outward against forward: behind, a palm does not lie on the trunk
MAX_BEHIND_COSINE, BEHIND_EASE_RATIO = 0.9, 0.3
TOUCH_RADII = 1.4, 1.8  # of the trunk, within which a palm lies on it fully, and beyond which not at all
HEAD_MIDDLE: Vector = (0.0, 0.09, 0.02)  # from the joint of the head
# metres from there within which a palm lies on it fully, and beyond which it does not
HEAD_RADIUS = 0.17, 0.22
MAX_TWIST_RAD, MAX_FLEXION_RAD = radians(80.0), radians(60.0)  # limits of forearm twist and wrist flexion
_LENGTHS = tuple(
    abs(float(SPORT_SKELETON.offsets[SPORT_SKELETON.index(n)][0])) for n in ("LeftForeArm", "LeftHand")
)
_MAX_REACH_M, _MIN_REACH_M = 0.995 * sum(_LENGTHS), 0.12  # from the shoulder
_SHOULDER = len(ARM)
_NOWHERE = (0.0,) * (len(FRAMES) * (1 + len(PLACE)))


class Axes(NamedTuple):
    """Position and rotation of a joint used as the reference frame for a hand."""

    at: Vector
    turned: Quaternion


class ArmPose(NamedTuple):
    """World rotations and positions of one arm; `sign` is 1 for the left arm, -1 for the right."""

    sign: float
    collar: Quaternion
    upper: Quaternion
    lower: Quaternion
    hand: Quaternion  # relative to the forearm
    shoulder: Vector
    elbow: Vector
    wrist: Vector


class Body(NamedTuple):
    """Inputs of an arm edit: reference frames for the hands, directions, and the stride (metres of the opposite ankle ahead)."""

    axes: tuple[Axes, ...]  # by `FRAMES`; of the first only the rotation is used
    side: Vector  # towards the left
    ahead: Vector
    stride: float


@dataclass
class ArmEdit:
    """State of one arm's edits: measured bend, spread and swing of the network's arm, and the added amounts."""

    bend: Swing = field(default_factory=Swing)  # degrees of elbow flexion
    out: Swing = field(default_factory=Swing)  # metres of the elbow outward from the shoulder
    swing: Swing = field(default_factory=Swing)  # metres of the hand ahead of the shoulder
    stride: Swing = field(default_factory=Swing)  # metres of the opposite ankle ahead of the hips
    more_bend: float = 0.0  # added degrees
    more_out: float = 0.0
    more_swing: float = 0.0  # added, relative to the arm's own
    in_step: float = 0.0  # peak-to-peak metres added in phase with the leg
    places: tuple[float, ...] = _NOWHERE  # by `FRAMES`: the current weight, and `PLACE`

    @property
    def active(self) -> bool:
        """Whether the edit currently changes the arm."""
        most = max(abs(self.more_bend), abs(self.more_out), abs(self.more_swing))
        return most > MIN_SEEN or max(abs(self.in_step), self._placed) > MIN_ADDED

    @property
    def _placed(self) -> float:
        return sum(self.places[:: 1 + len(PLACE)])

    def apply(self, arm: ArmPose, body: Body, targets: Targets) -> ArmPose | None:
        """Return the edited arm, or None if nothing is requested and nothing is fading out."""
        if not self.active and not asks(targets):
            if self.bend.known > 0.0:
                vars(self).update(vars(ArmEdit()))  # a later request starts from new measurements
            return None
        self._observe(arm, body)
        self._follow(targets)
        placed = min(self._placed, 1.0)
        if placed < 1.0:
            arm = self._swung(arm, body, 1.0 - placed)
            if self.more_bend:
                arm = _bent(arm, radians((1.0 - placed) * self.more_bend))
        return self._put(arm, body, placed) if placed > 0.0 else arm

    def _observe(self, arm: ArmPose, body: Body) -> None:
        halves = MEAN_HALF_LIFE_S, RANGE_HALF_LIFE_S
        reach, upper = subtract(arm.wrist, arm.shoulder), subtract(arm.elbow, arm.shoulder)
        self.bend = self.bend.observed(degrees(_flexion(arm)), *halves)
        self.out = self.out.observed(arm.sign * dot(upper, body.side), *halves)
        self.swing = self.swing.observed(dot(reach, body.ahead), *halves)
        self.stride = self.stride.observed(body.stride, *halves)

    def _follow(self, targets: Targets) -> None:
        """Move the added amounts towards what is missing."""
        known = self.bend.known
        bend = _lacking(targets[ELBOW], self.bend.middle)
        self.more_bend = followed(self.more_bend, known * limited(bend, LIMITS_DEG[ELBOW]), ADDED_HALF_LIFE_S)
        angle = _lacking(targets[OUT], self.out.middle, _raised)
        self.more_out = followed(self.more_out, known * limited(angle, LIMITS_DEG[OUT]), ADDED_HALF_LIFE_S)
        gain, swing = self.swing.gain(targets[SWING], MIN_SWING_M, MAX_SWING_GAIN), targets[SWING]
        rest = swing[0] * known * max(range_of(swing)[0] - self.swing.range * (1.0 + gain), 0.0)
        self.more_swing = followed(self.more_swing, gain, ADDED_HALF_LIFE_S)
        self.in_step = followed(self.in_step, rest, ADDED_HALF_LIFE_S)
        places: list[float] = []
        for frame in range(len(FRAMES)):
            first, now = _SHOULDER + frame * len(PLACE), frame * (1 + len(PLACE))
            weight, *place = self.places[now : now + 1 + len(PLACE)]
            wanted = targets[first][0]
            if wanted > MIN_WEIGHT:
                goal = [least_of(target) for target in targets[first : first + len(PLACE)]]
                moved = [followed(a, b, ADDED_HALF_LIFE_S) for a, b in zip(place, goal, strict=True)]
                place = goal if weight < MIN_SEEN else moved
            places += [followed(weight, wanted, ADDED_HALF_LIFE_S), *place]
        self.places = tuple(places) if any(places[:: 1 + len(PLACE)]) else _NOWHERE

    def _swung(self, arm: ArmPose, body: Body, weight: float) -> ArmPose:
        """Return the arm rotated about its shoulder: outward, and forward and back."""
        if self.more_out:
            turn = from_vector(scale(body.ahead, arm.sign * weight * radians(self.more_out)))
            arm = _turned(arm, turn)
        if not self.more_swing and not self.in_step:
            return arm
        reach = subtract(arm.wrist, arm.shoulder)
        ahead, down = dot(reach, body.ahead), -reach[1]
        step = max(self.stride.range, MIN_STRIDE_M)
        more = (
            self.more_swing * (ahead - self.swing.middle)
            + self.in_step * (body.stride - self.stride.middle) / step
        )
        radius = max(hypot(ahead, down), MIN_SEEN)
        weight *= smoothstep((down - RAISED_HAND_M) / LOWERED_HAND_M)
        angle = asin(limited((ahead + more) / radius, MAX_SWING_SINE)) - asin(
            limited(ahead / radius, MAX_SWING_SINE)
        )
        return _turned(arm, from_vector(scale(body.side, -weight * angle)))

    def _put(self, arm: ArmPose, body: Body, placed: float) -> ArmPose:
        """Return the arm with its hand at its places and the elbow in their direction."""
        moved: Vector = (0.0, 0.0, 0.0)
        pole: Vector = (0.0, 0.0, 0.0)
        total = max(self._placed, 1.0)
        for frame, axes in enumerate(body.axes):
            now = frame * (1 + len(PLACE))
            weight, x, y, z, px, py, pz, near = self.places[now : now + 1 + len(PLACE)]
            if weight <= 0.0:
                continue
            at = arm.shoulder if frame == 0 else axes.at
            away = subtract(add(at, rotate(axes.turned, (arm.sign * x, y, z))), arm.wrist)
            share = weight / total * max(1.0 - near / max(length(away), MIN_SIZE), 0.0)
            moved = add_scaled(moved, away, share)
            # the elbow direction is relative to the trunk, or to the facing direction if the hand's place is
            points = body.axes[0 if frame == 0 else 2].turned
            pole = add_scaled(pole, rotate(points, (arm.sign * px, py, pz)), weight)
        wrist = add(arm.wrist, moved)
        wrist = add_scaled(wrist, _out_of_trunk(wrist, arm.sign, body), placed)
        return _laid(_reached(arm, wrist, pole, placed, smoothstep(length(moved) / FAR_HAND_M)), body, placed)


def _lacking(target: Target, has: float, angle: Callable[[float], float] = float) -> float:
    """Return how far a measure is outside its range, times its weight, in an `angle` that grows with the measure."""
    low, high = range_of(target)
    return target[0] * (max(angle(low) - angle(has), 0.0) + min(angle(high) - angle(has), 0.0))


def _raised(outward: float) -> float:
    """Elevation (degrees) of an upper arm whose elbow is `outward` metres from the shoulder."""
    return degrees(asin(limited(outward / _LENGTHS[0], 1.0)))


def _flexion(arm: ArmPose) -> float:
    upper, lower = unit(subtract(arm.elbow, arm.shoulder)), unit(subtract(arm.wrist, arm.elbow))
    return acos(limited(dot(upper, lower), 1.0))


def _turned(arm: ArmPose, turn: Quaternion) -> ArmPose:
    """Return the arm rotated about its shoulder."""
    at = arm.shoulder
    elbow, wrist = (add(at, rotate(turn, subtract(p, at))) for p in (arm.elbow, arm.wrist))
    turned = multiply(turn, arm.upper), multiply(turn, arm.lower)
    return ArmPose(arm.sign, arm.collar, *turned, arm.hand, at, elbow, wrist)


def _hinge(arm: ArmPose) -> Vector:
    """Return the elbow axis: normal to the arm's bending plane, or the joint's own axis for a straight arm."""
    upper, lower = unit(subtract(arm.elbow, arm.shoulder)), unit(subtract(arm.wrist, arm.elbow))
    own = rotate(arm.upper, (0.0, -arm.sign, 0.0))
    return unit(add_scaled(cross(upper, lower), own, OWN_HINGE_WEIGHT))


def _bent(arm: ArmPose, more: float) -> ArmPose:
    """Return the arm with its elbow bent by `more` radians."""
    now = _flexion(arm)
    turn = from_vector(scale(_hinge(arm), min(max(now + more, 0.0), max(MAX_BEND_RAD, now)) - now))
    wrist = add(arm.elbow, rotate(turn, subtract(arm.wrist, arm.elbow)))
    return arm._replace(lower=multiply(turn, arm.lower), wrist=wrist)


def _reached(arm: ArmPose, wrist: Vector, pole: Vector, placed: float, far: float) -> ArmPose:
    """Return the arm by two-bone IK with its wrist at `wrist`; the elbow keeps its side, or points to `pole`."""
    a, b = _LENGTHS
    to = subtract(wrist, arm.shoulder)
    reach = min(max(length(to), _MIN_REACH_M), _MAX_REACH_M)
    axis, before = unit(to), unit(subtract(arm.wrist, arm.shoulder))
    swing = between(before, axis)
    own = rotate(swing, perpendicular(subtract(arm.elbow, arm.shoulder), before))
    wanted = unit(perpendicular(pole, axis))
    own = unit(add_scaled(own, wanted, POLE_WEIGHT))  # a straight arm bends in the direction of the place
    angle = atan2(dot(cross(own, wanted), axis), dot(own, wanted))
    turns = placed * max(far, smoothstep((abs(angle) - ELBOW_TOLERANCE_RAD) / ELBOW_EASE_RAD))
    bend = rotate(from_vector(scale(axis, turns * angle)), own)
    c = limited((a * a + reach * reach - b * b) / (2.0 * a * reach), 1.0)
    elbow = add(arm.shoulder, add_scaled(scale(axis, a * c), bend, a * sqrt(1.0 - c * c)))
    wrist = add_scaled(arm.shoulder, axis, reach)
    along = unit(subtract(elbow, arm.shoulder))
    upper = multiply(between(unit(subtract(arm.elbow, arm.shoulder)), along), arm.upper)
    upper = multiply(_twist(arm, upper, elbow, wrist, placed * far), upper)
    bone: Vector = (arm.sign, 0.0, 0.0)
    lower = multiply(upper, relative(arm.upper, arm.lower))
    lower = multiply(between(unit(rotate(lower, bone)), unit(subtract(wrist, elbow))), lower)
    hand = _towards(arm.hand, (1.0, 0.0, 0.0, 0.0), WRIST_STRAIGHTENING_FRACTION * placed * far)
    return arm._replace(upper=upper, lower=lower, hand=hand, elbow=elbow, wrist=wrist)


def _twist(arm: ArmPose, upper: Quaternion, elbow: Vector, wrist: Vector, weight: float) -> Quaternion:
    """Return a twist of the upper arm, by `weight` of that at which the elbow bends as a hinge."""
    along = unit(subtract(elbow, arm.shoulder))
    wanted = unit(cross(along, unit(subtract(wrist, elbow))))
    own = perpendicular(rotate(upper, (0.0, -arm.sign, 0.0)), along)
    angle = atan2(dot(cross(own, wanted), along), dot(own, wanted))
    return from_vector(scale(along, weight * angle))


class _Trunk(NamedTuple):
    """Position of a wrist relative to the trunk: metres to the side, ahead, and up from the hips, with these axes."""

    x: float
    z: float
    high: float
    side: Vector
    ahead: Vector

    @property
    def radii(self) -> float:
        """Distance from the trunk's axis, in radii of its ellipse: 1 on the surface."""
        return hypot(self.x / TRUNK_HALF_WIDTH_M, self.z / TRUNK_HALF_DEPTH_M)


def _by_trunk(wrist: Vector, body: Body) -> _Trunk:
    hips, chest = body.axes[1], body.axes[2]
    side, ahead = rotate(chest.turned, (1.0, 0.0, 0.0)), rotate(chest.turned, (0.0, 0.0, 1.0))
    away = subtract(wrist, hips.at)
    return _Trunk(
        dot(away, side), dot(away, ahead), dot(away, unit(subtract(chest.at, hips.at))), side, ahead
    )


def _out_of_trunk(wrist: Vector, sign: float, body: Body) -> Vector:
    """Return the direction out of the trunk for a wrist inside it; zero for one outside."""
    trunk = _by_trunk(wrist, body)
    level = smoothstep((trunk.high - TRUNK_BOTTOM_M) / TRUNK_EASE_M) * smoothstep(
        (TRUNK_TOP_M - trunk.high) / TRUNK_EASE_M
    )
    x, z, deep = trunk.x, trunk.z, trunk.radii
    if level <= 0.0 or deep >= 1.0:
        return (0.0, 0.0, 0.0)
    if deep < MIN_TRUNK_RADIUS:
        x, deep = sign * MIN_TRUNK_RADIUS * TRUNK_HALF_WIDTH_M, MIN_TRUNK_RADIUS
    out = level * (1.0 / deep - 1.0)
    return add_scaled(scale(trunk.side, out * x), trunk.ahead, out * z)


def _touched(arm: ArmPose, body: Body) -> tuple[float, Vector, Vector]:
    """Return the weight of a palm lying on trunk or head, the surface normal there, and the preferred finger direction."""
    head = body.axes[3]
    middle = add(head.at, rotate(head.turned, HEAD_MIDDLE))
    from_head = subtract(arm.wrist, middle)
    on_head = smoothstep((HEAD_RADIUS[1] - length(from_head)) / (HEAD_RADIUS[1] - HEAD_RADIUS[0]))
    if on_head > 0.0:
        return on_head, unit(from_head), rotate(head.turned, (-arm.sign, 0.0, 0.0))
    trunk = _by_trunk(arm.wrist, body)
    level = smoothstep((trunk.high - TRUNK_BOTTOM_M) / TRUNK_EASE_M) * smoothstep(
        (SHOULDER_HEIGHT_M - trunk.high) / TRUNK_EASE_M
    )
    near = smoothstep((TOUCH_RADII[1] - trunk.radii) / (TOUCH_RADII[1] - TOUCH_RADII[0]))
    out = unit(
        add_scaled(
            scale(trunk.side, trunk.x / TRUNK_HALF_WIDTH_M**2), trunk.ahead, trunk.z / TRUNK_HALF_DEPTH_M**2
        )
    )
    # behind the back it is the back of the hand that touches
    before = smoothstep((dot(out, trunk.ahead) + MAX_BEHIND_COSINE) / BEHIND_EASE_RATIO)
    return level * near * before, out, subtract(trunk.ahead, (0.0, 0.5, 0.0))


def _laid(arm: ArmPose, body: Body, placed: float) -> ArmPose:
    """Return the arm with its palm on the touched surface and the fingers along it; the forearm takes half of the turn."""
    weight, out, ahead = _touched(arm, body)
    weight *= placed
    if weight <= 0.0:
        return arm
    along = rotate(arm.lower, (arm.sign, 0.0, 0.0))
    fingers = unit(perpendicular(add_scaled(along, ahead, 0.5), out))
    goal = multiply(between(along, fingers), arm.lower)
    palm = rotate(goal, (0.0, -1.0, 0.0))
    angle = atan2(-dot(cross(palm, out), fingers), -dot(palm, out))
    w, x, y, z = relative(arm.lower, multiply(from_vector(scale(fingers, angle)), goal))
    twist = 2.0 * atan2(x, w)
    twist -= 2.0 * pi * round(twist / (2.0 * pi))
    turned = _about_bone(limited(twist, MAX_TWIST_RAD))
    flexed = _shortened(multiply((w, x, y, z), _about_bone(-twist)), MAX_FLEXION_RAD)
    forearm = _about_bone(weight * 0.5 * limited(twist, MAX_TWIST_RAD))
    hand = _towards(arm.hand, multiply(flexed, turned), weight)
    return arm._replace(lower=multiply(arm.lower, forearm), hand=multiply(inverse(forearm), hand))


def _about_bone(angle: float) -> Quaternion:
    return cos(0.5 * angle), sin(0.5 * angle), 0.0, 0.0


def _shortened(q: Quaternion, most: float) -> Quaternion:
    """Return a rotation limited to `most` radians."""
    vector = to_vector(q)
    return from_vector(scale(vector, min(1.0, most / max(length(vector), MIN_SIZE))))


def _towards(a: Quaternion, b: Quaternion, weight: float) -> Quaternion:
    """Interpolate from a to b by `weight`."""
    return multiply(a, from_vector(scale(to_vector(relative(a, b)), weight)))
