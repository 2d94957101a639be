"""Features of all windows of many motions, of every kind that the metrics need."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion.motion_encoder import MotionEncoder
from training.evaluation.metrics.encoder_features import SIZE, encoder_features
from training.evaluation.metrics.kinematic_features import kinematic_features, temporal_features
from training.evaluation.motion.motion import WINDOW_FRAMES, Motion, window_starts

Array = NDArray[np.floating]

HOP = 10  # frames between the beginnings of two windows


@dataclass(frozen=True)
class WindowSet:
    """Rows of windows: `unit` `(N,)` tells which half of which motion they lie in (see `frechet.compare`)."""

    kinematic: Array  # (N, 234)
    temporal: Array  # (N, 88)
    encoder: Array  # (N, 384), without rows where no encoder was given
    unit: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.kinematic)

    @property
    def for_classifier(self) -> Array:
        """Kinematic and temporal features `(N, 322)`."""
        return np.concatenate([self.kinematic, self.temporal], axis=1)

    def of(self, name: str) -> Array:
        """Rows of the feature set "encoder" or "kinematic"."""
        return self.encoder if name == "encoder" else self.kinematic

    def pick(self, rows: NDArray[np.integer] | NDArray[np.bool_]) -> WindowSet:
        """Some of the windows."""
        encoder = self.encoder[rows] if len(self.encoder) else self.encoder
        return WindowSet(self.kinematic[rows], self.temporal[rows], encoder, self.unit[rows])


def window_set(motions: Iterable[Motion], encoder: MotionEncoder | None, hop: int = HOP) -> WindowSet:
    """Windows `hop` frames apart of every motion."""
    kinematic, temporal = [np.zeros((0, 234), np.float32)], [np.zeros((0, 88), np.float32)]
    encoded, units = [np.zeros((0, SIZE), np.float32)], [np.zeros(0, np.int64)]
    for number, motion in enumerate(motions):
        starts = window_starts(len(motion), hop)
        root = motion.root_features()
        kinematic.append(kinematic_features(root, starts))
        temporal.append(temporal_features(root, starts))
        if encoder is not None:
            encoded.append(encoder_features(encoder, root, starts))
        units.append(halves(number, len(motion), starts))
    return WindowSet(
        np.concatenate(kinematic), np.concatenate(temporal), np.concatenate(encoded), np.concatenate(units)
    )


def halves(number: int, frames: int, starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Units of the windows of motion `number` (see `frechet.compare`): a half holds whole windows only; a short motion has
    but one half.
    """
    middle = frames // 2
    if middle < WINDOW_FRAMES:
        return np.full(len(starts), 2 * number)
    second, first = starts >= middle, starts + WINDOW_FRAMES <= middle
    return np.where(second, 2 * number + 1, np.where(first, 2 * number, -1 - number))


def joined(sets: Iterable[WindowSet]) -> WindowSet:
    """All windows of several sets; their takes stay apart, and so do their pairs of takes."""
    listed = list(sets)
    pairs = [(int(max(s.unit.max() // 2, -1 - s.unit.min())) // 2 + 1) if len(s) else 0 for s in listed]
    offset = 2 * np.cumsum([0, *pairs])  # in takes
    return WindowSet(
        np.concatenate([s.kinematic for s in listed]),
        np.concatenate([s.temporal for s in listed]),
        np.concatenate([s.encoder for s in listed]),
        np.concatenate(
            [np.where(s.unit < 0, s.unit - o, s.unit + 2 * o) for s, o in zip(listed, offset, strict=False)]
        ),
    )
