"""The mannequin's colours: light shell, dark joints and front panels, teal stripes left, orange stripes right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

# sRGB as a designer reads them; the file stores linear light
_SHELL = (0.80, 0.78, 0.74)
_JOINT = (0.20, 0.21, 0.23)
_FACE = (0.16, 0.17, 0.19)
_LEFT = (0.05, 0.58, 0.60)
_RIGHT = (0.93, 0.45, 0.10)


def linear(srgb: tuple[float, float, float]) -> Array:
    """Linear RGB `(3,)` of an sRGB colour."""
    c = np.array(srgb)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def regions(v: Array) -> Array:
    """Colour region `(V,)` of rest-pose points, x made positive: 0 shell, 1 joint, 2 face, 3 side stripe."""
    x, y, z = np.abs(v[:, 0]), v[:, 1], v[:, 2]
    region = np.zeros(len(v), np.int64)
    in_arm = (x > 0.2) & (y > 1.15)
    region[in_arm & (np.abs(x - 0.4655) < 0.030)] = 1
    region[in_arm & (np.abs(x - 0.655) < 0.014)] = 1
    region[(y < 0.8) & (np.abs(y - 0.4893) < 0.036)] = 1
    region[(y < 0.115) & (y > 0.090) & (z < 0.11)] = 1
    region[(np.abs(y - 1.075) < 0.030)] = 1
    region[(y + 0.35 * z > 1.385) & (y + 0.35 * z < 1.455)] = 1
    region[(y > 1.46) & (z > 0.055) & (y < 1.605)] = 2
    region[in_arm & (np.abs(x - 0.34) < 0.018)] = 3
    region[in_arm & (np.abs(x - 0.55) < 0.014)] = 3
    region[(y < 0.75) & (np.abs(y - 0.66) < 0.020)] = 3
    region[(y < 0.75) & (np.abs(y - 0.27) < 0.016)] = 3
    return region


def colours(region: Array, left: Array) -> Array:
    """Linear RGB `(V, 3)` of regions `(V,)`; `left` tells on which side of the body a vertex lies."""
    palette = np.array([linear(c) for c in (_SHELL, _JOINT, _FACE, _LEFT, _RIGHT)])
    return palette[np.where((region == 3) & ~left, 4, region)]
