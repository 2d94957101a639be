"""The mannequin's colours: light shell, dark joints and mask, grey inner panels, teal accents left, orange right.

Each region is a field over rest-pose points of the left half, metres, negative inside; the mesh is cut along the
zero lines so that colours meet in crisp edges.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from training.character import remesh
from training.character.body import finger_drop

Indices = NDArray[np.int64]
Field = Callable[[Array], Array]

SHELL, JOINT, MASK, PANEL, ACCENT = range(5)
# sRGB as a designer reads them; the file stores linear light
_SRGB = ((0.83, 0.81, 0.77), (0.21, 0.22, 0.24), (0.13, 0.14, 0.16), (0.56, 0.56, 0.55))
_LEFT, _RIGHT = (0.05, 0.60, 0.62), (0.95, 0.46, 0.10)


def _linear(srgb: tuple[float, float, float]) -> Array:
    c = np.array(srgb)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def _band(coordinate: Array, centre: float, half: float) -> tuple[Array, Array]:
    """The two half spaces of a strip `2 half` wide."""
    return coordinate - (centre + half), (centre - half) - coordinate


def _regions(p: Array) -> list[tuple[int, tuple[Array, ...]]]:
    """Colours and the half spaces `(N,)` that bound them at points `(N, 3)`; later regions paint over earlier ones."""
    x, y, z = p.T
    return [
        *_panels(x, y, z),
        *_accents(x, y, z),
        *_joints(x, y, z),
        (JOINT, (y - 0.013,)),
        (MASK, _mask(x, y, z)),
    ]


def _panels(x: Array, y: Array, z: Array) -> list[tuple[int, tuple[Array, ...]]]:
    below_arm = 1.273 + 0.17 * np.clip(x - 0.535, 0.0, 0.1)
    thumb_drop = 0.33 * np.maximum(z + 0.01, 0.0) * np.clip((0.765 - x) / 0.03, 0.0, 1.0)
    return [
        (PANEL, (x - 0.050, y - 0.850 + 0.5 * (0.05 - x), 0.115 - y)),  # inner leg
        (PANEL, (y - below_arm, 0.205 - x, x - 0.645)),  # inner arm
        (PANEL, (y - 1.2950 + finger_drop(x) + thumb_drop, 0.664 - x)),  # palm
        (PANEL, (1.215 + 0.85 * x - y, y - 1.40, x - 0.140, -z)),  # bib
        (PANEL, (x - 0.016, y - 1.40, 1.09 - y, z)),  # spine
    ]


def _accents(x: Array, y: Array, z: Array) -> list[tuple[int, tuple[Array, ...]]]:
    return [
        (ACCENT, (*_band(z, 0.038, 0.0125), 0.075 - x, y - 0.835, 0.13 - y)),  # outer leg
        (ACCENT, (*_band(z, -0.031, 0.0115), 1.30 - y, 0.205 - x, x - 0.632)),  # outer arm
        (ACCENT, (*_band(z, 0.163, 0.008), y - 0.09)),  # instep
    ]


def _joints(x: Array, y: Array, z: Array) -> list[tuple[int, tuple[Array, ...]]]:
    hip = np.hypot(y - 0.905, z - 0.042)
    return [
        (JOINT, (*_band(x, 0.4655, 0.032), 1.15 - y)),
        (JOINT, (*_band(x, 0.652, 0.012), 1.15 - y)),
        (JOINT, (*_band(y, 0.492, 0.038), x - 0.3)),
        (JOINT, (*_band(y - 0.25 * (z - 0.047), 0.104, 0.013),)),
        (JOINT, (*_band(y + 0.35 * z, 1.412, 0.030), x - 0.125)),
        (JOINT, (*_band(y + 0.12 * z, 1.075, 0.026), x - 0.3)),
        (JOINT, (*_band(x + 0.42 * (y - 1.30), 0.176, 0.0065), 1.15 - y, y - 1.42)),  # armhole
        (JOINT, (hip - 0.040, 0.09 - x)),
        (SHELL, (hip - 0.024, 0.09 - x)),
    ]


def _mask(x: Array, y: Array, z: Array) -> tuple[Array, ...]:
    rho = ((x / 0.054) ** 2.6 + (np.abs(y - 1.540) / 0.066) ** 2.6) ** (1 / 2.6)
    return (rho - 1.0) * 0.054, 0.03 - z


def region_of(points: Array) -> Indices:
    """Colour region `(N,)` of rest-pose points of the left half."""
    region = np.full(len(points), SHELL)
    for colour, bounds in _regions(points):
        region[np.max(bounds, axis=0) < 0] = colour
    return region


def cut_regions(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """The half mesh with edges along every border between two colours."""
    fixed = np.zeros(len(vertices), bool)
    shapes = [len(bounds) for _, bounds in _regions(vertices[:1])]
    for r, count in enumerate(shapes):
        for k in range(count):
            vertices, triangles, fixed = remesh.cut(vertices, triangles, _bound(r, k), _others(r, k), fixed)
    return vertices, triangles


def _bound(r: int, k: int) -> Field:
    return lambda p: _regions(p)[r][1][k]


def _others(r: int, k: int) -> Field:
    """How far points lie outside the other half spaces of region r."""

    def outside(p: Array) -> Array:
        rest = [bound for i, bound in enumerate(_regions(p)[r][1]) if i != k]
        return np.max(rest, axis=0) if rest else np.full(len(p), -1.0)

    return outside


def palette(region: Indices, left: NDArray[np.bool_]) -> Array:
    """Linear RGB `(N, 3)` of regions; accents differ on the left and the right side of the body."""
    colours = np.array([_linear(c) for c in (*_SRGB, _LEFT, _RIGHT)])
    return colours[np.where((region == ACCENT) & ~left, ACCENT + 1, region)]
