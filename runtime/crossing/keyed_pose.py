"""Key poses over an incoming pose: splines of keys, and limbs that inverse kinematics puts where the keys say.

A crossing's frame: x to the character's left, y up from the ground at its start, z along the way (metres). What no key
moves keeps the incoming pose's joint angles, so a style stays visible. Plain floats: see `runtime.feet.leg_scalar`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import acos, atan2, cos, pi, sin, sqrt

import numpy as np

from runtime.arrays import Array
from runtime.feet.leg_scalar import (
    LegPose,
    Quaternion,
    Vector,
    add,
    dot,
    from_vector,
    inverse,
    leg_bones,
    leg_forward,
    leg_inverse,
    length,
    multiply,
    relative,
    rotate,
    scale,
    soft_reach,
    subtract,
    unit,
)
from runtime.skeleton import SPORT_SKELETON

Arm = tuple[int, int, int, int]

LEGS = (leg_bones(0), leg_bones(1))
SPINE = tuple(SPORT_SKELETON.index(name) for name in ("LowerBack", "Spine", "Spine1"))
SPINE_SHARES = (0.4, 0.35, 0.25)  # of a lean: most of it low in the back
NECK = tuple(SPORT_SKELETON.index(name) for name in ("Neck", "Neck1"))
ARMS: tuple[Arm, Arm] = ((17, 18, 19, 20), (24, 25, 26, 27))  # shoulder, upper arm, forearm, hand
EASY_LEG_M, LEG_SLACK_M = 0.78, 0.035  # of a leg of 0.835 m
_OFFSETS: tuple[Vector, ...] = tuple((float(x), float(y), float(z)) for x, y, z in SPORT_SKELETON.offsets)


@dataclass(frozen=True)
class CrossingPose:
    """One frame of a crossing in its own frame."""

    hips: Array  # (3,) metres
    local: Array  # (31, 4) rotations relative to the parent; those of the hips are in the crossing's frame
    contacts: Array  # (4,) 0..1: left heel, left toe, right heel, right toe


class Track:
    """A curve through keys: cubic, without overshoot, at rest before the first and behind the last."""

    def __init__(self, keys: Sequence[Sequence[float]]) -> None:
        """`keys`: rows of a time in seconds, rising, and the values there."""
        rows = np.array(keys, np.float64)
        times, values = rows[:, 0], rows[:, 1:]
        gaps = np.diff(times)[:, None]
        slopes = np.diff(values, axis=0) / gaps
        tangents = np.zeros_like(values)
        before, behind = slopes[:-1], slopes[1:]
        # weighted harmonic mean (Fritsch and Butland): zero where the curve turns round, so that holds stay holds
        w1, w2 = 2.0 * gaps[1:] + gaps[:-1], gaps[1:] + 2.0 * gaps[:-1]
        same = before * behind > 0.0
        below = np.where(same, w1 * behind + w2 * before, 1.0)
        tangents[1:-1] = np.where(same, (w1 + w2) * before * behind / below, 0.0)
        self._times: list[float] = times.tolist()
        self._values: list[list[float]] = values.tolist()
        self._tangents: list[list[float]] = tangents.tolist()

    def at(self, t: float) -> list[float]:
        """The values at a time in seconds."""
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
    """How far (metres) to come nearer so that `distance` becomes at most `easy + slack`; begins without a kink."""
    over = max(distance - easy, 0.0)
    return over * over / (4.0 * slack) if over < 2.0 * slack else over - slack


def quaternions(local: Array) -> list[Quaternion]:
    """Rotations `(31, 4)` as tuples of floats."""
    return [(w, x, y, z) for w, x, y, z in np.asarray(local, np.float64).tolist()]


def slerp(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """From a (share 0) to b (1) along the shorter arc."""
    c = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = -1.0 if c < 0.0 else 1.0
    angle = acos(min(1.0, abs(c)))
    sine = sin(angle)
    p, q = (
        (1.0 - share, share) if sine < 1e-4 else (sin((1 - share) * angle) / sine, sin(share * angle) / sine)
    )
    w, x, y, z = (p * m + sign * q * n for m, n in zip(a, b, strict=True))
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return w * s, x * s, y * s, z * s


def bend_trunk(local: list[Quaternion], lean: float, twist: float, look: float) -> None:
    """Bend spine and neck in place (radians): forward, towards the left about the spine, and the face down."""
    for joint, share in zip(SPINE, SPINE_SHARES, strict=True):
        local[joint] = multiply(from_vector((share * lean, share * twist, 0.0)), local[joint])
    for joint in NECK:
        local[joint] = multiply(from_vector((0.5 * look, 0.0, 0.0)), local[joint])


def place_foot(
    local: list[Quaternion],
    side: int,
    hips: Vector,
    toe: Vector,
    foot: Quaternion,
    knee_out: float,
    free: float,
) -> Vector:
    """Bring one leg's toe joint to `toe` in place, its foot turned to `foot` (in the frame of `hips`).

    `knee_out` (radians) turns the knee outwards about the line from hip to ankle. A leg that
    is `free` (0..1) never gets straight: a knee that unlocks has any speed. Returns the knee's place.
    """
    bones = LEGS[side]
    leg = leg_forward(bones, hips, local)
    if knee_out:
        axis = unit(subtract(leg.ankle, leg.hip))
        turn = from_vector(scale(axis, knee_out if side else -knee_out))
        knee = add(leg.hip, rotate(turn, subtract(leg.knee, leg.hip)))
        thigh, shin = multiply(turn, leg.thigh), multiply(turn, leg.shin)
        leg = LegPose(leg.base, thigh, shin, leg.foot, leg.hip, knee, leg.ankle, leg.toe)
    ankle = subtract(toe, rotate(foot, bones.offsets[4]))
    way = subtract(leg.hip, ankle)
    away = length(way)
    ankle = add(ankle, scale(way, free * beyond(away, EASY_LEG_M, LEG_SLACK_M) / max(away, 1e-6)))
    solved = leg_inverse(leg, ankle, foot)
    for joint, rotation in zip(bones.joints[1:4], solved, strict=True):
        local[joint] = rotation
    return add(leg.hip, rotate(multiply(leg.base, solved[0]), bones.offsets[2]))


def shoulder_frame(local: list[Quaternion], side: int, hips: Vector) -> tuple[Quaternion, Vector]:
    """World rotation of a shoulder and the place of its upper arm, in the frame of `hips`."""
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
    """Bring one arm's wrist to `wrist` in place, its hand turned to `hand`, as far as `weight` says (0..1).

    The elbow points to `pole`. The forearm takes the hand's twist, as its two bones do.
    """
    base, place = shoulder_frame(local, side, hips)
    _, upper_joint, fore_joint, hand_joint = ARMS[side]
    a, b = length(_OFFSETS[fore_joint]), length(_OFFSETS[hand_joint])
    way = subtract(wrist, place)
    aim = unit(way)
    reach = max(soft_reach(length(way), a + b), abs(a - b) + 1e-3)
    out = unit(subtract(pole, scale(aim, dot(pole, aim))))
    c = min(1.0, max(-1.0, (a * a + reach * reach - b * b) / (2.0 * a * reach)))
    upper = add(scale(aim, c), scale(out, sqrt(1.0 - c * c)))
    fore = unit(subtract(scale(aim, reach), scale(upper, a)))
    flexed = unit(
        subtract(scale(out, -c), scale(aim, -sqrt(1.0 - c * c)))
    )  # across the upper arm, to the hand
    hinge = _cross(flexed, upper) if side == 0 else _cross(upper, flexed)
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


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _from_axes(x: Vector, y: Vector) -> Quaternion:
    """The rotation that turns +X into x and +Y into y, both of length one and perpendicular."""
    z = _cross(x, y)
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
