"""Walks under a prompt, straight ahead on flat ground, reduced to what the text evaluation compares."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.measures.table import BodyMeasures, measure
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel, load_model
from runtime.skeleton import SPORT_SKELETON
from training.augmentation.measured_edits import Summary, summarise
from training.data.labels import foot_contacts
from training.evaluation import log
from training.evaluation.motion.driving import FORWARD, TOGETHER, flat_ground, walked

PLAIN_PROMPT = "a person walking normally"  # what words about a part change
LEAD_SECONDS = 2.0  # walked before measuring: standing still and the start pose are over
WALK_S = 6.0
LOGGED = 64  # walks between two lines of the log


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
    """Makes walks with the model of a folder in full precision, many together, in `workers` processes; the same walk is made once."""

    def __init__(self, folder: Path, workers: int = 1, seconds: float = WALK_S) -> None:
        self.folder, self.workers, self.seconds = folder, workers, seconds
        self._made: dict[Walk, Summary] = {}

    @cached_property
    def _model(self) -> MotionModel:
        return _loaded(self.folder)

    def make(self, walks: Sequence[Walk]) -> list[Summary]:
        """Summaries of the walks, in their order."""
        new = [w for w in dict.fromkeys(walks) if w not in self._made]
        size = min(TOGETHER, -(-len(new) // self.workers)) or 1
        jobs = [(self.folder, new[k : k + size], self.seconds) for k in range(0, len(new), size)]
        if len(jobs) > 1 and self.workers > 1:
            # spawned, not forked: a running onnxruntime does not survive a fork
            with ProcessPoolExecutor(self.workers, mp_context=get_context("spawn")) as pool:
                self._keep(new, pool.map(_make, jobs))
        else:
            self._keep(new, (_walks(self._model, *job[1:]) for job in jobs))
        return [self._made[w] for w in walks]

    def _keep(self, walks: Sequence[Walk], made: Iterable[list[Summary]]) -> None:
        for number, (walk, summary) in enumerate(zip(walks, chain.from_iterable(made), strict=True), 1):
            self._made[walk] = summary
            if number % LOGGED == 0:
                log.info("walked %d of %d", number, len(walks))


def _make(job: tuple[Path, Sequence[Walk], float]) -> list[Summary]:
    return _walks(_loaded(job[0]), *job[1:])


def _walks(model: MotionModel, walks: Sequence[Walk], seconds: float) -> list[Summary]:
    codes = [np.frombuffer(walk.z, np.float32).reshape(6, 64) for walk in walks]
    made = straight_walks(model, codes, seconds, [walk.seed for walk in walks])
    return [summarise(*walk) for walk in made]


def straight_walks(
    model: MotionModel, codes: Sequence[Array], seconds: float, seeds: Sequence[int] | None = None
) -> list[tuple[Array, Array, Array]]:
    """Hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)` of a walk in each Z^t `(6, 64)`, after its lead-in.

    Walked together; seeds are 0 where none are given.
    """
    lead, ground = round(LEAD_SECONDS * FPS), flat_ground()
    members = [Controller(model, ground, seed) for seed in seeds or [0] * len(codes)]
    for member, code in zip(members, codes, strict=True):
        member.set_style(code, 0.0)
    tracks = walked(members, lambda *_: FORWARD, lead + round(seconds * FPS))
    return [track.shown(lead) for track in tracks]


def _loaded(folder: Path) -> MotionModel:
    return load_model(folder, precision="fp32")


def body_of(hips: Array, local: Array) -> BodyMeasures:
    """Measures of hips `(T, 3)` and local rotations `(T, 31, 4)`, contacts found by height and speed."""
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    contacts = foot_contacts(positions, np.zeros((len(hips), 4), np.float32)).astype(np.float32)
    return measure(hips, local, contacts)
