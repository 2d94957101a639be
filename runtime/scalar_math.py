"""Math on plain floats for per-frame code: vectors, quaternions, springs, smoothstep.

A NumPy call on three numbers costs as much as fifty multiplications in Python, and a foot lock needs hundreds per
frame. Vectors are (x, y, z), quaternions (w, x, y, z). `runtime.rotations` and `runtime.easing` are the array versions.
"""

import math
from functools import lru_cache
from math import atan2, cos, hypot, sin, sqrt

from runtime.pose import FPS

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
DECAY_RATE_PER_S = 1.3862943611  # 2 ln 2, of a critically damped spring with a half-life of one second
MIN_SIZE = 1e-6  # m or m/s: a shorter vector has no direction
MIN_DIVISOR = 1e-9  # keeps a quotient finite; far below any measured value


def smoothstep(value: float) -> float:
    """Ease from 0 at 0 to 1 at 1 with zero slope at both ends (cubic); constant outside."""
    u = min(1.0, max(0.0, value))
    return u * u * (3.0 - 2.0 * u)


def damp(value: float, velocity: float, goal: float, half_life: float, dt: float) -> tuple[float, float]:
    """Return value and velocity of a critically damped spring after `dt` seconds; scalar version of `runtime.easing.spring`."""
    rate = DECAY_RATE_PER_S / max(half_life, 1e-5)
    offset = value - goal
    slope = velocity + offset * rate
    fade = math.exp(-rate * dt)
    return fade * (offset + slope * dt) + goal, fade * (velocity - slope * rate * dt)


def damp_vector(
    value: Vector, velocity: Vector, goal: Vector, half_life: float, dt: float
) -> tuple[Vector, Vector]:
    """Return value and velocity of a critically damped spring in three dimensions; see `damp`."""
    rate = DECAY_RATE_PER_S / max(half_life, 1e-5)
    fade = math.exp(-rate * dt)
    x, y, z = value[0] - goal[0], value[1] - goal[1], value[2] - goal[2]
    vx, vy, vz = velocity
    ax, ay, az = vx + x * rate, vy + y * rate, vz + z * rate
    moved = (fade * (x + ax * dt) + goal[0], fade * (y + ay * dt) + goal[1], fade * (z + az * dt) + goal[2])
    rate *= dt
    return moved, (fade * (vx - ax * rate), fade * (vy - ay * rate), fade * (vz - az * rate))


@lru_cache(maxsize=256)
def decay(half_life: float, dt: float = 1.0 / FPS) -> float:
    """Return the fraction of a difference that is left after `dt` seconds, for a half-life in seconds."""
    return float(0.5 ** (dt / half_life))


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def add_scaled(a: Vector, b: Vector, s: float) -> Vector:
    """Return a plus s times b."""
    return a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s


def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(v: Vector, s: float) -> Vector:
    """Return v times s."""
    return v[0] * s, v[1] * s, v[2] * s


def perpendicular(v: Vector, axis: Vector) -> Vector:
    """Return v without its component along the unit vector `axis`."""
    d = v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2]
    return v[0] - d * axis[0], v[1] - d * axis[1], v[2] - d * axis[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product of a and b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Vector, b: Vector) -> float:
    """Return the inner product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def length(v: Vector) -> float:
    """Return the Euclidean length of v."""
    return hypot(*v)


def unit(v: Vector) -> Vector:
    """Return v scaled to length one; a zero vector stays zero."""
    s = 1.0 / max(hypot(*v), 1e-8)
    return v[0] * s, v[1] * s, v[2] * s


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the Hamilton product: rotate by b, then by a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def relative(parent: Quaternion, world: Quaternion) -> Quaternion:
    """Return the rotation `world` relative to `parent`, normalised."""
    w, x, y, z = parent
    w, x, y, z = multiply((w, -x, -y, -z), world)
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
    """Return the shortest rotation from unit vector a to unit vector b."""
    (ax, ay, az), (bx, by, bz) = a, b
    w, x, y, z = 1.0 + (ax * bx + ay * by + az * bz), ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    if w < 1e-6:  # opposite: half a turn about any perpendicular axis
        w = 0.0
        x, y, z = (0.0, az, -ay) if abs(ax) < 0.9 else (-az, 0.0, ax)
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return w * s, x * s, y * s, z * s


def inverse(q: Quaternion) -> Quaternion:
    """Return the inverse rotation."""
    return q[0], -q[1], -q[2], -q[3]


def to_vector(q: Quaternion) -> Vector:
    """Return the rotation vector of q: axis times angle (radians, at most pi)."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    sine = sqrt(x * x + y * y + z * z)
    factor = 2.0 * atan2(sine, w) / sine if sine > 1e-9 else 2.0
    return x * factor, y * factor, z * factor


def from_vector(v: Vector) -> Quaternion:
    """Return the rotation for a rotation vector (axis times angle); inverse of `to_vector`."""
    angle = hypot(*v)
    factor = sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    return cos(0.5 * angle), v[0] * factor, v[1] * factor, v[2] * factor
