"""Writes the shipped example height map, `assets/terrains/bowl.png`.

python -m training.data.example_height_map
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.assets import PROJECT_ROOT
from runtime.easing import smoothstep
from runtime.terrain.files import write_height_png


def example_heights(n: int = 401) -> Array:
    """Heights `(n, n)` in 0..1 of the shipped example PNG: a terraced bowl with a smooth gully, level at its centre."""
    axis = np.linspace(-1.0, 1.0, n)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    radius = np.hypot(x, z)
    bowl = 0.75 * _smoothstep(0.15, 1.0, radius)
    terraces = np.round(bowl * 10.0) / 10.0
    share = _smoothstep(-0.2, 0.2, x)  # smooth slope on one side, terraces on the other
    gully = 0.25 * np.exp(-(((x + 0.5 * z) / 0.12) ** 2)) * _smoothstep(0.2, 0.4, radius)
    return np.clip(bowl * (1.0 - share) + terraces * share - gully + 0.1, 0.0, 1.0)


def _smoothstep(low: float, high: float, v: Array) -> Array:
    return smoothstep((v - low) / (high - low))


def main() -> None:
    """Write the file."""
    write_height_png(PROJECT_ROOT / "assets" / "terrains" / "bowl.png", example_heights())


if __name__ == "__main__":
    main()
