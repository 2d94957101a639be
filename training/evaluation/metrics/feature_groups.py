"""Features of windows by part of the body: which part tells generated motion from capture.

Every group is a few signals over time, smoothed so that single noisy frames do not decide. Of each signal in a window of
1.3 s: mean, deviation, lowest, highest, mean speed, and the sizes of its first four harmonics.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.skeleton import SPORT_SKELETON
from training.evaluation.metrics.motion import RootFeatures, window_index
from training.frames import smooth

GROUPS = ("feet", "thighs", "arms", "root path", "torso", "pelvis", "knees", "head")
SMOOTHING = 2.0  # frames
PATH_SMOOTHING = 30.0  # frames; the path without the sway of single steps
HARMONICS = 4
SIDES = ("Left", "Right")
_AT = SPORT_SKELETON.index


def group_signals(root: RootFeatures) -> dict[str, Array]:
    """Signals `(T, n)` of every group, metres, radians and seconds."""
    p = root.joints.astype(np.float64)

    def place(name: str) -> Array:
        return p[:, _AT(name)]

    def way(first: str, last: str) -> Array:
        return place(last) - place(first)

    def leans(first: str, last: str) -> Array:
        """Angles of a bone forwards and sideways."""
        bone = way(first, last)
        unit = bone / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), 1e-9)
        return np.arcsin(np.clip(unit[:, [2, 0]], -1.0, 1.0))

    def bend(first: str, middle: str, last: str) -> Array:
        a, b = way(middle, first), way(middle, last)
        cosine = (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-9)
        return np.arccos(np.clip(cosine, -1.0, 1.0))[:, None]

    def line(left: str, right: str) -> Array:
        """Roll and yaw of the line between two joints."""
        across = way(right, left)
        flat = np.linalg.norm(across[:, [0, 2]], axis=-1)
        return np.stack([np.arctan2(across[:, 1], flat), np.arctan2(across[:, 2], across[:, 0])], -1)

    away = root.xz - smooth(root.xz.astype(np.float64), PATH_SMOOTHING)
    sideways = away[:, 0] * np.cos(root.yaw) - away[:, 1] * np.sin(root.yaw)
    ahead = away[:, 0] * np.sin(root.yaw) + away[:, 1] * np.cos(root.yaw)
    signals: dict[str, list[Array]] = {
        "feet": [place(f"{s}{n}")[:, 1:] for s in SIDES for n in ("Foot", "ToeBase")]
        + [leans(f"{s}Foot", f"{s}ToeBase")[:, :1] for s in SIDES],
        "thighs": [leans(f"{s}UpLeg", f"{s}Leg") for s in SIDES],
        "arms": [leans(f"{s}Arm", f"{s}ForeArm") for s in SIDES]
        + [bend(f"{s}Arm", f"{s}ForeArm", f"{s}Hand") for s in SIDES]
        + [way(f"{s}Arm", f"{s}Hand") for s in SIDES],
        "root path": [root.velocity.astype(np.float64), np.stack([sideways, ahead], -1)],
        "torso": [leans("Hips", "Spine1"), leans("Spine1", "Neck"), line("LeftArm", "RightArm")],
        "pelvis": [place("Hips")[:, 1:2], line("LeftUpLeg", "RightUpLeg")],
        "knees": [bend(f"{s}UpLeg", f"{s}Leg", f"{s}Foot") for s in SIDES],
        "head": [leans("Neck", "Head"), way("Neck", "Head")],
    }
    return {name: smooth(np.concatenate(signals[name], axis=1), SMOOTHING) for name in GROUPS}


def group_features(root: RootFeatures, starts: NDArray[np.integer]) -> dict[str, Array]:
    """Rows `(N, 9 n)` of every group for the windows that begin at frames `starts`."""
    index = window_index(starts)
    found = {}
    for name, signal in group_signals(root).items():
        window = signal[index]
        centred = window - window.mean(1, keepdims=True)
        spectrum = np.abs(np.fft.rfft(centred, axis=1))[:, 1 : HARMONICS + 1] / window.shape[1]
        speed = np.abs(np.diff(window, axis=1)).mean(1)
        parts = [window.mean(1), window.std(1), window.min(1), window.max(1), speed]
        rows = np.concatenate([*parts, spectrum.reshape(len(index), -1)], axis=1)
        found[name] = rows.astype(np.float32)
    return found
