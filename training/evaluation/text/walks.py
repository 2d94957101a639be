"""Walks under a prompt, straight ahead on flat ground, reduced to what the text evaluation compares."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.generate import simulate
from runtime.motion.control_scripts import control_script
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel, load_model
from runtime.skeleton import SPORT_SKELETON
from training.augmentation.measured_edits import Summary, summarise
from training.data.labels import foot_contacts
from training.evaluation.motion.driving import flat_ground
from training.text.measure import BodyMeasures, measure

PLAIN_PROMPT = "a person walking normally"  # what words about a part change
LEAD_SECONDS = 2.0  # walked before measuring: standing still and the start pose are over
SECONDS = 6.0


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


def _make(job: tuple[Path, Walk, float]) -> Summary:
    folder, walk, seconds = job
    z = np.frombuffer(walk.z, np.float32).reshape(6, 64)
    return summarise(*straight_walk(_model(folder), z, seconds, walk.seed))


def straight_walk(model: MotionModel, z: Array, seconds: float, seed: int = 0) -> tuple[Array, Array, Array]:
    """Hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)` of a walk in Z^t `(6, 64)`, after its lead-in."""
    lead = round(LEAD_SECONDS * FPS)
    controller, script = Controller(model, flat_ground(), seed), control_script("forward", "walk")
    poses = simulate(controller, script, [(0.0, z)], lead + round(seconds * FPS))[lead:]
    return (
        np.stack([p.hips_position for p in poses]),
        np.stack([p.local_rotations for p in poses]),
        np.stack([p.contacts for p in poses]),
    )


@lru_cache(maxsize=1)
def _model(folder: Path) -> MotionModel:
    return load_model(folder)


def body_of(hips: Array, local: Array) -> BodyMeasures:
    """Measures of hips `(T, 3)` and local rotations `(T, 31, 4)`, contacts found by height and speed."""
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    contacts = foot_contacts(positions, np.zeros((len(hips), 4), np.float32)).astype(np.float32)
    return measure(hips, local, contacts)
