"""Quaternion, 6D and Euler rotation math on arrays of any leading shape.

Quaternions are unit, ordered w, x, y, z. Angles are radians. Matrices act on column vectors.
"""

import numpy as np

from runtime.arrays import Array

_AXES = {
    "X": np.array([1.0, 0.0, 0.0]),
    "Y": np.array([0.0, 1.0, 0.0]),
    "Z": np.array([0.0, 0.0, 1.0]),
}
_EPSILON = 1e-8


def normalize(v: Array) -> Array:
    """Return vectors `(..., n)` scaled to unit length; a zero vector stays zero."""
    v = np.asarray(v)
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), _EPSILON)


def identity(shape: tuple[int, ...] = ()) -> Array:
    """Return identity quaternions `(*shape, 4)`."""
    q = np.zeros((*shape, 4), np.float32)
    q[..., 0] = 1.0
    return q


def multiply(a: Array, b: Array) -> Array:
    """Return the Hamilton product `a b` of quaternions `(..., 4)`: rotate by b, then by a."""
    a, b = np.asarray(a), np.asarray(b)
    aw, ax, ay, az = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bw, bx, by, bz = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    # one output array: stacking four costs as much as their arithmetic
    result = np.empty(np.broadcast_shapes(a.shape, b.shape), np.result_type(a, b))
    result[..., 0] = aw * bw - ax * bx - ay * by - az * bz
    result[..., 1] = aw * bx + ax * bw + ay * bz - az * by
    result[..., 2] = aw * by - ax * bz + ay * bw + az * bx
    result[..., 3] = aw * bz + ax * by - ay * bx + az * bw
    return result


_LEFT = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
_SIGNS = np.array([[1, -1, -1, -1], [1, 1, -1, 1], [1, 1, 1, -1], [1, -1, 1, 1]], np.float32)
# in both dtypes: mixed products take three times as long
_LEFT_SIGNS: dict[str, Array] = {"f": _SIGNS, "d": _SIGNS.astype(np.float64)}


def left_matrix(q: Array) -> Array:
    """Return matrices `(..., 4, 4)` that multiply by quaternions `(..., 4)` from the left: `left_matrix(a) @ b` is `multiply(a, b)`."""
    return q.take(_LEFT, -1) * _LEFT_SIGNS[q.dtype.char]


def inverse(q: Array) -> Array:
    """Return the inverse (conjugate) of unit quaternions `(..., 4)`."""
    return np.asarray(q) * np.array([1, -1, -1, -1], np.asarray(q).dtype)


def rotate(q: Array, v: Array) -> Array:
    """Rotate vectors `(..., 3)` by quaternions `(..., 4)`; leading shapes broadcast."""
    q, v = np.asarray(q), np.asarray(v)
    u = q[..., 1:]
    twice = 2.0 * _cross(u, v)
    return v + q[..., :1] * twice + _cross(u, twice)


_AHEAD, _BEHIND = np.array([1, 2, 0]), np.array([2, 0, 1])


def _cross(a: Array, b: Array) -> Array:
    """Cross products of `(..., 3)`: np.cross takes five times as long for few vectors."""
    return a.take(_AHEAD, -1) * b.take(_BEHIND, -1) - a.take(_BEHIND, -1) * b.take(_AHEAD, -1)


def from_axis_angle(axis: Array, angle: Array) -> Array:
    """Return quaternions `(..., 4)` for unit axes `(..., 3)` and angles `(...)` in radians."""
    half = 0.5 * np.asarray(angle)[..., None]
    axis = np.asarray(axis)
    sine = np.sin(half) * axis
    return np.concatenate([np.broadcast_to(np.cos(half), (*sine.shape[:-1], 1)), sine], axis=-1)


def from_rotation_vector(v: Array) -> Array:
    """Return quaternions `(..., 4)` for rotation vectors `(..., 3)`: axis times angle in radians."""
    angle = np.linalg.norm(v, axis=-1)
    half = np.sinc(angle / (2.0 * np.pi)) / 2.0  # sin(angle / 2) / angle, also at zero
    return np.concatenate([np.cos(angle / 2.0)[..., None], v * half[..., None]], axis=-1)


def to_rotation_vector(q: Array) -> Array:
    """Return rotation vectors `(..., 3)`, of at most pi radians, for unit quaternions `(..., 4)`."""
    q = np.where(q[..., :1] < 0, -q, q)
    length = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(length, q[..., :1])
    return np.where(length > 1e-12, q[..., 1:] * (angle / np.maximum(length, 1e-12)), 2.0 * q[..., 1:])


def from_euler(angles: Array, order: str) -> Array:
    """Return quaternions for intrinsic Euler angles `(..., n)` (radians) in the BVH sense: `order` "ZYX" is R = Rz Ry Rx."""
    angles = np.asarray(angles)
    result: Array | None = None
    for i, axis in enumerate(order.upper()):
        q = from_axis_angle(np.broadcast_to(_AXES[axis], (*angles.shape[:-1], 3)), angles[..., i])
        result = q if result is None else multiply(result, q)
    if result is None:
        return identity(angles.shape[:-1])
    return result


def to_euler(q: Array, order: str = "ZYX") -> Array:
    """Return Euler angles `(..., 3)` (radians) of quaternions, the inverse of `from_euler`; any Tait-Bryan order."""
    i, j, k = ("XYZ".index(c) for c in order.upper())
    parity = 1.0 if (j - i) % 3 == 1 else -1.0
    m = to_matrix(q)
    cosine = np.hypot(m[..., i, i], m[..., i, j])
    second = np.arctan2(parity * m[..., i, k], cosine)  # an arcsine is 0.03 degrees off near the pole
    first = np.arctan2(-parity * m[..., j, k], m[..., k, k])
    third = np.arctan2(-parity * m[..., i, j], m[..., i, i])
    locked = cosine < 1e-6  # gimbal lock: only first ± third is defined
    first = np.where(locked, np.arctan2(parity * m[..., k, j], m[..., j, j]), first)
    return np.stack([first, second, np.where(locked, 0.0, third)], axis=-1)


def to_matrix(q: Array) -> Array:
    """Return rotation matrices `(..., 3, 3)` for unit quaternions `(..., 4)`."""
    q = np.asarray(q)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = [
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
    ]
    return np.stack(rows, axis=-2)


# four times the outer product q qᵀ `(4, 4)` of a rotation matrix `(3, 3)`, as a linear map of its nine entries
_OUTER_CONSTANT = np.eye(4).ravel()
_OUTER = np.zeros((9, 16))
for _entry, _places in enumerate(
    (
        ((0, 1), (5, 1), (10, -1), (15, -1)),  # xx on the diagonal
        ((3, -1), (12, -1), (6, 1), (9, 1)),  # xy: -wz, +xy
        ((2, 1), (8, 1), (7, 1), (13, 1)),  # xz: +wy, +xz
        ((3, 1), (12, 1), (6, 1), (9, 1)),  # yx
        ((0, 1), (5, -1), (10, 1), (15, -1)),  # yy
        ((1, -1), (4, -1), (11, 1), (14, 1)),  # yz
        ((2, -1), (8, -1), (7, 1), (13, 1)),  # zx
        ((1, 1), (4, 1), (11, 1), (14, 1)),  # zy
        ((0, 1), (5, -1), (10, -1), (15, 1)),  # zz
    )
):
    for _place, _sign in _places:
        _OUTER[_entry, _place] = _sign


def from_matrix(m: Array) -> Array:
    """Return unit quaternions `(..., 4)` with w >= 0 for rotation matrices `(..., 3, 3)`."""
    m = np.asarray(m)
    outer = (m.reshape(-1, 9) @ _OUTER + _OUTER_CONSTANT).reshape(-1, 4, 4)
    # the largest row is the best conditioned estimate of q
    q = outer[np.arange(len(outer)), outer.diagonal(0, -2, -1).argmax(-1)]
    length = np.sqrt(np.add.reduce(q * q, -1, keepdims=True))
    return (q / np.copysign(length, q[:, :1])).astype(m.dtype, copy=False).reshape(*m.shape[:-2], 4)


def matrix_from_6d(d: Array) -> Array:
    """Return rotation matrices `(..., 3, 3)` for 6D rotations `(..., 6)`, by Gram-Schmidt on two independent vectors."""
    d = np.asarray(d)
    numbers = np.ascontiguousarray(d.reshape(-1, 6).T)  # sums along rotations are several times faster
    x, y = numbers[:3], numbers[3:]
    x = x / np.maximum(np.sqrt(np.add.reduce(x * x)), _EPSILON)
    y = y - np.add.reduce(x * y) * x
    y = y / np.maximum(np.sqrt(np.add.reduce(y * y)), _EPSILON)
    z = x.take(_AHEAD, 0) * y.take(_BEHIND, 0) - x.take(_BEHIND, 0) * y.take(_AHEAD, 0)
    return np.array([x, y, z]).transpose(2, 1, 0).reshape(*d.shape[:-1], 3, 3)


def to_6d(q: Array) -> Array:
    """Return 6D rotations `(..., 6)` of quaternions `(..., 4)`: columns 0 and 1 of the rotation matrix."""
    m = to_matrix(q)
    return np.concatenate([m[..., :, 0], m[..., :, 1]], axis=-1)


def from_6d(d: Array) -> Array:
    """Return quaternions `(..., 4)` for 6D rotations `(..., 6)`; see `matrix_from_6d`."""
    return from_matrix(matrix_from_6d(d))


def between(a: Array, b: Array) -> Array:
    """Return the shortest rotations `(..., 4)` from unit vectors a `(..., 3)` to unit vectors b."""
    a, b = np.broadcast_arrays(np.asarray(a), np.asarray(b))
    w = 1.0 + np.sum(a * b, axis=-1, keepdims=True)
    axis = np.cross(a, b)
    # opposite vectors: half a turn about any axis perpendicular to a
    helper = np.where(np.abs(a[..., :1]) < 0.9, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
    opposite = np.concatenate([np.zeros_like(w), np.cross(a, helper)], axis=-1)
    return normalize(np.where(w < 1e-6, opposite, np.concatenate([w, axis], axis=-1)))


def slerp(a: Array, b: Array, t: Array | float) -> Array:
    """Interpolate spherically from a to b `(..., 4)` by t in 0..1 along the shorter arc."""
    a, b = np.broadcast_arrays(np.asarray(a), np.asarray(b))
    t = np.asarray(t)[..., None]
    dot = np.sum(a * b, axis=-1, keepdims=True)
    b = np.where(dot < 0, -b, b)
    angle = np.arccos(np.clip(np.abs(dot), 0.0, 1.0))
    sine = np.sin(angle)
    near = sine < 1e-5
    safe = np.where(near, 1.0, sine)
    wa = np.where(near, 1.0 - t, np.sin((1.0 - t) * angle) / safe)
    wb = np.where(near, t, np.sin(t * angle) / safe)
    return normalize(wa * a + wb * b)


def angle_between(a: Array, b: Array) -> Array:
    """Return the rotation angle (radians) `(...)` between quaternions a and b `(..., 4)`."""
    difference = multiply(inverse(a), b)
    return 2.0 * np.arctan2(np.linalg.norm(difference[..., 1:], axis=-1), np.abs(difference[..., 0]))


def from_yaw(yaw: Array | float) -> Array:
    """Return quaternions `(..., 4)` that rotate by `yaw` (radians) about +Y; yaw 0 faces +Z, positive yaw turns towards +X."""
    half = 0.5 * np.asarray(yaw)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, np.sin(half), zero], axis=-1)


def yaw_of(q: Array) -> Array:
    """Return the yaw `(...)` (radians) of the facing direction of a rotation `(..., 4)`; see `from_yaw`."""
    facing = rotate(q, np.array([0.0, 0.0, 1.0]))
    return np.arctan2(facing[..., 0], facing[..., 2])


def continuous(q: Array) -> Array:
    """Return quaternions `(T, ..., 4)` with signs chosen so that consecutive ones lie in one hemisphere."""
    q = np.asarray(q).copy()
    sign = np.where(np.sum(q[1:] * q[:-1], axis=-1) < 0, -1.0, 1.0)
    q[1:] *= np.cumprod(sign, axis=0)[..., None]
    return q


def continuous_euler(angles: Array) -> Array:
    """Return Euler angles `(T, ..., 3)` of the same rotations without jumps: the nearer of (a, b, c) and (a + pi, pi - b, c + pi).

    Programs that interpolate the angles then rotate as the joint does.
    """
    other = np.stack([angles[..., 0] + np.pi, np.pi - angles[..., 1], angles[..., 2] + np.pi], axis=-1)

    def away(to: Array) -> Array:
        step = to[1:] - angles[:-1]
        return np.abs(step - 2.0 * np.pi * np.round(step / (2.0 * np.pi))).sum(axis=-1)

    # a step between two of the other form is as long as one between two of this: only changes count
    changes = np.cumsum(away(other) < away(angles) - 1e-9, axis=0) % 2 == 1
    chosen = np.concatenate([np.zeros((1, *angles.shape[1:-1]), bool), changes])
    return np.unwrap(np.where(chosen[..., None], other, angles), axis=0)
