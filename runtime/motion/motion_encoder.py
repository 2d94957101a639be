"""The motion side of the content encoder: what a stretch of motion is in the space that prompts live in."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from runtime.arrays import Float32Array
from runtime.errors import ModelError
from runtime.motion.model_files import open_graph, read_graph, read_metadata

_JOINTS, _ROOT = (40, 31, 9), (40, 3)


class ExportedMotionEncoder:
    """`motion.onnx` of a model folder; ModelError when it is missing, damaged or from another export."""

    def __init__(self, folder: Path, threads: int = 1) -> None:
        data = read_graph(folder, "motion", read_metadata(folder))
        self._session = open_graph(folder / "motion.onnx", data, threads)

    def encode(self, joints: Float32Array, root: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Mean and log-variance `(B, 6, 64)` of sequences of 40 samples, every second frame at 60 Hz.

        `joints` `(B, 40, 31, 9)`: position (metres, relative to the root and to the ground's height) and 6D rotation;
        `root` `(B, 40, 3)`: its velocity (m/s, m/s, rad/s). All as in the network's output, not normalised.
        """
        if joints.shape[1:] != _JOINTS or root.shape != (len(joints), *_ROOT):
            raise ModelError(
                f"Motion encoder: joints {joints.shape} and root {root.shape}; expected (B, 40, 31, 9), (B, 40, 3).",
                "Cut the motion into windows of 40 samples.",
            )
        feed = {"joints": np.asarray(joints, np.float32), "root": np.asarray(root, np.float32)}
        mean, log_variance = self._session.run(["mean", "log_variance"], feed)
        return mean, log_variance
