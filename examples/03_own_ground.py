"""A ground from an array, a ramp and some steps: walked on, and saved as files that the viewer opens."""

import numpy as np

from sport import Terrain, generate_clip, load_terrain, save_bvh

CELL_M = 0.1
HALF_M = 10.0


def ramp_and_steps() -> np.ndarray:
    """Return heights `(nx, nz)` in metres: level at the start, a ramp to 0.4 m, three steps of 0.15 m, level again."""
    along = np.arange(-HALF_M, HALF_M, CELL_M)
    ramp = 0.4 * np.clip((along - 1.0) / 2.0, 0.0, 1.0)
    steps = 0.15 * np.clip(np.floor((along - 3.5) / 0.4), 0, 3)
    return np.tile(ramp + steps, (len(along), 1)).astype(np.float32)


def main() -> None:
    """Write `ramp.npy` and `ramp.bvh`."""
    heights = ramp_and_steps()
    ground = Terrain("ramp", heights, CELL_M, origin=(-HALF_M, -HALF_M))
    print(f"extent {ground.extent}, height at z = 4: {float(ground.height(0.0, 4.0)):.2f} m")

    np.save("ramp.npy", heights)  # floats are metres; `sport view --terrain ramp.npy` opens it
    same = load_terrain("ramp.npy", cell_m=CELL_M)
    assert np.allclose(same.heights, heights)

    clip = generate_clip("a sneaking thief", terrain="ramp.npy", path="forward", seconds=5.0)
    save_bvh(clip, "ramp.bvh")
    positions, _ = clip.world()
    root = positions[:, 0]
    climbed = float(same.height(*root[-1, [0, 2]]) - same.height(*root[0, [0, 2]]))
    over = positions[..., 1] - same.height(positions[..., 0], positions[..., 2])
    print(
        f"walked {root[-1, 2] - root[0, 2]:.1f} m, climbed {climbed:.2f} m, lowest joint {over.min():+.3f} m"
    )


if __name__ == "__main__":
    main()
