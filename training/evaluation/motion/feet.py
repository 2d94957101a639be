"""Foot skating (the paper's formula, Sec. IV-B) and toe height over a terrain, of clips in world space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.errors import UsageError, run_command
from runtime.feet import skating as feet
from runtime.skeleton import TOE_HEIGHT
from runtime.terrain.height_map import Terrain

Array = NDArray[np.floating]

FPS = 60.0  # of the frames that skating is given for


def toe_heights(positions: Array, terrain: Terrain) -> Array:
    """Heights `(T, 2)` in metres of both toe joints of `(T, 31, 3)` over the terrain."""
    return feet.joint_heights(positions, terrain)


def skating(positions: Array, terrain: Terrain) -> Array:
    """The paper's skating of both toe joints `(T - 1, 2)`, cm per frame."""
    return feet.skating(positions, terrain)


def sole_skating(positions: Array, terrain: Terrain) -> Array:
    """Skating as seen at the sole: a toe joint at its resting height counts in full."""
    return feet.skating(positions, terrain, resting_m=TOE_HEIGHT)


def main(argv: list[str] | None = None) -> int:
    """`python -m training.evaluation.motion.feet CLIP.bvh --terrain NAME`: skating and toe height of an exported clip."""
    import argparse
    from pathlib import Path

    from runtime.takes.clip import load_clip_bvh
    from runtime.terrain.library import load_terrain

    parser = argparse.ArgumentParser(prog="training.evaluation.motion.feet", description=main.__doc__)
    parser.add_argument("clip", type=Path)
    parser.add_argument("--terrain", default="flat")
    options = parser.parse_args(argv)
    clip = load_clip_bvh(options.clip)
    if len(clip) < 2:
        raise UsageError(f"{options.clip}: one frame; skating needs two.", "Take a longer clip.")
    positions, _ = clip.world()
    terrain = load_terrain(options.terrain)
    heights = 100.0 * toe_heights(positions, terrain)
    # a frame of a file with half the rate is twice as long, and so is the way that a foot slides in it
    share = clip.fps / FPS
    toe, sole = (share * float(of(positions, terrain).mean()) for of in (skating, sole_skating))
    print(f"skating {toe:.4f} cm per frame (at the sole {sole:.4f})")
    if clip.fps != FPS:
        print(f"the clip has {clip.fps:g} frames a second; skating is given for frames of 1/{FPS:.0f} s")
    print(f"lowest 1 % of toe heights {np.percentile(heights, 1):.2f} cm over the ground")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("feet", main))
