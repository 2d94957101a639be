"""The upper body of every frame, part by part, so that a part of one clip can be put on the body of another.

A part's rotations are kept against what it hangs on: arms and head against the chest (Spine1), the torso above the hips
against the facing direction of the root. The hips, legs, root, contacts and phases belong to the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.motion.features import FPS, INPUT, OUTPUT, L
from runtime.skeleton import PART_JOINTS, SPORT_SKELETON, J
from training.augmentation.gait import left_landings, step_phase
from training.frames import FIRST_OF_UPPER as FIRST
from training.frames import FIXED_POINT, FrameTable, smooth

PARTS = ("left_arm", "right_arm", "torso", "head")  # that can come from another clip
UPPER = J - FIRST
CHEST = SPORT_SKELETON.index("Spine1") - FIRST
TORSO = tuple(j - FIRST for j in PART_JOINTS["torso"] if j >= FIRST)
JOINTS_OF = tuple(tuple(j - FIRST for j in PART_JOINTS[part] if j >= FIRST) for part in PARTS)
CLIP_SPAN = 4096.0  # clocks of two clips never meet
FEWEST_LANDINGS = 3  # of the left foot, below which a clip does not step
STEADY = 0.7  # of a clip's median moving speed, from which the upper body swings in full


@dataclass
class UpperBody:
    """Upper bodies `(N, 20, 6)` of all frames and the clocks by which they are matched.

    `clock` `(N,)` rises within a clip: gait cycles, whole where the left foot lands, or seconds where `steps` `(clips,)`
    is false. `activity` `(N,)` is 0 where a stepping clip stands and 1 where it moves as it usually does. `mean`
    `(clips, 20, 6)` is a clip's mean pose while it moves.
    """

    hung: Tensor  # int16
    clock: Tensor  # float64
    activity: Tensor
    mean: Tensor
    steps: Tensor
    cadence: Tensor  # (clips,) cycles a second

    @staticmethod
    def of(table: FrameTable) -> UpperBody:
        """Of every clip of a table, one after the other."""
        clips = len(table.styles)
        clock, activity = np.empty(len(table)), np.empty(len(table), np.float32)
        mean, steps = np.empty((clips, UPPER, 6), np.float32), np.zeros(clips, bool)
        cadence = np.ones(clips, np.float32)
        for clip in range(clips):
            rows = slice(int(table.start[clip]), int(table.start[clip + 1]))
            y = np.asarray(table.y[rows], np.float32)
            own = np.asarray(table.upper[rows], np.float32) / FIXED_POINT
            contacts = (y[:, OUTPUT["contacts"]] > 0.5).astype(np.uint8)
            landings = left_landings(contacts)
            steps[clip] = len(landings) >= FEWEST_LANDINGS
            beat = step_phase(contacts) if steps[clip] else np.arange(len(y)) / FPS
            clock[rows] = clip * CLIP_SPAN + beat - np.floor(beat[0])
            activity[rows] = _activity(y, table.x[rows]) if steps[clip] else 1.0
            if steps[clip]:
                cadence[clip] = FPS / np.median(np.diff(landings))
            moving = activity[rows] >= 0.9
            mean[clip] = own[moving if moving.any() else ~moving].mean(0)
        tensors = (torch.as_tensor(v) for v in (table.upper, clock, activity, mean, steps, cadence))
        return UpperBody(*tensors)

    def to(self, device: torch.device) -> UpperBody:
        return UpperBody(*(value.to(device) for value in vars(self).values()))

    def at(self, low: Tensor, high: Tensor, weight: Tensor, joints: tuple[int, ...]) -> Tensor:
        """6D rotations `(B, n, 6)` of joints between frames `low` and `high` `(B,)`, not orthonormal."""
        index = list(joints)
        a = self.hung[low][:, index].float()
        b = self.hung[high][:, index].float()
        return torch.lerp(a, b, weight.float()[:, None, None]) / FIXED_POINT


def _activity(y: Array, x: Array) -> Array:
    """How much of its usual swing an upper body has while its root goes as in y `(T, 473)`, x `(T, 342)`."""
    speed = smooth(np.linalg.norm(y[:, OUTPUT["root"]][:, :2], axis=1)[:, None], 10.0)[:, 0]
    standing = np.asarray(x[:, INPUT["gait"]], np.float32).reshape(len(x), L, -1)[:, L // 2, Gait.STAND]
    moving = standing < 0.5
    usual = float(np.median(speed[moving])) if moving.any() else 1.0
    return np.clip(speed / max(STEADY * usual, 0.05), 0.0, 1.0)
