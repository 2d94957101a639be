"""One leg in plain floats: forward kinematics and two-bone IK for the per-frame path.

A NumPy call on three numbers costs as much as fifty multiplications in Python; a foot lock makes hundreds of
them in a frame. `runtime.feet.ik` is the same mathematics on arrays, and the tests hold the two together.
Vectors are (x, y, z) and quaternions (w, x, y, z) tuples.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt
from typing import NamedTuple

from runtime.feet.ik import EASE_REACH, MAX_REACH, MIN_REACH, POLE_WEIGHT_M
from runtime.skeleton import SPORT_SKELETON, Skeleton

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class LegBones(NamedTuple):
    """Joint indices and offsets (metres) of one leg."""

    joints: tuple[int, int, int, int, int]  # hip joint, thigh, shin, foot, toe
    offsets: tuple[Vector, Vector, Vector, Vector, Vector]
    length: float  # thigh and shin
    foot_length: float  # ankle to toe joint


class LegPose(NamedTuple):
    """World rotations and positions of one leg."""

    base: Quaternion  # of the hip joint
    thigh: Quaternion
    shin: Quaternion
    foot: Quaternion
    hip: Vector
    knee: Vector
    ankle: Vector
    toe: Vector

    def raised(self, metres: float) -> Vector:
        """Where the hip is with the body raised."""
        return self.hip[0], self.hip[1] + metres, self.hip[2]


def leg_bones(side: int, skeleton: Skeleton = SPORT_SKELETON) -> LegBones:
    """The left (0) or right (1) leg of a SPORT skeleton."""
    first = 1 + 5 * side
    joints = (first, first + 1, first + 2, first + 3, first + 4)
    offsets = tuple((float(x), float(y), float(z)) for x, y, z in skeleton.offsets[list(joints)])
    reach = length(offsets[2]) + length(offsets[3])
    return LegBones(joints, offsets, reach, length(offsets[4]))  # type: ignore[arg-type]


def leg_forward(bones: LegBones, hips: Vector, local: list[Quaternion]) -> LegPose:
    """Forward kinematics; `local` holds the pose's 31 local rotations."""
    j, o = bones.joints, bones.offsets
    root = local[0]
    base = multiply(root, local[j[0]])
    thigh = multiply(base, local[j[1]])
    shin = multiply(thigh, local[j[2]])
    foot = multiply(shin, local[j[3]])
    hip = add(add(hips, rotate(root, o[0])), rotate(base, o[1]))
    knee = add(hip, rotate(thigh, o[2]))
    ankle = add(knee, rotate(shin, o[3]))
    return LegPose(base, thigh, shin, foot, hip, knee, ankle, add(ankle, rotate(foot, o[4])))


def leg_inverse(
    leg: LegPose, target: Vector, foot: Quaternion, drop: float = 0.0
) -> tuple[Quaternion, Quaternion, Quaternion]:
    """Local rotations of thigh, shin and foot that bring the ankle to `target` with the hips lowered by `drop` metres.

    `foot` is the foot's new world rotation. See `runtime.feet.ik.two_bone`.
    """
    upper = subtract(leg.knee, leg.hip)
    lower = subtract(leg.ankle, leg.knee)
    hip = (leg.hip[0], leg.hip[1] - drop, leg.hip[2])
    # far from the origin a float no longer tells hip from knee: a bone without length must not divide
    a, b = max(length(upper), 1e-6), max(length(lower), 1e-6)
    axis = unit(subtract(leg.ankle, leg.hip))
    to_target = subtract(target, hip)
    asked = length(to_target)
    aim = unit(to_target) if asked > 1e-6 else axis
    d = max(soft_reach(asked, a + b, length(subtract(leg.ankle, leg.hip))), abs(a - b) + 1e-4)
    swing = between(axis, aim)
    bend = rotate(swing, _bend(axis, upper, rotate(leg.thigh, (0.0, 0.0, 1.0))))
    c = min(1.0, max(-1.0, (a * a + d * d - b * b) / (2.0 * a * d)))
    s = sqrt(1.0 - c * c)
    thigh_to = add(scale(aim, c), scale(bend, s))
    shin_to = unit(subtract(scale(aim, d), scale(thigh_to, a)))
    thigh_turn = multiply(between(rotate(swing, unit(upper)), thigh_to), swing)
    shin_turn = multiply(between(rotate(swing, unit(lower)), shin_to), swing)
    thigh, shin = multiply(thigh_turn, leg.thigh), multiply(shin_turn, leg.shin)
    return relative(leg.base, thigh), relative(thigh, shin), relative(shin, foot)


def soft_reach(distance: float, leg_length: float, span: float = 0.0) -> float:
    """Scalar twin of `runtime.feet.ik.soft_reach`."""
    start = max((MAX_REACH - EASE_REACH) * leg_length, min(span, leg_length))
    room = max(MAX_REACH * leg_length - start, 1e-9 * leg_length)
    over = min(max(distance - start, 0.0), 2.0 * room)
    return max(min(distance, start) + over - over * over / (4.0 * room), MIN_REACH * leg_length)


def _bend(axis: Vector, knee: Vector, pole: Vector) -> Vector:
    forward = unit(_perpendicular(pole, axis))
    bend = add(_perpendicular(knee, axis), scale(forward, POLE_WEIGHT_M))
    lack = 0.5 * POLE_WEIGHT_M - dot(bend, forward)
    return unit(add(bend, scale(forward, lack)) if lack > 0.0 else bend)


def _perpendicular(v: Vector, axis: Vector) -> Vector:
    d = dot(v, axis)
    return v[0] - d * axis[0], v[1] - d * axis[1], v[2] - d * axis[2]


def add(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(v: Vector, s: float) -> Vector:
    """v times s."""
    return v[0] * s, v[1] * s, v[2] * s


def dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def length(v: Vector) -> float:
    """Euclidean length."""
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def unit(v: Vector) -> Vector:
    """v at length one; a zero vector stays zero."""
    s = 1.0 / max(length(v), 1e-8)
    return v[0] * s, v[1] * s, v[2] * s


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product: rotate by b, then by a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def relative(parent: Quaternion, world: Quaternion) -> Quaternion:
    """Rotation of `world` seen from `parent`, at unit length."""
    w, x, y, z = multiply(inverse(parent), world)
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return w * s, x * s, y * s, z * s


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Rotate v by q."""
    w, x, y, z = q
    vx, vy, vz = v
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def between(a: Vector, b: Vector) -> Quaternion:
    """Shortest rotation that turns unit vector a into unit vector b."""
    w = 1.0 + dot(a, b)
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    if w < 1e-6:  # opposite: half a turn about any perpendicular axis
        w = 0.0
        x, y, z = (0.0, a[2], -a[1]) if abs(a[0]) < 0.9 else (-a[2], 0.0, a[0])
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return w * s, x * s, y * s, z * s


def inverse(q: Quaternion) -> Quaternion:
    """The opposite rotation."""
    return q[0], -q[1], -q[2], -q[3]


def to_vector(q: Quaternion) -> Vector:
    """Axis times angle (radians, at most pi) of a rotation."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    sine = sqrt(x * x + y * y + z * z)
    factor = 2.0 * atan2(sine, w) / sine if sine > 1e-9 else 2.0
    return x * factor, y * factor, z * factor


def from_vector(v: Vector) -> Quaternion:
    """Rotation of axis times angle; inverse of `to_vector`."""
    angle = length(v)
    factor = sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    return cos(0.5 * angle), v[0] * factor, v[1] * factor, v[2] * factor
