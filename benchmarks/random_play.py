"""Random play: prompts, strengths, stick and terrain change every few seconds, including unwalkable terrain.

python -m benchmarks.random_play --seeds 50 --minutes 0.1

Counts joints more than `DEPTH_M` below the ground or faster than `SPEED_M_S`; the exit code is 1 if there are any.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.random import Generator

from runtime.controls import Controls, Gait
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import load_model
from runtime.prompts.prompter import Prompter
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import TERRAIN_NAMES, make_terrain
from training.evaluation import log
from training.evaluation.experiment import Experiment, Setting, option, run_alone
from training.markdown import number, table

DEPTH_M = 0.3
SPEED_M_S = 30.0
SIZE_M = 40.0
GROUND_SECONDS = 10  # interval of terrain changes
STICK_SECONDS = (0.2, 2.5)
PROMPT_SECONDS = (1.0, 6.0)
STRENGTHS = (0.0, 1.5)  # range of the viewer's slider
PROMPTS = (
    "walk calmly", "waving both hands", "an angry giant stomping", "drunk", "sneaking like a thief", "a zombie",
    "wave with the right hand", "an old man with a bad back", "dancing with joy", "arms stretched out to the sides",
    "punching and kicking", "hopping on one leg", "a robot", "exhausted after a marathon", "hands clasped overhead",
)  # fmt: skip


def _terrain(name: str, heights: np.ndarray, cell_m: float) -> Terrain:
    return Terrain(name, heights.astype(np.float32), cell_m, (-SIZE_M / 2, -SIZE_M / 2))


def _cells(cell_m: float) -> int:
    return round(SIZE_M / cell_m) + 1


def cliffs(rng: Generator, height_m: float) -> Terrain:
    """Return plateaus of 5 m, at height 0 or `height_m`."""
    levels = height_m * rng.integers(0, 2, (9, 9))
    index = np.minimum(np.arange(_cells(0.1)) // 50, 8)
    return _terrain(f"cliffs of {height_m:g} m", levels[np.ix_(index, index)], 0.1)


def spikes(rng: Generator) -> Terrain:
    """Return level ground with spikes of 4 m, one per 6 square metres."""
    n = _cells(0.2)
    return _terrain("spikes of 4 m", 4.0 * (rng.random((n, n)) < 0.2**2 / 6.0), 0.2)


def walls(rng: Generator) -> Terrain:
    """Return level ground with walls 0.3 to 3 m high and 0.3 m thick, along and across."""
    heights = np.zeros((_cells(0.1), _cells(0.1)))
    for _ in range(60):
        i, j = rng.integers(0, len(heights) - 40, 2)
        length, height = rng.integers(20, 80), rng.uniform(0.3, 3.0)
        at = (slice(i, i + 3), slice(j, j + length))
        heights[at if rng.random() < 0.5 else at[::-1]] = height
    return _terrain("walls", heights, 0.1)


def jagged(rng: Generator) -> Terrain:
    """Return noise with cells of half a metre: up to 6 m high in places, level elsewhere."""
    n = _cells(0.5)
    patches = np.kron(rng.choice([0.0, 0.2, 1.0, 6.0], (17, 17)), np.ones((5, 5)))[:n, :n]
    return _terrain("jagged noise", patches * rng.random((n, n)), 0.5)


_made = cache(make_terrain)  # some take seconds


def ready(rng: Generator, name: str) -> Terrain:
    """Return a predefined terrain."""
    return _made(name, int(rng.integers(3)))


GROUNDS: tuple[Callable[[Generator], Terrain], ...] = (
    *(partial(ready, name=name) for name in TERRAIN_NAMES),
    partial(ready, name="hurdles"),  # a second time, because a pop was found there
    partial(cliffs, height_m=3.0),
    partial(cliffs, height_m=12.0),
    spikes,
    walls,
    jagged,
)


@dataclass
class Count:
    """The counts of one run."""

    frames: int = 0
    # frames with a joint below the ground, by terrain
    under: Counter[str] = field(default_factory=Counter)
    fast: Counter[str] = field(default_factory=Counter)  # frames with a joint too fast
    deepest_m: float = 0.0
    fastest: float = 0.0  # m/s
    first: list[str] = field(default_factory=list)  # descriptions of the first failures

    @property
    def failures(self) -> int:
        """Number of failed frames."""
        return sum(self.under.values()) + sum(self.fast.values())

    def see(self, terrain: Terrain, joints: np.ndarray, last: np.ndarray, where: str) -> None:
        """Check one frame: joints `(31, 3)`, and those of the previous frame."""
        depth = terrain.height(joints[:, 0], joints[:, 2]) - joints[:, 1]
        speed = np.linalg.norm(joints - last, axis=-1) * FPS
        self.frames += 1
        self.deepest_m = max(self.deepest_m, float(depth.max()))
        self.fastest = max(self.fastest, float(speed.max()))
        for bad, counter in ((depth > DEPTH_M, self.under), (speed > SPEED_M_S, self.fast)):
            if bad.any():
                counter[terrain.name] += 1
                self.first.append(
                    f"{terrain.name}, {where}, joints {np.flatnonzero(bad).tolist()}: "
                    f"{depth.max():.2f} m under, {speed.max():.0f} m/s"
                )


def _stick(rng: Generator) -> Controls:
    angle = rng.choice([rng.uniform(-np.pi, np.pi), rng.integers(0, 8) * np.pi / 4])
    gait = Gait(rng.choice([Gait.WALK, Gait.WALK, Gait.JOG, Gait.JOG, Gait.CROUCH, Gait.JUMP]))
    size = rng.choice([0.0, 0.5, 1.0, 1.0, 1.0])
    facing = (float(np.sin(turn := rng.uniform(-3, 3))), float(np.cos(turn))) if rng.random() < 0.2 else None
    return Controls((float(size * np.sin(angle)), float(size * np.cos(angle))), facing, gait)


def play(
    controller: Controller,
    minutes: float,
    seed: int,
    grounds: Sequence[Callable[[Generator], Terrain]] = GROUNDS,
    codes: Sequence[np.ndarray] = (),
) -> Count:
    """Play for `minutes` with prompts of `codes` `(6, 64)`; the terrain changes every `GROUND_SECONDS`."""
    rng, count = np.random.default_rng(seed), Count()
    stick_ends, prompt_ends, code, controls = 0, 0, 0, Controls()
    for frame in range(round(minutes * 60 * FPS)):
        fresh = frame % (GROUND_SECONDS * FPS) == 0
        if fresh:
            x, _, z = controller.pose.root_position
            controller.set_terrain(grounds[int(rng.integers(len(grounds)))](rng))
            if max(abs(x), abs(z)) > SIZE_M / 2 - 3:
                controller.reset()
        if frame >= prompt_ends and codes:
            prompt_ends = frame + int(rng.uniform(*PROMPT_SECONDS) * FPS)
            code = int(rng.integers(len(codes)))
            controller.strength = float(rng.choice([1.0, STRENGTHS[1], rng.uniform(*STRENGTHS)]))
            controller.response = float(rng.random())
            controller.set_style(codes[code], float(rng.choice([0.0, 0.8])))
        if frame >= stick_ends:
            stick_ends, controls = frame + int(rng.uniform(*STICK_SECONDS) * FPS), _stick(rng)
        last, pose = controller.pose.positions.astype(np.float64), controller.step(controls)
        joints = pose.positions.astype(np.float64)
        where = (
            f"seed {seed}, frame {frame}, prompt {code}, strength {controller.strength:.2f}, "
            f"root {np.round(pose.root_position, 2)}, {controls.gait.name} {controller.traversal}"
        )
        count.see(controller.terrain, joints, joints if fresh else last, where)
    return count


def figures_of(setting: Setting) -> dict[str, Any]:
    """Run all seeds; returns the model's name and the counts of each run, as plain data."""
    args = setting.args
    model = load_model(args.model)
    prompter, runs = Prompter(model), []
    codes = [np.asarray(prompter(prompt), np.float32) for prompt in PROMPTS]
    for seed in range(args.first, args.first + args.seeds):
        count = play(Controller(model, Terrain.flat(), seed), args.minutes, seed, codes=codes)
        log.info("\n".join([*count.first[:5], f"seed {seed}: {count.fastest:.1f} m/s"]))
        runs.append(vars(count))
    return {"model": args.model, "runs": runs}


def report(figures: dict[str, Any]) -> str:
    """Return the table of the runs."""
    counts = [Count(**run) for run in figures["runs"]]
    fastest = [count.fastest for count in counts]
    cells = {
        "model": figures["model"],
        "runs": str(len(counts)),
        "frames": f"{sum(count.frames for count in counts):,}",
        "joints too fast": str(sum(sum(count.fast.values()) for count in counts)),
        "under the ground": str(sum(sum(count.under.values()) for count in counts)),
        "fastest, m/s": number(max(fastest)),
        "median run": number(float(np.median(fastest))),
        "deepest, m": number(max(count.deepest_m for count in counts), 2),
    }
    return "\n".join(table(list(cells), [list(cells.values())]))


RANDOM_PLAY = Experiment(
    __doc__,
    figures_of,
    report,
    "random play",
    options=(
        option("--model", default="compact", help="compact or open (default: compact)"),
        option("--seeds", type=int, default=1, help="runs (default: 1)"),
        option("--minutes", type=float, default=1.0, help="simulated minutes per run (default: 1)"),
        option("--first", type=int, default=0, help="the first seed (default: 0)"),
    ),
    failed=lambda figures: any(Count(**run).failures for run in figures["runs"]),
)

if __name__ == "__main__":
    raise SystemExit(run_alone(RANDOM_PLAY, "random_play"))
