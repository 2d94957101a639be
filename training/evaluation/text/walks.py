"""Straight walks on flat ground with a prompt, summarised for the text evaluation."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cached_property
from itertools import chain
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.atomic import write_atomic
from runtime.measures.table import BodyMeasures, measure
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel, load_model
from runtime.skeleton import SPORT_SKELETON
from training.augmentation.measured_edits import Summary, summarise
from training.data.labels import foot_contacts
from training.evaluation import log
from training.evaluation.motion.driving import FORWARD, TOGETHER, characters, flat_ground, walked

PLAIN_PROMPT = "a person walking normally"  # baseline of words about single parts
LEAD_SECONDS = 2.0  # walked before measuring, to leave out standing and the start pose
WALK_S = 6.0
LOGGED = 64  # walks between two lines of the log
Key = tuple[bytes, int]  # of a walk: Z^t and seed
# folder of a model, walks, their length in seconds, and the store
Job = tuple[Path, Sequence[Key], float, Path | None]


class Walker:
    """Generates walks in batches with a model in full precision, in `workers` processes; equal walks are cached.

    With a `store`, a folder that belongs to this model alone, every batch is written there, so that a killed run continues.
    """

    def __init__(
        self, folder: Path, workers: int = 1, seconds: float = WALK_S, store: Path | None = None
    ) -> None:
        self.folder, self.workers, self.seconds, self.store = folder, workers, seconds, store
        self._made: dict[Key, Summary] = {}

    @cached_property
    def _model(self) -> MotionModel:
        return _loaded(self.folder)

    def make(self, codes: Iterable[Array], seeds: Sequence[int] = ()) -> list[Summary]:
        """Return summaries of walks with each Z^t `(6, 64)`, in order; seeds default to 0."""
        texts = [np.ascontiguousarray(code, np.float32).tobytes() for code in codes]
        keys = list(zip(texts, seeds or [0] * len(texts), strict=True))
        new = [key for key in dict.fromkeys(keys) if key not in self._made]
        size = min(TOGETHER, -(-len(new) // self.workers)) or 1
        jobs = [(self.folder, new[k : k + size], self.seconds, self.store) for k in range(0, len(new), size)]
        for number, (key, summary) in enumerate(zip(new, self._walked(jobs), strict=True), 1):
            self._made[key] = summary
            if number % LOGGED == 0:
                log.info("walked %d of %d", number, len(new))
        return [self._made[key] for key in keys]

    def _walked(self, jobs: Sequence[Job]) -> Iterator[Summary]:
        if len(jobs) > 1 and self.workers > 1:
            # spawned, not forked: a running onnxruntime does not survive a fork
            with ProcessPoolExecutor(self.workers, mp_context=get_context("spawn")) as pool:
                yield from chain.from_iterable(pool.map(_make, jobs))
        else:
            yield from chain.from_iterable(_stored(job, lambda: self._model) for job in jobs)


def _make(job: Job) -> list[Summary]:
    return _stored(job, lambda: _loaded(job[0]))


def _stored(job: Job, model: Callable[[], MotionModel]) -> list[Summary]:
    """Return the walks of a job from its store, or make them and write them there."""
    _, keys, seconds, store = job
    if store is None:
        return _walks(model(), keys, seconds)
    path = store / f"{hashlib.sha256(repr((keys, seconds)).encode()).hexdigest()}.pickle"
    if not path.is_file():
        write_atomic(path, pickle.dumps(_walks(model(), keys, seconds)))
    found: list[Summary] = pickle.loads(path.read_bytes())
    return found


def _walks(model: MotionModel, keys: Sequence[Key], seconds: float) -> list[Summary]:
    codes = [np.frombuffer(code, np.float32).reshape(6, 64) for code, _ in keys]
    return [summarise(*walk) for walk in straight_walks(model, codes, seconds, [seed for _, seed in keys])]


def straight_walks(
    model: MotionModel, codes: Sequence[Array], seconds: float, seeds: Sequence[int] = ()
) -> list[tuple[Array, Array, Array]]:
    """Return hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)` of a walk with each Z^t `(6, 64)`.

    Walks are simulated in batches, without their lead-in; seeds default to 0.
    """
    lead = round(LEAD_SECONDS * FPS)
    members = characters(model, flat_ground(), codes, seeds)
    tracks = walked(members, lambda *_: FORWARD, lead + round(seconds * FPS))
    return [track.shown(lead) for track in tracks]


def _loaded(folder: Path) -> MotionModel:
    return load_model(folder, precision="fp32")


def body_of(hips: Array, local: Array) -> BodyMeasures:
    """Measure hips `(T, 3)` and local rotations `(T, 31, 4)`, with contacts from height and speed."""
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    contacts = foot_contacts(positions, np.zeros((len(hips), 4), np.float32)).astype(np.float32)
    return measure(hips, local, contacts)
