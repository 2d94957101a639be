"""Keyframed motion over an incoming pose: splined keys for pelvis, trunk, feet and hands, and IK that follows them.

A traversal's frame: x to the character's left, y up from the ground at its start, z along the path (metres). Joints
without keys keep the incoming pose's angles, so a style stays visible. Plain floats: see `runtime.scalar_math`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import acos, atan2, cos, pi, sin, sqrt

import numpy as np

from runtime.arrays import Array
from runtime.feet.leg import LegPose, leg_bones, leg_forward, leg_inverse, soft_reach, turned_out
from runtime.scalar_math import (
    MIN_SIZE,
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    from_vector,
    inverse,
    length,
    multiply,
    relative,
    rotate,
    scale,
    smoothstep,
    subtract,
    unit,
)
from runtime.skeleton import SPORT_SKELETON, TOE_HEIGHT

Arm = tuple[int, int, int, int]

LEGS = (leg_bones(0), leg_bones(1))
SPINE = tuple(SPORT_SKELETON.index(name) for name in ("LowerBack", "Spine", "Spine1"))
SPINE_FRACTIONS = (0.4, 0.35, 0.25)  # distribution of a lean: most of it low in the back
NECK = tuple(SPORT_SKELETON.index(name) for name in ("Neck", "Neck1"))
ARMS: tuple[Arm, Arm] = ((17, 18, 19, 20), (24, 25, 26, 27))  # shoulder, upper arm, forearm, hand
EASY_LEG_M, LEG_SLACK_M = 0.78, 0.035  # of a leg of 0.835 m
_OFFSETS: tuple[Vector, ...] = tuple((float(x), float(y), float(z)) for x, y, z in SPORT_SKELETON.offsets)
RIGHT_ANGLE_RAD = 1.5708
MIN_ARC_SINE = 1e-4  # a shorter arc is treated as a straight line
MIN_ARM_OPENING_M = 1e-3  # distance of the wrist from a fully folded arm's position
LEVEL_TOES_FRACTION = 0.7  # of a raised heel's pitch that the toes compensate; chosen by eye
CONTACT_CHANGE_FRACTION = 0.012  # of a motion, over which a contact changes; chosen by eye
MIN_HANGING_COSINE, HANGING_COSINE_WIDTH = 0.2, 0.6


@dataclass(frozen=True)
class TraversalPose:
    """A pose of a traversal, in the traversal's own frame."""

    hips: Array  # (3,) metres
    local: Array  # rotations relative to the parent; the hips' are in the traversal's frame
    contacts: Array  # (4,) 0..1: left heel, left toe, right heel, right toe


class Track:
    """A cubic spline through keys without overshoot, constant before the first and after the last key."""

    def __init__(self, keys: Sequence[Sequence[float]]) -> None:
        """`keys` are rows of a time in seconds, ascending, and the values at it."""
        rows = np.array(keys, np.float64)
        times, values = rows[:, 0], rows[:, 1:]
        gaps = np.diff(times)[:, None]
        slopes = np.diff(values, axis=0) / gaps
        tangents = np.zeros_like(values)
        before, behind = slopes[:-1], slopes[1:]
        # weighted harmonic mean (Fritsch and Butland): zero at extrema, so that held values stay constant
        w1, w2 = 2.0 * gaps[1:] + gaps[:-1], gaps[1:] + 2.0 * gaps[:-1]
        same = before * behind > 0.0
        below = np.where(same, w1 * behind + w2 * before, 1.0)
        tangents[1:-1] = np.where(same, (w1 + w2) * before * behind / below, 0.0)
        self._times: list[float] = times.tolist()
        self._values: list[list[float]] = values.tolist()
        self._tangents: list[list[float]] = tangents.tolist()

    def at(self, t: float) -> list[float]:
        """Return the interpolated values at `t` seconds."""
        k = bisect_right(self._times, t)
        if k == 0 or k == len(self._times):
            return self._values[min(k, len(self._times) - 1)]
        begin = self._times[k - 1]
        gap = self._times[k] - begin
        u = (t - begin) / gap
        v = 1.0 - u
        a, b = (1.0 + 2.0 * u) * v * v, u * u * (3.0 - 2.0 * u)
        c, d = gap * u * v * v, -gap * u * u * v
        rows = (self._values[k - 1], self._values[k], self._tangents[k - 1], self._tangents[k])
        return [a * p + b * q + c * m + d * n for p, q, m, n in zip(*rows, strict=True)]


def beyond(distance: float, easy: float, slack: float) -> float:
    """Return how far (metres) to shorten `distance` to at most `easy + slack`, with a smooth onset."""
    over = max(distance - easy, 0.0)
    return over * over / (4.0 * slack) if over < 2.0 * slack else over - slack


def quaternions(local: Array) -> list[Quaternion]:
    """Return rotations `(31, 4)` as tuples of floats."""
    return [(w, x, y, z) for w, x, y, z in np.asarray(local, np.float64).tolist()]


def slerp(a: Quaternion, b: Quaternion, fraction: float) -> Quaternion:
    """Interpolate spherically from a (fraction 0) to b (1) along the shorter arc."""
    c = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = -1.0 if c < 0.0 else 1.0
    angle = acos(min(1.0, abs(c)))
    sine = sin(angle)
    p, q = (
        (1.0 - fraction, fraction)
        if sine < MIN_ARC_SINE
        else (sin((1 - fraction) * angle) / sine, sin(fraction * angle) / sine)
    )
    w, x, y, z = (p * m + sign * q * n for m, n in zip(a, b, strict=True))
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return w * s, x * s, y * s, z * s


def bend_trunk(local: list[Quaternion], lean: float, twist: float, look: float) -> None:
    """Rotate spine and neck in place (radians): lean forward, twist to the left, and look down."""
    for joint, fraction in zip(SPINE, SPINE_FRACTIONS, strict=True):
        local[joint] = multiply(from_vector((fraction * lean, fraction * twist, 0.0)), local[joint])
    for joint in NECK:
        local[joint] = multiply(from_vector((0.5 * look, 0.0, 0.0)), local[joint])


def swing_arms(local: list[Quaternion], swing: float) -> None:
    """Swing hanging arms in place: radians, backwards if positive."""
    for _, upper, fore, _ in ARMS:
        down = -rotate(local[upper], _OFFSETS[fore])[1] / length(_OFFSETS[fore])
        hangs = smoothstep((down - MIN_HANGING_COSINE) / HANGING_COSINE_WIDTH)
        local[upper] = multiply(from_vector((swing * hangs, 0.0, 0.0)), local[upper])


def place_foot(
    local: list[Quaternion],
    side: int,
    hips: Vector,
    toe: Vector,
    foot: Quaternion,
    knee_out: float,
    free: float,
) -> Vector:
    """Bend one leg in place so that its toe joint is at `toe` and its foot has the rotation `foot`; return the knee's position.

    `knee_out` (radians) turns the knee outwards about the hip-ankle line. A leg that is `free` (0..1) never gets
    straight, since a straight knee bends at unlimited speed.
    """
    bones = LEGS[side]
    leg = leg_forward(bones, hips, local)
    if knee_out:
        leg = turned_out(leg, side, knee_out)
    ankle = subtract(toe, rotate(foot, bones.offsets[4]))
    way = subtract(leg.hip, ankle)
    away = length(way)
    ankle = add(ankle, scale(way, free * beyond(away, EASY_LEG_M, LEG_SLACK_M) / max(away, MIN_SIZE)))
    solved = leg_inverse(leg, ankle, foot)
    for joint, rotation in zip(bones.joints[1:4], solved, strict=True):
        local[joint] = rotation
    return add(leg.hip, rotate(multiply(leg.base, solved[0]), bones.offsets[2]))


def shoulder_frame(local: list[Quaternion], side: int, hips: Vector) -> tuple[Quaternion, Vector]:
    """Return the world rotation of a shoulder and the position of its upper arm, for hips at `hips`."""
    turn, place = local[0], hips
    for joint in (*SPINE, *ARMS[side][:2]):
        place = add(place, rotate(turn, _OFFSETS[joint]))
        if joint != ARMS[side][1]:
            turn = multiply(turn, local[joint])
    return turn, place


def place_hand(
    local: list[Quaternion],
    side: int,
    hips: Vector,
    wrist: Vector,
    pole: Vector,
    hand: Quaternion,
    weight: float,
) -> None:
    """Bend one arm in place so that its wrist is at `wrist` and its hand has the rotation `hand`, blended by `weight` (0..1).

    The elbow points towards `pole`. The forearm takes a part of the hand's twist, as its two bones do.
    """
    base, place = shoulder_frame(local, side, hips)
    _, upper_joint, fore_joint, hand_joint = ARMS[side]
    a, b = length(_OFFSETS[fore_joint]), length(_OFFSETS[hand_joint])
    way = subtract(wrist, place)
    aim = unit(way)
    reach = max(soft_reach(length(way), a + b), abs(a - b) + MIN_ARM_OPENING_M)
    out = unit(subtract(pole, scale(aim, dot(pole, aim))))
    c = min(1.0, max(-1.0, (a * a + reach * reach - b * b) / (2.0 * a * reach)))
    upper = add(scale(aim, c), scale(out, sqrt(1.0 - c * c)))
    fore = unit(subtract(scale(aim, reach), scale(upper, a)))
    # across the upper arm, towards the hand
    flexed = unit(subtract(scale(out, -c), scale(aim, -sqrt(1.0 - c * c))))
    hinge = cross(flexed, upper) if side == 0 else cross(upper, flexed)
    x = 1.0 if side == 0 else -1.0
    upper_world = _from_axes(scale(upper, x), hinge)
    fore_world = _from_axes(scale(fore, x), hinge)
    turned = multiply(inverse(fore_world), hand)
    half = atan2(turned[1], turned[0])
    if half > 0.5 * pi:
        half -= pi
    elif half < -0.5 * pi:
        half += pi
    fore_world = multiply(fore_world, (cos(half), sin(half), 0.0, 0.0))
    solved = (relative(base, upper_world), relative(upper_world, fore_world), relative(fore_world, hand))
    for joint, rotation in zip((upper_joint, fore_joint, hand_joint), solved, strict=True):
        local[joint] = slerp(local[joint], rotation, weight)


def _from_axes(x: Vector, y: Vector) -> Quaternion:
    """Return the rotation that turns +X into x and +Y into y, which are perpendicular unit vectors."""
    z = cross(x, y)
    xx, yy, zz = x[0], y[1], z[2]
    if xx + yy + zz > 0.0:
        q = (1.0 + xx + yy + zz, y[2] - z[1], z[0] - x[2], x[1] - y[0])
    elif xx >= yy and xx >= zz:
        q = (y[2] - z[1], 1.0 + xx - yy - zz, y[0] + x[1], z[0] + x[2])
    elif yy >= zz:
        q = (z[0] - x[2], y[0] + x[1], 1.0 - xx + yy - zz, z[1] + y[2])
    else:
        q = (x[1] - y[0], z[0] + x[2], z[1] + y[2], 1.0 - xx - yy + zz)
    s = 1.0 / sqrt(sum(c * c for c in q))
    return q[0] * s, q[1] * s, q[2] * s, q[3] * s


Rows = list[tuple[float, ...]]

LEAD, TRAIL = 1, 0  # the right foot leads
STANDING_HIPS_M = 0.97  # pelvis height in the middle of a traversal, before its keys
EASY_REACH_M, SLACK_M = 0.44, 0.03  # of an arm of 0.478 m
KNEE_CLEAR_M = 0.06  # of a knee from a wall
KNEE_TURN_RAD_PER_M, MAX_KNEE_OUT_RAD = 6.0, 1.25  # outwards, per metre inside the wall; limit
MAX_PULL_M = 0.12  # of the pelvis towards a hand
FADE_S = 0.25  # at both ends: IK takes over from the incoming legs


@dataclass(frozen=True)
class KeyframedMotion:
    """A keyframed motion as tracks over time, in metres and radians of the traversal's frame; in pairs the left side is first.

    A foot's position is a weighted sum of its incoming positions at start and end, plus an offset, so that it lands in
    the style's own stance.
    """

    seconds: float
    start_z: float
    end_z: float
    rise: float
    root: Track  # z of the pelvis
    body: Track  # pelvis: x, height over the incoming one, pitch, yaw, roll; spine: lean, twist; looking down
    level: Track  # weight of `STANDING_HIPS_M` against the incoming pelvis height
    feet: tuple[
        Track, Track
    ]  # weight of the start, of the end; toe joint x, y, z; heel over toe, knee outwards
    stands: tuple[Track, Track]  # contact of heel, of toe
    arms: Track  # backward swing, radians
    hands: tuple[Track, Track]  # weight, wrist x, y, z, hand turned inwards, fingers down
    elbows: tuple[Vector, Vector]  # directions in which they point

    def pose(self, t: float, hips: Array, local: Array) -> TraversalPose:
        """Return the pose at `t` seconds (tempo 1) for the incoming `hips` `(3,)` and `local` `(31, 4)`."""
        incoming = quaternions(local)
        x, y, z = (float(c) for c in hips)
        mine = list(incoming)
        dx, dy, pitch, yaw, roll, lean, twist, look = self.body.at(t)
        level = self.level.at(t)[0]
        mine[0] = multiply(from_vector((pitch, yaw, roll)), mine[0])
        bend_trunk(mine, lean, twist, look)
        swing_arms(mine, self.arms.at(t)[0])
        hands = [track.at(t) for track in self.hands]
        place = self._within_reach((x + dx, y + level * (STANDING_HIPS_M - y) + dy, z), mine, hands)
        fraction = smoothstep(min(t, self.seconds - t) / FADE_S)
        for side in (0, 1):
            leg = leg_forward(LEGS[side], (x, y, z), incoming)
            self._foot(t, side, leg, z, place, mine)
            if fraction < 1.0:
                self._keep_angles(side, leg, (x, y, z), incoming, mine, 1.0 - fraction)
            if hands[side][0] > 0.0:
                weight, *wrist, inward, down = hands[side]
                turn = flat_hand(side, inward, down)
                at = (wrist[0], wrist[1], wrist[2])
                place_hand(mine, side, place, at, self.elbows[side], turn, weight)
        contacts = [c for stand in self.stands for c in stand.at(t)]
        return TraversalPose(np.array(place), np.array(mine), np.array(contacts))

    def _foot(
        self, t: float, side: int, leg: LegPose, root: float, place: Vector, mine: list[Quaternion]
    ) -> None:
        start, end, x, y, z, heel, out = self.feet[side].at(t)
        both = start + end
        toe = (
            both * leg.toe[0] + x,
            # it lands on the ground, although the network's body may hover above
            start * leg.toe[1] + end * (min(leg.toe[1], TOE_HEIGHT) + self.rise) + y,
            start * (leg.toe[2] - root + self.start_z) + end * (leg.toe[2] - root + self.end_z) + z,
        )
        bend = from_vector((heel, 0.0, 0.0))
        foot = multiply(leg.foot, bend)
        free = 1.0 - self.stands[side].at(t)[1]
        before = list(mine)
        knee = place_foot(mine, side, place, toe, foot, out, free)
        under = smoothstep((self.rise + 2.0 * KNEE_CLEAR_M - knee[1]) / (2.0 * KNEE_CLEAR_M))
        inside = (knee[2] + KNEE_CLEAR_M) * under
        if inside > 0.0:
            mine[:] = before
            out = max(out, min(out + KNEE_TURN_RAD_PER_M * inside, MAX_KNEE_OUT_RAD))
            place_foot(mine, side, place, toe, foot, out, free)
        toes = LEGS[side].joints[4]  # toes stay flat under a raised heel
        mine[toes] = multiply(from_vector((-LEVEL_TOES_FRACTION * max(heel, 0.0), 0.0, 0.0)), mine[toes])

    def _keep_angles(
        self,
        side: int,
        leg: LegPose,
        hips: Vector,
        incoming: list[Quaternion],
        mine: list[Quaternion],
        fraction: float,
    ) -> None:
        """Undo, in place, a fraction of the change that IK alone makes to a leg at the incoming pose."""
        solved = list(incoming)
        place_foot(solved, side, hips, leg.toe, leg.foot, 0.0, 0.0)
        for joint in LEGS[side].joints[1:4]:
            change = multiply(inverse(solved[joint]), incoming[joint])
            mine[joint] = multiply(mine[joint], slerp((1.0, 0.0, 0.0, 0.0), change, fraction))

    def _within_reach(self, place: Vector, mine: list[Quaternion], hands: list[list[float]]) -> Vector:
        """Return the pelvis position moved to within reach of the hands' targets, by more for hands of higher weight."""
        for side in (0, 1):
            weight, x, y, z = hands[side][:4]
            if weight > 0.0:
                way = subtract((x, y, z), shoulder_frame(mine, side, place)[1])
                wanted = length(way)
                over = min(beyond(wanted, EASY_REACH_M, SLACK_M), MAX_PULL_M)
                place = add(place, scale(way, weight * over / max(wanted, MIN_SIZE)))
        return place


def flat_hand(side: int, inward: float, down: float) -> Quaternion:
    """Return the world rotation of a hand (0 left, 1 right), palm down, with fingers turned inwards and down (radians)."""
    half = 0.5 * (RIGHT_ANGLE_RAD + inward) * (-1.0 if side == 0 else 1.0)
    turn = (cos(half), 0.0, sin(half), 0.0)
    return multiply(from_vector((down, 0.0, 0.0)), turn)


def timed(rows: Rows, seconds: float) -> Track:
    """Return a track from rows whose times are fractions of `seconds`."""
    return Track([(row[0] * seconds, *row[1:]) for row in rows])


def both_sides(lead: Rows, trail: Rows, seconds: float) -> tuple[Track, Track]:
    """Return the tracks of the left and right foot from those of the leading and the trailing one."""
    tracks = {LEAD: timed(lead, seconds), TRAIL: timed(trail, seconds)}
    return tracks[0], tracks[1]


def stands(
    begin: float,
    heel_off: float,
    toe_off: float | None = None,
    whole: float = 1.0,
    heel_on: float | None = None,
) -> Rows:
    """Return the contact keys of heel and toe for a standing foot; the heel may land later and lift earlier than the toe."""
    toe_off = heel_off if toe_off is None else toe_off
    soon = CONTACT_CHANGE_FRACTION * whole
    rows: Rows = [] if begin == 0 else [(begin - soon, 0, 0)]
    if heel_on is not None:
        rows += [(begin, 0, 1), (heel_on, 0, 1), (heel_on + soon, 1, 1), (heel_off, 1, 1)]
    elif heel_off > begin:
        rows += [(begin, 1, 1), (heel_off, 1, 1)]
    if toe_off > heel_off:
        rows += [(heel_off + soon, 0, 1), (toe_off, 0, 1)]
    return rows if toe_off >= whole else [*rows, (toe_off + soon, 0, 0)]
