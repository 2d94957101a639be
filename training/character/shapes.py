"""Signed-distance shapes and smooth unions on point arrays `(N, 3)`, metres; negative inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from runtime.arrays import Array


class SolidShape(Protocol):
    """A solid in rest-pose coordinates."""

    def distance(self, points: Array) -> Array:
        """Approximate signed distance `(N,)` of `points` `(N, 3)`."""
        ...


def smooth_min(a: Array, b: Array, k: float) -> Array:
    """Union of two distances with a fillet of about `k` metres (quadratic polynomial smooth minimum)."""
    h = np.maximum(k - np.abs(a - b), 0.0) / k
    return np.minimum(a, b) - 0.25 * k * h * h


def smooth_max(a: Array, b: Array, k: float) -> Array:
    """Intersection of two distances with an edge rounded by about `k` metres."""
    return -smooth_min(-a, -b, k)


@dataclass(frozen=True)
class RoundCone:
    """The hull of two spheres: centres `a`, `b`, radii `ra`, `rb`."""

    a: tuple[float, float, float]
    b: tuple[float, float, float]
    ra: float
    rb: float

    def distance(self, points: Array) -> Array:
        """Signed distance `(N,)`, exact for similar radii."""
        a, b = np.array(self.a), np.array(self.b)
        axis = b - a
        t = np.clip((points - a) @ axis / (axis @ axis), 0.0, 1.0)
        radius = self.ra + t * (self.rb - self.ra)
        return np.linalg.norm(points - a - t[:, None] * axis, axis=1) - radius


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid with semi-axes `radii`, turned about X by `pitch` radians (positive nods forward)."""

    centre: tuple[float, float, float]
    radii: tuple[float, float, float]
    pitch: float = 0.0
    roll: float = 0.0

    def distance(self, points: Array) -> Array:
        """First-order signed distance `(N,)`."""
        p = points - np.array(self.centre)
        c, s = np.cos(self.pitch), np.sin(self.pitch)
        p = p @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        c, s = np.cos(self.roll), np.sin(self.roll)
        p = p @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        radii = np.array(self.radii)
        k0 = np.linalg.norm(p / radii, axis=1)
        k1 = np.linalg.norm(p / radii**2, axis=1)
        return np.where(k1 > 1e-9, k0 * (k0 - 1.0) / np.maximum(k1, 1e-9), -radii.min())


@dataclass(frozen=True)
class Loft:
    """Superellipse cross-sections strung along one coordinate axis.

    `stations` rows are `(t, u_min, u_max, v_min, v_max)` in rest coordinates: t runs along axis `along`, u and v along the
    two other axes in the order x, y, z. `power` 2 is an ellipse, larger is boxier. The widest point of a section lies at
    the centre of its u and v ranges unless `centre` (u, v) fixes it.
    """

    along: int
    stations: tuple[tuple[float, float, float, float, float], ...]
    power: float = 2.2
    centre: tuple[float | None, float | None] = (None, None)

    def distance(self, points: Array) -> Array:
        """Signed distance `(N,)` along the ray from the section's centre."""
        from scipy.interpolate import PchipInterpolator

        rows = np.array(sorted(self.stations))
        t_all = points[:, self.along]
        t = np.clip(t_all, rows[0, 0], rows[-1, 0])
        u_min, u_max, v_min, v_max = PchipInterpolator(rows[:, 0], rows[:, 1:])(t).T
        u_axis, v_axis = (axis for axis in range(3) if axis != self.along)
        cu = 0.5 * (u_min + u_max) if self.centre[0] is None else np.full_like(t, self.centre[0])
        cv = 0.5 * (v_min + v_max) if self.centre[1] is None else np.full_like(t, self.centre[1])
        u, v = points[:, u_axis] - cu, points[:, v_axis] - cv
        ru = np.maximum(np.where(u > 0, u_max - cu, cu - u_min), 1e-3)
        rv = np.maximum(np.where(v > 0, v_max - cv, cv - v_min), 1e-3)
        rho = (np.abs(u / ru) ** self.power + np.abs(v / rv) ** self.power) ** (1.0 / self.power)
        length = np.hypot(u, v)
        side = np.where(rho > 1e-4, length - length / np.maximum(rho, 1e-4), -np.minimum(ru, rv))
        end = np.abs(t_all - t)
        beyond = np.hypot(np.maximum(side, 0.0), end)
        return np.where(end > 0, beyond, side)


@dataclass(frozen=True)
class Mirrored:
    """A shape together with its image on the other side of x = 0, joined by a fillet of `k` metres."""

    shape: SolidShape
    k: float

    def distance(self, points: Array) -> Array:
        """Signed distance `(N,)` to the nearer of both."""
        return smooth_min(self.shape.distance(points), self.shape.distance(points * (-1.0, 1.0, 1.0)), self.k)


def union(shapes: Sequence[SolidShape], points: Array, k: float) -> Array:
    """Smooth union `(N,)` of several shapes with fillet `k` metres."""
    total = shapes[0].distance(points)
    for shape in shapes[1:]:
        total = smooth_min(total, shape.distance(points), k)
    return total
