"""Features of the stage-1 motion encoder: the network that the content space of prompts was aligned with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.motion.motion_encoder import MotionEncoder
from training.evaluation.motion.motion import RootFeatures, window_index

Array = NDArray[np.floating]

SIZE = 384  # six parts of 64
_BATCH = 128


def encoder_features(encoder: MotionEncoder, root: RootFeatures, starts: NDArray[np.integer]) -> Array:
    """Rows `(N, 384)`, the encoder's mean, of the windows of 40 samples that begin at frames `starts`."""
    both = np.concatenate([root.joints, root.rotations], axis=-1)
    rows = [np.zeros((0, SIZE), np.float32)]
    for first in range(0, len(starts), _BATCH):
        index = window_index(starts[first : first + _BATCH])
        mean, _ = encoder.encode(both[index], root.velocity[index])
        rows.append(mean.reshape(len(index), SIZE))
    return np.concatenate(rows)


def has_encoder(folder: Path) -> bool:
    """Whether a model folder holds the motion encoder."""
    return (folder / "motion.onnx").is_file()
