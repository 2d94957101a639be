"""Walks under a prompt, straight ahead on flat ground, reduced to what the text evaluation compares."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.generate import simulate
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel, load_model
from runtime.motion.paths import control_script
from runtime.skeleton import SPORT_SKELETON
from training.evaluation.motion.driving import flat_ground
from training.text.measure import BodyMeasures, measure, smoothed_facing

Array = NDArray[np.floating]

LEAD_SECONDS = 2.0  # walked before measuring: standing still and the start pose are over
SECONDS = 6.0


@dataclass(frozen=True)
class Summary:
    """A motion's measures, and of every joint the time-mean of its local rotation and the spread around it.

    The hips' rotation is taken against the smoothed facing direction, so that heading does not count.
    """

    body: BodyMeasures
    mean: Array  # (31, 4)
    spread: Array  # (31,) radians, root mean square


def summarise(hips: Array, local: Array, contacts: NDArray[Any]) -> Summary:
    """Of hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)`."""
    local = local.astype(np.float64)
    positions, _ = SPORT_SKELETON.forward_kinematics(hips.astype(np.float64), local)
    ahead = local.copy()
    ahead[:, 0] = rotations.multiply(
        rotations.inverse(rotations.from_yaw(smoothed_facing(positions))), local[:, 0]
    )
    mean = mean_rotation(ahead)
    away = 2.0 * np.arccos(np.clip(np.abs((ahead * mean).sum(-1)), 0.0, 1.0))
    return Summary(measure(hips, local, contacts.astype(np.float32)), mean, np.sqrt((away**2).mean(0)))


def mean_rotation(local: Array) -> Array:
    """Mean `(J, 4)` of unit quaternions `(T, J, 4)`, whose signs do not matter: the main axis of their spread."""
    outer = np.einsum("tja,tjb->jab", local, local)
    return np.linalg.eigh(outer)[1][..., -1]


def rotation_change(one: Summary, other: Summary) -> Array:
    """How differently joints `(31,)` move, radians: the angle between their mean rotations, and the change of spread.

    Both are time averages: a walk that is out of step with another differs in neither.
    """
    dot = np.abs((one.mean * other.mean).sum(-1))
    return np.hypot(2.0 * np.arccos(np.clip(dot, 0.0, 1.0)), other.spread - one.spread)


@dataclass(frozen=True)
class Walk:
    """A walk to be made: Z^t `(6, 64)` as bytes of float32, and a seed."""

    z: bytes
    seed: int

    @staticmethod
    def of(z: Array, seed: int) -> Walk:
        """From an array."""
        return Walk(np.ascontiguousarray(z, np.float32).tobytes(), seed)


class Walker:
    """Makes walks with the model of a folder in `workers` processes; the same walk is made once."""

    def __init__(self, folder: Path, workers: int = 1, seconds: float = SECONDS) -> None:
        self.folder, self.workers, self.seconds = folder, workers, seconds
        self._made: dict[Walk, Summary] = {}

    def make(self, walks: Sequence[Walk]) -> list[Summary]:
        """Summaries of the walks, in their order."""
        new = [w for w in dict.fromkeys(walks) if w not in self._made]
        jobs = [(self.folder, w, self.seconds) for w in new]
        if self.workers > 1 and len(jobs) > 4:
            # spawned, not forked: a running onnxruntime does not survive a fork
            with ProcessPoolExecutor(self.workers, mp_context=get_context("spawn")) as pool:
                made = list(pool.map(_make, jobs, chunksize=4))
        else:
            made = [_make(job) for job in jobs]
        self._made |= dict(zip(new, made, strict=True))
        return [self._made[w] for w in walks]

    @property
    def frames(self) -> int:
        """Frames simulated so far, lead-ins included."""
        return len(self._made) * round((LEAD_SECONDS + self.seconds) * FPS)


def _make(job: tuple[Path, Walk, float]) -> Summary:
    folder, asked, seconds = job
    controller = Controller(_model(folder), flat_ground(), asked.seed)
    z = np.frombuffer(asked.z, np.float32).reshape(6, 64)
    lead = round(LEAD_SECONDS * FPS)
    poses = simulate(controller, control_script("forward", "walk"), [(0.0, z)], lead + round(seconds * FPS))[
        lead:
    ]
    return summarise(
        np.stack([p.hips_position for p in poses]),
        np.stack([p.local_rotations for p in poses]),
        np.stack([p.contacts for p in poses]),
    )


@lru_cache(maxsize=1)
def _model(folder: Path) -> MotionModel:
    return load_model(folder)
