"""Keys of a take's camera, and the view between them."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from runtime.errors import UsageError

MAX_KEYS = 1000
MAX_BESIDE_M, MAX_DISTANCE_M, MAX_PITCH = 1000.0, 100.0, math.radians(89.0)


@dataclass(frozen=True)
class CameraKey:
    """A camera key: time in the take, direction (radians), distance (metres), and the point that it looks at.

    `x`, `y`, `z` (metres) are relative to a point above the ground under the hips, which the camera follows.
    """

    seconds: float
    yaw: float
    pitch: float
    distance: float
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    def __post_init__(self) -> None:
        limits = (36_000.0, 1e3, MAX_PITCH, MAX_DISTANCE_M, MAX_BESIDE_M, MAX_BESIDE_M, MAX_BESIDE_M)
        if not all(abs(value) <= limit for value, limit in zip(astuple(self), limits, strict=True)):
            raise UsageError("A camera key with an invalid view.", "Key another view.")
        if self.seconds < 0.0 or self.distance < 0.1:
            raise UsageError("A camera key before the take, or inside what it looks at.", "Key another view.")


def with_key(keys: Sequence[CameraKey], key: CameraKey, fps: float) -> tuple[CameraKey, ...]:
    """Return the keys with one added, replacing a key at the same frame; UsageError for more than MAX_KEYS."""
    kept = [k for k in keys if round(k.seconds * fps) != round(key.seconds * fps)]
    if len(kept) >= MAX_KEYS:
        raise UsageError(f"A take with {MAX_KEYS} camera keys is full.", "Delete keys first.")
    return tuple(sorted([*kept, key], key=lambda k: k.seconds))


def view_at(keys: Sequence[CameraKey], seconds: float) -> CameraKey:
    """Return the interpolated view at a time (Catmull-Rom spline, Catmull and Rom 1974; at rest at both ends)."""
    at = np.array([key.seconds for key in keys])
    values = np.array([astuple(key)[1:] for key in keys])
    values[:, 0] = np.unwrap(values[:, 0])
    values[:, 2] = np.log(values[:, 2])
    if seconds <= at[0] or len(keys) == 1:
        return replace(keys[0], seconds=seconds)
    if seconds >= at[-1]:
        return replace(keys[-1], seconds=seconds)
    slopes = np.zeros_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) / (at[2:] - at[:-2])[:, None]
    k = int(np.searchsorted(at, seconds, side="right")) - 1
    span = at[k + 1] - at[k]
    t = (seconds - at[k]) / span
    a, b = 2 * t**3 - 3 * t**2 + 1, t**3 - 2 * t**2 + t
    c, d = 3 * t**2 - 2 * t**3, t**3 - t**2
    yaw, pitch, distance, x, y, z = (
        float(v) for v in a * values[k] + b * span * slopes[k] + c * values[k + 1] + d * span * slopes[k + 1]
    )
    return CameraKey(seconds, yaw, min(max(pitch, -MAX_PITCH), MAX_PITCH), math.exp(distance), x, y, z)
