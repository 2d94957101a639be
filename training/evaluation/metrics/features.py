"""Features of motion windows: kinematic and temporal ones, those of the motion encoder, and sets of both."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.feet import skating as feet
from runtime.motion.features import FPS
from runtime.motion.model import ExportedMotionEncoder
from runtime.skeleton import SPORT_SKELETON
from training.data.gait import angle
from training.evaluation.metrics.motion import (
    WINDOW_FRAMES,
    WINDOW_STRIDE,
    Motion,
    RootFeatures,
    window_index,
    window_starts,
)

_JOINTS = [
    SPORT_SKELETON.index(name)
    for name in (
        "Hips", "LeftLeg", "LeftFoot", "LeftToeBase", "RightLeg", "RightFoot", "RightToeBase", "Spine1", "Neck1",
        "Head", "LeftArm", "LeftForeArm", "LeftHand", "RightArm", "RightForeArm", "RightHand",
    )
]  # fmt: skip
# name: joint, end of the first bone, end of the second; the angle between the bones
_BENDS = (
    ("LeftLeg", "LeftUpLeg", "LeftFoot"),
    ("RightLeg", "RightUpLeg", "RightFoot"),
    ("LeftForeArm", "LeftArm", "LeftHand"),
    ("RightForeArm", "RightArm", "RightHand"),
)
# a bone, whose forward and sideways angles from the vertical are features
_LEANS = (
    ("Hips", "Neck"),
    ("Neck", "Head"),
    ("LeftArm", "LeftForeArm"),
    ("RightArm", "RightForeArm"),
    ("LeftUpLeg", "LeftLeg"),
    ("RightUpLeg", "RightLeg"),
)
_SWINGING = [
    SPORT_SKELETON.index(n) for n in ("LeftFoot", "RightFoot", "LeftHand", "RightHand", "Head", "Hips")
]
_STILL_SPEED = 0.3  # m/s; slower points of the sole near the ground are in contact
_RATE = FPS / WINDOW_STRIDE
_HARMONICS = 4


def kinematic_features(root: RootFeatures, starts: NDArray[np.integer]) -> Array:
    """Return features `(N, 234)` of the windows of 40 samples that begin at frames `starts`.

    Mean, deviation and range of 16 joints' positions relative to the root, mean and deviation of their speeds, mean,
    deviation and range of 16 joint and body angles, mean and deviation of the root's velocity and turn, and the
    fraction of time in which heels and toes are in contact.
    """
    index = window_index(starts)
    joints = root.joints[:, _JOINTS].reshape(len(root.joints), -1)[index]
    moved = np.diff(root.joints[index][:, :, _JOINTS], axis=1) * _RATE
    speed = np.linalg.norm(moved, axis=-1)
    angles = _angles(root.joints)[index]
    velocity = root.velocity[index]
    parts = [
        joints.mean(1), joints.std(1), np.ptp(joints, axis=1),
        speed.mean(1), speed.std(1),
        angles.mean(1), angles.std(1), np.ptp(angles, axis=1),
        velocity.mean(1), velocity.std(1),
        _standing(root)[index].mean(1),
    ]  # fmt: skip
    return np.concatenate(parts, axis=1).astype(np.float32)


def temporal_features(root: RootFeatures, starts: NDArray[np.integer]) -> Array:
    """Return features `(N, 88)`: amplitudes of four harmonics of feet, hands, head and hips, knees and elbows."""
    index = window_index(starts)
    signals = np.concatenate(
        [root.joints[:, _SWINGING].reshape(len(root.joints), -1), _angles(root.joints)[:, : len(_BENDS)]],
        axis=1,
    )[index]
    signals = signals - signals.mean(1, keepdims=True)
    spectrum = np.abs(np.fft.rfft(signals, axis=1))[:, 1 : _HARMONICS + 1] / signals.shape[1]
    return spectrum.reshape(len(index), -1).astype(np.float32)


def _angles(joints: Array) -> Array:
    """Return bends and leans `(T, 16)` in radians of root-relative joints `(T, 31, 3)`."""
    at = SPORT_SKELETON.index
    columns = []
    for middle, first, last in _BENDS:
        a, b = joints[:, at(first)] - joints[:, at(middle)], joints[:, at(last)] - joints[:, at(middle)]
        columns.append(np.radians(angle(a, b)))
    for first, last in _LEANS:
        bone = joints[:, at(last)] - joints[:, at(first)]
        length = np.linalg.norm(bone, axis=-1)
        columns += [np.arcsin(np.clip(bone[:, k] / length, -1.0, 1.0)) for k in (0, 2)]
    return np.stack(columns, axis=1)


def _standing(root: RootFeatures) -> Array:
    """Return whether the four points of the soles are in contact `(T, 4)`: near the ground and slow in the world."""
    points = root.joints[:, list(feet.SOLE_POINTS)].astype(np.float64)
    moved = np.gradient(points, axis=0) * FPS
    across, along, turn = (root.velocity[:, None, k] for k in range(3))
    x = moved[..., 0] + across + turn * points[..., 2]
    z = moved[..., 2] + along - turn * points[..., 0]
    low = points[..., 1] - np.array(feet.SOLE_HEIGHTS) < feet.SKATING_HEIGHT_M
    return (low & (np.hypot(x, z) < _STILL_SPEED)).astype(np.float32)


_BATCH = 128


def encoded(
    encoder: ExportedMotionEncoder, root: RootFeatures, starts: NDArray[np.integer]
) -> tuple[Array, Array]:
    """Return mean and log-variance `(N, 6, 64)` of the windows of 40 samples that begin at frames `starts`."""
    both = np.concatenate([root.joints, root.rotations], axis=-1)
    rows = [np.zeros((2, 0, 6, 64), np.float32)]
    for first in range(0, len(starts), _BATCH):
        index = window_index(starts[first : first + _BATCH])
        rows.append(np.stack(encoder.encode(both[index], root.velocity[index])))
    mean, log_variance = np.concatenate(rows, axis=1)
    return mean, log_variance


def has_encoder(folder: Path) -> bool:
    """Return whether a model folder contains the motion encoder."""
    return (folder / "motion.onnx").is_file()


HOP = 10  # frames between the starts of two windows


@dataclass(frozen=True)
class WindowSet:
    """Features of windows; `unit` `(N,)` identifies motion and half of each window (see `frechet.compare`)."""

    kinematic: Array  # (N, 234)
    temporal: Array  # (N, 88)
    encoder: Array  # (N, 384), empty without an encoder
    unit: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.kinematic)

    @property
    def for_classifier(self) -> Array:
        """Kinematic and temporal features `(N, 322)`."""
        return np.concatenate([self.kinematic, self.temporal], axis=1)

    def of(self, name: str) -> Array:
        """Return the features of the set "encoder" or "kinematic"."""
        return self.encoder if name == "encoder" else self.kinematic

    @staticmethod
    def stack(sets: Sequence[WindowSet], units: Sequence[NDArray[np.int64]]) -> WindowSet:
        """Concatenate several sets with new units; no sets give an empty one."""
        sets = [EMPTY, *sets]
        return WindowSet(
            np.concatenate([s.kinematic for s in sets]),
            np.concatenate([s.temporal for s in sets]),
            np.concatenate([s.encoder for s in sets]),
            np.concatenate([EMPTY.unit, *units]),
        )


_NO_ROWS = [np.zeros((0, size), np.float32) for size in (234, 88, 384)]
EMPTY = WindowSet(_NO_ROWS[0], _NO_ROWS[1], _NO_ROWS[2], np.zeros(0, np.int64))


def window_set(
    motions: Iterable[Motion],
    encoder: ExportedMotionEncoder | None,
    hop: int = HOP,
    under_body: bool = False,
) -> WindowSet:
    """Compute features of windows `hop` frames apart of every motion; heights as in `Motion.root_features`."""
    sets = []
    for number, motion in enumerate(motions):
        starts = window_starts(len(motion), hop)
        root = motion.root_features(under_body)
        codes = EMPTY.encoder
        if encoder is not None:
            codes = encoded(encoder, root, starts)[0].reshape(len(starts), -1)
        unit = halves(number, len(motion), starts)
        sets.append(WindowSet(kinematic_features(root, starts), temporal_features(root, starts), codes, unit))
    return WindowSet.stack(sets, [s.unit for s in sets])


def halves(number: int, frames: int, starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the units of the windows of motion `number` (see `frechet.compare`). Halves contain whole windows only; a short
    motion has a single half.
    """
    middle = frames // 2
    if middle < WINDOW_FRAMES:
        return np.full(len(starts), 2 * number)
    second, first = starts >= middle, starts + WINDOW_FRAMES <= middle
    return np.where(second, 2 * number + 1, np.where(first, 2 * number, -1 - number))


def joined(sets: Iterable[WindowSet]) -> WindowSet:
    """Concatenate several sets, with distinct takes and pairs of takes."""
    listed, units, offset = list(sets), [], 0  # in takes
    for unit in (s.unit for s in listed):
        units.append(np.where(unit < 0, unit - offset, unit + 2 * offset))
        take = np.where(unit < 0, -1 - unit, unit // 2)
        offset += 2 * (int(take.max(initial=-1)) // 2 + 1)
    return WindowSet.stack(listed, units)
