"""Training clips of a model's own characters on random obstacle courses, crossed by foot lock and keyframes.

No capture shows styles on stairs, on a beam or over hurdles. As PARC (Xu et al. 2025) augments its terrain data, the
controller moves characters of many styles over synthetic ground: the network walks as on level ground, foot lock and
keyframes adapt the legs. Stretches that pass every check become clips, together with their ground.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from copy import copy
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.arrays import Array, Float32Array
from runtime.controls import Gait
from runtime.errors import FileError
from runtime.motion.features import FPS, INPUT
from runtime.motion.model import MotionModel
from runtime.motion.style import Style
from runtime.terrain.height_map import Terrain
from training.data.clips import Patches, TrainingClip
from training.evaluation.metrics.motion import Motion
from training.evaluation.metrics.traversal import first_problem
from training.evaluation.motion.evaluated_model import EvaluatedModel, style_texts
from training.evaluation.on_obstacles import along_the_middle, at_start, walked_to

log = logging.getLogger("sport.train")

SOURCE = "courses"
KINDS = ("obstacles", "stairs", "beam", "slopes")
COURSE_FRACTIONS = (0.4, 0.3, 0.15, 0.15)  # of the courses, by `KINDS`
LENGTH_M, HALF_WIDTH_M, CELL_M, START_M = 30.0, 2.0, 0.05, 2.5
SIDE_M = 0.5  # largest lateral distance of the path from the middle
MAX_WALK_MINUTES = 0.4  # of one character on one course
MAX_WALKS_PER_MINUTE = 25  # per minute of accepted motion: a usable model needs three
PIECE_S = 5.0  # unit that is accepted or rejected as a whole
MAX_ACCELERATION_M_PER_S2 = 260.0  # of a joint: captured jogs reach 250
# joint acceleration above which motion is smoothed, and the half-width and sigma of the filter
MIN_THROWN_M_PER_S2, SMOOTH_FRAMES, SMOOTH_SIGMA_FRAMES = 150.0, 5, 2.0


class LevelSight(MotionModel):
    """A model whose network always sees level ground."""

    @staticmethod
    def of(model: MotionModel) -> LevelSight:
        """Wrap the same networks."""
        made = copy(model)
        made.__class__ = LevelSight
        assert isinstance(made, LevelSight)
        return made

    def step(
        self, x: Float32Array, noise: Float32Array, style: Style | Sequence[Style]
    ) -> tuple[Float32Array, Float32Array]:
        """Return y and alpha for level ground."""
        level = x.copy()
        level[:, INPUT["heights"]] = 0.0
        return super().step(level, noise, style)


def random_course(kind: str, generator: np.random.Generator) -> Terrain:
    """Return a random course of one of `KINDS`, along +Z from a level start."""
    nx, nz = round(2 * HALF_WIDTH_M / CELL_M) + 1, round((LENGTH_M + 6.0) / CELL_M) + 1
    x = (np.arange(nx) * CELL_M - HALF_WIDTH_M)[:, None]
    z = (np.arange(nz) * CELL_M - 3.0)[None, :]
    heights = np.zeros((nx, nz))
    {"obstacles": _obstacles, "stairs": _stairs, "beam": _beam, "slopes": _slopes}[kind](
        heights, x, z, generator
    )
    return Terrain(kind, heights.astype(np.float32), CELL_M, (-HALF_WIDTH_M, -3.0))


def _obstacles(heights: Array, x: Array, z: Array, generator: np.random.Generator) -> None:
    """Add bars, gaps and platforms, 1.8 to 3.6 m apart."""
    del x
    place, level, between = START_M + generator.uniform(0.5, 2.0), 0.0, (1.8, 3.6)
    while place < LENGTH_M - 4.0:
        kinds = ("bar", "gap", "up", "down") if level > 0.1 else ("bar", "up", "bar")
        kind = generator.choice(kinds)
        ahead, row = z[0] >= place, heights[0]
        if kind == "bar":
            thick, top = generator.uniform(0.1, 0.3), generator.uniform(0.15, 0.65)
            row[ahead & (z[0] <= place + thick)] = level + top
            place += thick
        elif kind == "gap":
            length = generator.uniform(0.35, 1.1)
            row[ahead & (z[0] <= place + length)] = 0.0
            place += length
        else:
            rise = generator.uniform(0.2, 0.5) * (1.0 if kind == "up" else -1.0)
            level = float(np.clip(level + rise, 0.0, 1.1))
            row[ahead] = level
        place += generator.uniform(*between)
    heights[:] = heights[:1]


def _stairs(heights: Array, x: Array, z: Array, generator: np.random.Generator) -> None:
    """Add flights of stairs up and down, and single steps, with landings between."""
    del x
    place, level = START_M + generator.uniform(0.0, 2.0), 0.0
    while place < LENGTH_M - 4.0:
        rise, run = generator.uniform(0.11, 0.2), generator.uniform(0.27, 0.42)
        up = level <= 0.0 or (generator.random() < 0.5 and level < 1.2)
        for _ in range(int(generator.integers(1, 9))):
            if not up and level <= 0.0:
                break
            level = level + rise if up else max(level - rise, 0.0)
            heights[:, z[0] >= place] = level
            place += run
        place += generator.uniform(0.6, 2.5)


def _beam(heights: Array, x: Array, z: Array, generator: np.random.Generator) -> None:
    """Add beams between ramps."""
    place = START_M + generator.uniform(0.0, 1.5)
    while place < LENGTH_M - 8.0:
        length, top = generator.uniform(5.0, 12.0), generator.uniform(0.2, 0.5)
        half, ramp = generator.uniform(0.08, 0.14), 3.0 * top
        fraction = np.clip(np.minimum(z - place, place + length - z) / ramp, 0.0, 1.0)
        np.maximum(heights, np.where(np.abs(x) <= half, top * fraction, 0.0), out=heights)
        place += length + generator.uniform(1.0, 3.0)


def _slopes(heights: Array, x: Array, z: Array, generator: np.random.Generator) -> None:
    """Add hills and rough ground, level at the start."""
    steepest = np.tan(np.deg2rad(generator.uniform(6.0, 20.0)))
    field = np.zeros_like(heights)
    for wavelength, fraction in ((generator.uniform(4.0, 9.0), 1.0), (0.9, generator.uniform(0.0, 0.06))):
        for _ in range(6):
            way, phase = generator.uniform(0.0, np.pi), generator.uniform(0.0, 2.0 * np.pi)
            turn = 2.0 * np.pi / wavelength * generator.uniform(0.7, 1.4)
            field += fraction * np.sin(turn * (x * np.sin(way) + z * np.cos(way)) + phase)
    slope = np.abs(np.diff(field, axis=1)).max() / CELL_M
    start = np.clip((z - START_M) / 2.0, 0.0, 1.0)
    heights += (field - field[:, :1]) * steepest / slope * start


def walk(model: MotionModel, course: Terrain, style: str, code: Array, gait: Gait, seed: int) -> Motion:
    """Walk a character along a course by stick alone, until its end or the time limit."""
    generator = np.random.default_rng(seed)
    seen = model if course.name == "slopes" else LevelSight.of(model)
    side = 0.0 if course.name == "beam" else generator.uniform(-SIDE_M, SIDE_M)
    amount, wave = generator.uniform(0.75, 1.0), generator.uniform(5.0, 12.0)
    stick = partial(
        along_the_middle, gait=gait, amount=amount, side=lambda z: side * np.sin(2.0 * np.pi * z / wave)
    )
    frames = round(60.0 * MAX_WALK_MINUTES * FPS)
    track = walked_to(LENGTH_M, at_start(seen, course, code, seed), stick, frames)
    motion = track.motion(f"{style} {course.name}", style, gait)
    hips, local = smoothed(motion.hips, motion.local, motion.positions)
    return replace(motion, hips=hips, local=local)


def smoothed(hips: Array, local: Array, positions: Array) -> tuple[Array, Array]:
    """Return hips `(T, 3)` and rotations `(T, 31, 4)`, smoothed over some frames around high joint accelerations.

    A leg's speed may jump within one frame when a keyframe or foot lock takes over, or when the leg is fully extended.
    """
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    thrown = np.zeros(len(hips))
    thrown[1:-1] = np.linalg.norm(np.diff(positions.astype(np.float64), 2, axis=0), axis=-1).max(1)
    far = (thrown * FPS * FPS > MIN_THROWN_M_PER_S2).astype(np.float64)
    near = maximum_filter1d(far, 2 * SMOOTH_FRAMES + 1)
    weight = gaussian_filter1d(near, SMOOTH_FRAMES / 2.0)
    even = rotations.continuous(local.astype(np.float64))
    round_off = gaussian_filter1d(even, SMOOTH_SIGMA_FRAMES, axis=0)
    mixed = rotations.normalize(even + weight[:, None, None] * (round_off - even))
    low = gaussian_filter1d(hips.astype(np.float64), SMOOTH_SIGMA_FRAMES, axis=0)
    return hips + weight[:, None] * (low - hips), mixed


def passes(walked: Motion, piece: slice) -> str:
    """Return the first check that a stretch fails, or an empty string."""
    positions = walked.positions[piece]
    stands = np.linalg.norm(positions[-1, 0] - positions[0, 0]) < 0.2 * PIECE_S
    problem = first_problem(positions, walked.terrain, MAX_ACCELERATION_M_PER_S2)
    return problem or ("stands" if stands else "")


def kept(walked: Motion, name: str, seen: Counter[str]) -> Iterator[TrainingClip]:
    """Yield the stretches of a walk that pass, adjacent ones joined, with their ground; `seen` counts the results."""
    length = round(PIECE_S * FPS)
    run: list[int] = []
    starts = range(round(FPS), len(walked.hips) - length + 1, length)
    for first in [*starts, -1]:
        problem = "end" if first < 0 else passes(walked, slice(max(first - 1, 0), first + length + 1))
        if first >= 0:
            seen[f"{walked.terrain.name} {problem or 'kept'}"] += 1
        if not problem and len(run) < 3:
            run.append(first)
            continue
        if run:
            yield _clip(walked, slice(run[0], run[-1] + length), f"{name}_{run[0]}")
        run = [] if problem else [first]


def _clip(walked: Motion, piece: slice, name: str) -> TrainingClip:
    gait = np.eye(len(Gait), dtype=np.float32)[walked.gait[piece]]
    hips, terrain = walked.hips[piece], walked.terrain
    first = max(0, int((hips[:, 2].min() - 3.5 - terrain.origin[1]) / CELL_M))
    last = int((hips[:, 2].max() + 4.5 - terrain.origin[1]) / CELL_M)
    patches = Patches(
        terrain.heights[None, :, first:last], (terrain.origin[0], terrain.origin[1] + first * CELL_M), CELL_M
    )
    content = f"{Gait(int(walked.gait[0])).label} over {terrain.name}"
    contacts = (walked.contacts[piece] > 0.5).astype(np.uint8)
    return TrainingClip(
        name, hips, walked.local[piece], contacts, gait, walked.style, content, SOURCE, "train", "exact", patches
    )  # fmt: skip


def make(folder: Path, out: Path, minutes: float, seed: int, part: int = 0, parts: int = 1) -> Counter[str]:
    """Write `minutes` of accepted clips and their mirror images; returns counts of accepted stretches and failed checks.

    FileError for a model that hardly ever passes.
    """
    generator = np.random.default_rng([seed, part])
    texts = style_texts()
    evaluated = EvaluatedModel(folder, texts)
    styles = sorted(texts)
    seen: Counter[str] = Counter()
    frames, number, walks = 0, part, 0
    while frames < 3600.0 * minutes / parts:
        if walks > MAX_WALKS_PER_MINUTE * minutes / parts + 10:
            raise FileError(
                f"{folder}: only {frames / FPS:.0f} s of {walks} walks over courses pass every check.",
                "Train the model longer first, or omit --course-minutes.",
            )
        walks += 1
        style, kind = str(generator.choice(styles)), str(generator.choice(KINDS, p=COURSE_FRACTIONS))
        gait = Gait.JOG if generator.random() < 0.35 else Gait.WALK
        code = evaluated.style(style, int(generator.integers(8)))
        course, walk_seed = random_course(kind, generator), int(generator.integers(1 << 30))
        walked = walk(evaluated.model, course, style, code, gait, walk_seed)
        for clip in kept(walked, f"course_{seed}_{number}_{style}", seen):
            clip.save(out)
            clip.mirror().save(out)
            frames += len(clip.hips)
        number += parts
    return seen


def make_all(folder: Path, out: Path, minutes: float, seed: int, processes: int) -> Counter[str]:
    """Write the clips with several processes; see `make`."""
    out.mkdir(parents=True, exist_ok=True)
    jobs = [(folder, out, minutes, seed, part, processes) for part in range(processes)]
    if processes == 1:
        return make(*jobs[0])
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        return sum(pool.map(make, *zip(*jobs, strict=True)), Counter())
