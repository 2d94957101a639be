"""Random sticks on ground that nobody walks on: `python -m tests.steep --minutes 20 --seed 1`.

The real controller walks, jogs, jumps and turns among cliffs, spikes, walls and jagged noise, and the ground changes under
it. Counted are joints more than `DEPTH_M` under the ground and joints faster than `SPEED_M_S`; the exit code is 1 for one.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from runtime.controls import Controls, Gait
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import load_model
from runtime.terrain.height_map import Terrain

DEPTH_M = 0.3
SPEED_M_S = 40.0
SIZE_M = 40.0
GROUND_SECONDS = 10  # after which the ground changes
STICK_SECONDS = (0.2, 2.5)


def _terrain(name: str, heights: np.ndarray, cell_m: float) -> Terrain:
    return Terrain(name, heights.astype(np.float32), cell_m, (-SIZE_M / 2, -SIZE_M / 2))


def _cells(cell_m: float) -> int:
    return round(SIZE_M / cell_m) + 1


def cliffs(rng: Generator, height_m: float) -> Terrain:
    """Plateaus of 5 m, each as high as the others or by `height_m` higher."""
    levels = height_m * rng.integers(0, 2, (9, 9))
    index = np.minimum(np.arange(_cells(0.1)) // 50, 8)
    return _terrain(f"cliffs of {height_m:g} m", levels[np.ix_(index, index)], 0.1)


def spikes(rng: Generator) -> Terrain:
    """Level ground with needles of 4 m, one in 6 square metres."""
    n = _cells(0.2)
    return _terrain("spikes of 4 m", 4.0 * (rng.random((n, n)) < 0.2**2 / 6.0), 0.2)


def walls(rng: Generator) -> Terrain:
    """Level ground with walls of 0.3 to 3 m, 0.3 m thick, along and across."""
    heights = np.zeros((_cells(0.1), _cells(0.1)))
    for _ in range(60):
        i, j = rng.integers(0, len(heights) - 40, 2)
        length, height = rng.integers(20, 80), rng.uniform(0.3, 3.0)
        at = (slice(i, i + 3), slice(j, j + length))
        heights[at if rng.random() < 0.5 else at[::-1]] = height
    return _terrain("walls", heights, 0.1)


def jagged(rng: Generator) -> Terrain:
    """Noise of cells of half a metre: up to 6 m high in places, level in others."""
    n = _cells(0.5)
    patches = np.kron(rng.choice([0.0, 0.2, 1.0, 6.0], (17, 17)), np.ones((5, 5)))[:n, :n]
    return _terrain("jagged noise", patches * rng.random((n, n)), 0.5)


GROUNDS: tuple[Callable[[Generator], Terrain], ...] = (
    lambda rng: cliffs(rng, 3.0),
    lambda rng: cliffs(rng, 12.0),
    spikes,
    walls,
    jagged,
)


@dataclass
class Count:
    """What was seen."""

    frames: int = 0
    under: Counter[str] = field(
        default_factory=Counter
    )  # frames with a joint under the ground, of every ground
    fast: Counter[str] = field(default_factory=Counter)  # frames with a joint too fast
    deepest_m: float = 0.0
    fastest: float = 0.0  # m/s
    first: list[str] = field(default_factory=list)  # where it happened

    @property
    def failures(self) -> int:
        """Frames that must not be."""
        return self.under.total() + self.fast.total()


def _stick(rng: Generator) -> Controls:
    angle = rng.choice([rng.uniform(-np.pi, np.pi), rng.integers(0, 8) * np.pi / 4])
    gait = Gait(rng.choice([Gait.WALK, Gait.WALK, Gait.JOG, Gait.JOG, Gait.CROUCH, Gait.JUMP]))
    size = rng.choice([0.0, 0.5, 1.0, 1.0, 1.0])
    facing = (float(np.sin(turn := rng.uniform(-3, 3))), float(np.cos(turn))) if rng.random() < 0.2 else None
    return Controls((float(size * np.sin(angle)), float(size * np.cos(angle))), facing, gait)


def walk(controller: Controller, minutes: float, seed: int, grounds: tuple = GROUNDS) -> Count:
    """Walk for so long; the ground changes every `GROUND_SECONDS`."""
    rng, count = np.random.default_rng(seed), Count()
    left, controls, last = 0, Controls(), None
    for frame in range(round(minutes * 60 * FPS)):
        if frame % (GROUND_SECONDS * FPS) == 0:
            number = frame // (GROUND_SECONDS * FPS)
            terrain, last = grounds[number % len(grounds)](rng), None
            x, _, z = controller.pose.root_position
            controller.set_terrain(terrain)
            if max(abs(x), abs(z)) > SIZE_M / 2 - 3:
                controller.reset()
        if left == 0:
            left, controls = int(rng.uniform(*STICK_SECONDS) * FPS), _stick(rng)
        left -= 1
        pose = controller.step(controls)
        joints = pose.positions.astype(np.float64)
        depth = terrain.height(joints[:, 0], joints[:, 2]) - joints[:, 1]
        speed = np.zeros(len(joints)) if last is None else np.linalg.norm(joints - last, axis=-1) * FPS
        last = joints
        count.frames += 1
        count.deepest_m = max(count.deepest_m, float(depth.max()))
        count.fastest = max(count.fastest, float(speed.max()))
        for bad, counter in ((depth > DEPTH_M, count.under), (speed > SPEED_M_S, count.fast)):
            if bad.any():
                counter[terrain.name] += 1
                if len(count.first) < 2000:
                    where = ", ".join(f"{v:.2f}" for v in pose.root_position)
                    count.first.append(
                        f"frame {frame} ({frame % (GROUND_SECONDS * FPS)}), {terrain.name}, root {where}, "
                        f"joints {np.flatnonzero(bad).tolist()}: {depth.max():.2f} m under, {speed.max():.0f} m/s, "
                        f"{controls.gait.name} {controller.traversal}"
                    )
    return count


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.steep", description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0, help="simulated")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", type=int, default=10, help="places to name")
    options = parser.parse_args()
    model = load_model()
    count = walk(Controller(model, Terrain.flat()), options.minutes, options.seed)
    for line in count.first[: options.show]:
        print(line)
    print(f"{count.frames} frames: under {dict(count.under)}, too fast {dict(count.fast)}")
    print(f"deepest {count.deepest_m:.2f} m, fastest {count.fastest:.1f} m/s")
    return 1 if count.failures else 0


if __name__ == "__main__":
    sys.exit(main())
