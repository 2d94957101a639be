"""Foot skating (the paper's formula, Sec. IV-B) and toe height over a terrain, of clips in world space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.skeleton import TOE_HEIGHT
from runtime.terrain import Terrain

Array = NDArray[np.floating]

TOES = [5, 10]
SKATING_HEIGHT_M = 0.025  # H


def toe_heights(positions: Array, terrain: Terrain) -> Array:
    """Heights `(T, 2)` in metres of both toe joints of `(T, 31, 3)` over the terrain."""
    toes = positions[:, TOES]
    return toes[..., 1] - terrain.height(toes[..., 0].astype(np.float64), toes[..., 2].astype(np.float64))


def skating(positions: Array, terrain: Terrain, sole_m: float = 0.0) -> Array:
    """Skating `(T - 1, 2)` in cm per frame: horizontal speed times clamp(2 - 2^(h / H), 0, 1).

    With `sole_m` the height is taken that much under the toe joint: stricter, as the joint rests above the ground.
    """
    toes = positions[:, TOES][..., [0, 2]]
    speed = np.linalg.norm(np.diff(toes, axis=0), axis=-1) * 100.0
    height = toe_heights(positions, terrain)[1:] - sole_m
    return speed * np.clip(2.0 - 2.0 ** (height / SKATING_HEIGHT_M), 0.0, 1.0)


def sole_skating(positions: Array, terrain: Terrain) -> Array:
    """Skating as seen at the sole: a toe joint at its resting height counts in full."""
    return skating(positions, terrain, TOE_HEIGHT)


def main(argv: list[str] | None = None) -> int:
    """`python -m benchmarks.feet CLIP.bvh --terrain NAME`: skating and toe height of an exported clip."""
    import argparse
    from pathlib import Path

    from runtime.clip import load_clip_bvh
    from runtime.terrain_library import load_terrain

    parser = argparse.ArgumentParser(prog="benchmarks.feet", description=main.__doc__)
    parser.add_argument("clip", type=Path)
    parser.add_argument("--terrain", default="flat")
    options = parser.parse_args(argv)
    positions, _ = load_clip_bvh(options.clip).world()
    terrain = load_terrain(options.terrain)
    heights = 100.0 * toe_heights(positions, terrain)
    print(
        f"skating {skating(positions, terrain).mean():.4f} cm per frame (at the sole {_sole(positions, terrain):.4f})"
    )
    print(f"lowest 1 % of toe heights {np.percentile(heights, 1):.2f} cm over the ground")
    return 0


def _sole(positions: Array, terrain: Terrain) -> float:
    return float(sole_skating(positions, terrain).mean())


if __name__ == "__main__":
    raise SystemExit(main())
