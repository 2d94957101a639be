"""A standard course for every style: a wavy ring of about 55 m around the origin, the same on level and on uneven ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.controls import Controls, Gait
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel
from runtime.motion.paths import LOOK_AHEAD_M
from runtime.terrain.height_map import Terrain
from training.evaluation.motion.driving import LEAD_IN_FRAMES, Recorder
from training.evaluation.motion.motion import Motion

Array = NDArray[np.floating]

RADIUS_M, WAVE_M, WAVES = 8.0, 1.2, 3  # beyond the level start of every terrain, within its 40 m
POINTS = 1200


def ring() -> Array:
    """Points `(1200, 2)` of the closed course, metres."""
    angle = np.linspace(0.0, 2.0 * np.pi, POINTS, endpoint=False)
    radius = RADIUS_M + WAVE_M * np.sin(WAVES * angle)
    return np.stack([radius * np.sin(angle), radius * np.cos(angle)], axis=-1)


@dataclass(frozen=True)
class CourseRun:
    """What came of leading a character along the ring."""

    motion: Motion
    path_error: Array  # (T,) metres from the root to the nearest point of the course
    requested_speed: Array  # (T,) m/s


def path_error(xz: Array, course: Array) -> Array:
    """Distance `(T,)` in metres of root positions `(T, 2)` to the closed polygon `course` `(N, 2)`."""
    begin, along = course, np.roll(course, -1, axis=0) - course
    offset = xz[:, None] - begin
    t = (offset * along).sum(-1) / np.square(along).sum(-1)
    nearest = begin + np.clip(t, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(xz[:, None] - nearest, axis=-1).min(1)


def run_course(
    model: MotionModel, terrain: Terrain, style: str, code: Array, gait: Gait, seconds: float, seed: int
) -> CourseRun:
    """Full stick along the ring in style `code` (Z^t), pointed at the place 0.9 m ahead; the seed also chooses where it begins.

    The first 2 s, from standing, are not scored.
    """
    course = ring()
    place = int(np.random.default_rng(seed).integers(POINTS))
    heading = course[(place + 5) % POINTS] - course[place]
    controller = Controller(model, terrain, seed)
    controller.set_style(code, 0.0)
    x, z = (float(v) for v in course[place])
    controller.reset(x, z, float(np.arctan2(*heading)))
    recorder = Recorder(controller)
    roots, speeds = [], []
    for _ in range(LEAD_IN_FRAMES + round(seconds * FPS)):
        root = controller.pose.root_position[[0, 2]].astype(np.float64)
        place = _nearest(course, root, place)
        pose = recorder.step(Controls(_towards(course, root, place), gait=gait))
        roots.append(pose.root_position[[0, 2]])
        speeds.append(controller.requested_speed)
    name = f"{style} {gait.name.lower()} {terrain.name}"
    labels = np.full(len(roots) - LEAD_IN_FRAMES, int(gait))
    return CourseRun(
        recorder.motion(name, style, labels, LEAD_IN_FRAMES),
        path_error(np.stack(roots[LEAD_IN_FRAMES:]).astype(np.float64), course),
        np.array(speeds[LEAD_IN_FRAMES:]),
    )


def _nearest(course: Array, root: Array, last: int) -> int:
    """The nearest point among those ahead of the last one: the way round is never cut short."""
    ahead = (last + np.arange(-5, POINTS // 12)) % POINTS
    return int(ahead[np.argmin(np.square(course[ahead] - root).sum(-1))])


def _towards(course: Array, root: Array, place: int) -> tuple[float, float]:
    spacing = float(np.linalg.norm(course[(place + 1) % POINTS] - course[place]))
    target = course[(place + max(1, round(LOOK_AHEAD_M / spacing))) % POINTS]
    x, z = (target - root) / max(float(np.linalg.norm(target - root)), 1e-6)
    return float(x), float(z)
