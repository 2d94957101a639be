"""Perceptually even blends: which blend weight shows which fraction of the visible change between two styles.

The folded weights of two styles mix linearly (`style_mix`), but the resulting walks do not: most of the change may
occur within a sixth of the range. So some characters walk a few seconds side by side, each at its own weight; the
distance between their walks measures the change, from which the weights at even fractions of the change follow.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls
from runtime.motion.controller import Controller, Crowd
from runtime.motion.features import facing_yaw
from runtime.motion.model import MotionModel
from runtime.motion.style import Shares, StyleMix
from runtime.scalar_math import MIN_DIVISOR
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain

WALKERS = 13
LEAD_IN_FRAMES, FRAMES = 120, 240  # frames until the walks have found their gait; frames measured
STICK_FRACTION = 0.7
# of the whole change: minimum counted per step, so that equal walks keep even weights
MIN_CHANGE_FRACTION = 0.02
FIELD_M, FIELD_CELL_M = 200.0, 10.0


def perceptual_weights(
    model: MotionModel, a: Array, b: Array, strength: float = 1.0, pause: float = 0.0
) -> Shares:
    """Return the weights of style `b` `(6, 64)` at which 0, 1/12, 2/12 ... of the visible change from style `a` is done.

    `pause` (seconds) is slept between frames, so that a worker thread does not block the window's.
    """
    fractions = np.linspace(0.0, 1.0, WALKERS)
    mixed = [StyleMix((1.0 - fraction, fraction), (a, b)) for fraction in fractions.tolist()]
    steps = np.linalg.norm(np.diff(walks(model, mixed, strength, pause), axis=0), axis=1)
    steps = np.maximum(steps, MIN_CHANGE_FRACTION * steps.sum()) + MIN_DIVISOR
    done = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    found = np.interp(fractions, done, fractions)
    return (0.0, *found[1:-1].tolist(), 1.0)


def walks(model: MotionModel, styles: Sequence[StyleMix], strength: float = 1.0, pause: float = 0.0) -> Array:
    """Return mean and deviation of the joints `(W, 186)` of a straight walk in each style, in the root frame, metres."""
    ground = Terrain.flat(size_m=FIELD_M, cell_m=FIELD_CELL_M)
    walkers = [Controller(model, ground, 0, strength=strength) for _ in styles]
    for walker, style in zip(walkers, styles, strict=True):
        walker.set_style(style, 0.0)
    hips, local = _frames(walkers, pause)
    joints = SPORT_SKELETON.forward_kinematics(hips, local)[0].astype(np.float64)  # (T, W, 31, 3)
    yaw = facing_yaw(joints)
    c, s = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
    x, z = joints[..., 0] - joints[..., :1, 0], joints[..., 2] - joints[..., :1, 2]
    seen = np.stack([c * x - s * z, joints[..., 1], s * x + c * z], -1).reshape(FRAMES, len(walkers), -1)
    return np.concatenate([seen.mean(0), seen.std(0)], axis=-1)


def _frames(walkers: Sequence[Controller], pause: float) -> tuple[Array, Array]:
    """Return hips `(T, W, 3)` and local rotations `(T, W, 31, 4)` before foot lock, all walking straight ahead."""
    crowd, ahead = Crowd(walkers), Controls(move=(0.0, STICK_FRACTION))
    hips, local = [], []
    try:
        for frame in range(LEAD_IN_FRAMES + FRAMES):
            crowd.step(ahead)
            if frame >= LEAD_IN_FRAMES:
                hips.append([walker.unlocked[0] for walker in walkers])
                local.append([walker.unlocked[1] for walker in walkers])
            if pause:
                time.sleep(pause)
    finally:
        crowd.close()
    return np.array(hips), np.array(local)
