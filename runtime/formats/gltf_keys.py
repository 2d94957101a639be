"""Keyframes of a glTF animation, and the node transforms at any time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.character.read import GltfFile

AT_KEY_S = 1e-5  # times this little before a key count as at it
KEYS_REMEDY = "Export it again with its animation baked, or as BVH."
PATHS = {"translation": 3, "rotation": 4, "scale": 3}
ASTRAY_HANDLE_FRACTION = 0.5  # of the radius of the sphere of rotations: a handle this far inside is invalid
_FLAT_SCALE = 1e-9  # of a node scaled to nothing, as hidden parts are
_SQUARE_TOLERANCE = 1e-4  # of a matrix that is a rotation but for rounding


@dataclass(frozen=True)
class Channel:
    """Keyframes of one property of a node; cubic keys store in-tangent, value and out-tangent."""

    times: Array  # (K,) seconds
    values: Array  # (K, width), or (K, 3, width)
    kind: str

    def at(self, seconds: Array) -> Array:
        """Interpolate values `(T, width)` at the given times as glTF specifies; constant beyond the ends."""
        k = np.searchsorted(self.times, seconds + AT_KEY_S, side="right") - 1
        k = np.clip(k, 0, max(len(self.times) - 2, 0))
        after = np.minimum(k + 1, len(self.times) - 1)
        span = np.maximum(self.times[after] - self.times[k], 1e-9)
        t = np.clip((seconds - self.times[k]) / span, 0.0, 1.0)
        if self.kind == "STEP":
            return self.values[np.where(seconds + AT_KEY_S >= self.times[after], after, k)]
        if self.kind == "CUBICSPLINE":
            u, width = t[:, None], span[:, None]
            a, b = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u
            c, d = 3 * u**2 - 2 * u**3, u**3 - u**2
            v = self.values
            return np.asarray(a * v[k, 1] + b * width * v[k, 2] + c * v[after, 1] + d * width * v[after, 0])
        if self.values.shape[1] == 4:
            return rotations.slerp(self.values[k], self.values[after], t)
        return np.asarray(self.values[k] + t[:, None] * (self.values[after] - self.values[k]))


Channels = dict[tuple[int, str], Channel]  # by node and property


def read_channels(file: GltfFile, animation: Any) -> Channels:
    """Return the keyframes by node and property. Raises FileError if times and values do not match."""
    found, nodes = {}, range(len(file.gltf.nodes or []))
    for channel in animation.channels or []:
        node, path = channel.target.node, channel.target.path
        if path in PATHS and node in nodes:
            found[node, path] = _keys(file, animation.samplers[channel.sampler], path)
    return found


def _keys(file: GltfFile, sampler: Any, path: str) -> Channel:
    times = file.values(sampler.input, "the times of a key").astype(float)[:, 0]
    values = file.values(sampler.output, f"a key's {path}").astype(float)
    kind = sampler.interpolation or "LINEAR"
    if path == "rotation":
        values = values[:, [3, 0, 1, 2]]
    if kind == "CUBICSPLINE":
        values = values.reshape(len(times), 3, PATHS[path])
    if len(values) != len(times) or values.shape[-1] != PATHS[path] or not (np.diff(times) >= 0.0).all():
        raise file.error("keys of an animation that do not fit its times.", KEYS_REMEDY)
    return Channel(
        times, _of_one_sign(times, values) if values.ndim == 3 and path == "rotation" else values, kind
    )


def _of_one_sign(times: Array, values: Array) -> Array:
    """Return cubic rotation keys `(K, 3, 4)` without the quaternion sign flips that Blender writes.

    A tangent that leads through the sphere rather than along it joins a key to a handle of the other sign: its part along
    the sphere is mirrored, and the rest dropped. Then neighbouring keys get the same sign.
    """
    values, key = values.copy(), values[:, 1]
    thirds = np.append(np.diff(times), 0.0)
    thirds = np.maximum(thirds, np.roll(thirds, 1)) / 3.0
    for column in (0, 2):
        along = (values[:, column] * key).sum(-1) / np.maximum((key * key).sum(-1), 1e-12)
        turning = values[:, column] - along[:, None] * key
        astray = (np.abs(along) * thirds > ASTRAY_HANDLE_FRACTION) & (
            np.abs(along) > np.linalg.norm(turning, axis=-1)
        )
        values[:, column] = np.where(astray[:, None], -turning, values[:, column])
    alike = np.append(1.0, (key[1:] * key[:-1]).sum(-1))
    return np.asarray(values * np.cumprod(np.where(alike < 0.0, -1.0, 1.0))[:, None, None])


@dataclass(frozen=True)
class MovingNodes:
    """Animated nodes, parents first, with their local rest matrices `(nodes, 4, 4)` and channels."""

    nodes: list[int]
    parents: Sequence[int]
    resting: Array
    channels: Channels

    def world(self, seconds: Array) -> dict[int, Array]:
        """Return world matrices `(T, 4, 4)` of each node at the given times."""
        made: dict[int, Array] = {}
        for node in self.nodes:
            local = self._local(node, seconds)
            made[node] = local if self.parents[node] < 0 else made[self.parents[node]] @ local
        return made

    def _local(self, node: int, seconds: Array) -> Array:
        resting = self.resting[node]
        local = np.tile(resting, (len(seconds), 1, 1))
        moved = {
            path: self.channels[node, path].at(seconds) for path in PATHS if (node, path) in self.channels
        }
        if "rotation" in moved or "scale" in moved:
            sign = -1.0 if np.linalg.det(resting[:3, :3]) < 0.0 else 1.0
            size = sign * np.linalg.norm(resting[:3, :3], axis=0)
            turn = rotations.from_matrix(rotation_parts(resting[:3, :3]))
            matrix = rotations.to_matrix(rotations.normalize(moved.get("rotation", turn)))
            local[:, :3, :3] = matrix * np.asarray(moved.get("scale", size))[..., None, :]
        if "translation" in moved:
            local[:, :3, 3] = moved["translation"]
        return local


def rotation_parts(matrices: Array) -> Array:
    """Return the rotations `(..., 3, 3)` nearest to matrices that may contain scale, mirroring and shear."""
    size = np.linalg.norm(matrices, axis=-2, keepdims=True)
    flat = size.min(axis=(-2, -1), keepdims=True) < _FLAT_SCALE
    turn = np.where(flat, np.eye(3), matrices / np.maximum(size, 1e-12))
    turn = turn * np.where(np.linalg.det(turn) < 0.0, -1.0, 1.0)[..., None, None]
    sheared = np.abs(turn @ turn.swapaxes(-1, -2) - np.eye(3)).max(axis=(-2, -1)) > _SQUARE_TOLERANCE
    if np.any(sheared) and np.isfinite(turn).all():
        left, _, right = np.linalg.svd(turn[sheared])
        turn[sheared] = left @ right
    return np.asarray(turn)
