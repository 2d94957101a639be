"""Batches of training frames on one device: x and y gathered with terrain patch, reference ground and phases."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from runtime.motion import features
from runtime.motion.features import INPUT, OUTPUT
from runtime.skeleton import PART_JOINTS, SPORT_SKELETON, J
from training.composition import Composer, CompositionPlan, UpperBodyPose
from training.frames import FIRST_OF_UPPER, FrameTable
from training.gpu import constant, rows_of


def window_around(rows: Tensor, offsets: Tensor, first: Tensor, last: Tensor) -> Tensor:
    """Frames `(B, n)` at `offsets` `(n,)` from `rows` `(B,)`; beyond a clip (`first` to `last`, `(N,)`) its end frame is repeated."""
    index = rows[:, None] + offsets
    return torch.minimum(torch.maximum(index, first[rows, None]), last[rows, None])


@dataclass
class FrameTensors:
    """The frame table as tensors. `phase` `(N, 5, 2)` comes from the periodic autoencoder."""

    x: Tensor
    y: Tensor
    heights: Tensor
    ground: Tensor
    previous_ground: Tensor
    phase: Tensor
    first: Tensor  # (N,) first frame of each frame's clip
    last: Tensor  # (N,)
    patches: Tensor  # (N,) number of terrain patches
    clip: Tensor  # (N,) clip of each frame
    composer: Composer | None = None  # combines parts of other clips with a base clip

    @staticmethod
    def of(table: FrameTable, phase: np.ndarray, device: torch.device) -> FrameTensors:
        """Move a table to `device`."""
        clip = table.clip

        def tensor(array: np.ndarray) -> Tensor:
            return torch.as_tensor(array).to(device)

        return FrameTensors(
            x=tensor(table.x),
            y=tensor(table.y),
            heights=tensor(table.heights),
            ground=tensor(table.ground),
            previous_ground=tensor(table.previous_ground),
            phase=tensor(phase.astype(np.float32)),
            first=tensor(table.start[clip]),
            last=tensor(table.start[clip + 1] - 1),
            patches=tensor(table.patches[clip]),
            clip=tensor(clip.astype(np.int64)),
        )

    def _window(self, rows: Tensor, offsets: np.ndarray) -> Tensor:
        index = window_around(rows, constant(offsets, rows.device), self.first, self.last)
        return self.phase[index].flatten(1)

    def inputs(self, rows: Tensor, patch: Tensor) -> Tensor:
        """Return x `(B, 472)` of frames `rows` on terrain patch `patch` `(B,)`."""
        x = self.x[rows].float()
        x[:, INPUT["heights"]] = self.heights[rows, patch].float()
        x[:, INPUT["joint_positions"]][:, 1::3] -= self.previous_ground[rows, patch][:, None]
        return torch.cat([x, self._window(rows - 1, features.PHASE_OFFSETS)], dim=1)

    def outputs(self, rows: Tensor, patch: Tensor, plan: CompositionPlan | None = None) -> Tensor:
        """Return y `(B, 473)`, with parts of other clips according to `plan`."""
        y = self.y[rows].float()
        y[:, OUTPUT["phase"]] = self._window(rows, features.FUTURE_PHASE_OFFSETS)
        y[:, OUTPUT["joint_positions"]][:, 1::3] -= self.ground[rows, patch][:, None]
        if plan is not None and self.composer is not None:
            changed = plan.changed.any(1)
            at = rows_of(changed)
            pose = self.composer.poses(rows[at], plan[at])[0]
            _put(y, at, changed[at], pose, self.ground[rows[at], patch[at]])
        return y

    def pairs(
        self, rows: Tensor, patch: Tensor, plan: CompositionPlan | None = None
    ) -> tuple[Tensor, Tensor]:
        """Return x and y of the same frames, both with parts of other clips according to `plan`."""
        x, y = self.inputs(rows, patch), self.outputs(rows, patch)
        if plan is not None and self.composer is not None:
            changed = plan.changed.any(1)
            at = rows_of(changed)
            now, previous = self.composer.poses(rows[at], plan[at], before=1)
            _put(y, at, changed[at], now, self.ground[rows[at], patch[at]])
            positions = _above(previous.positions, self.previous_ground[rows[at], patch[at]])
            _write(x, at, changed[at], INPUT["joint_positions"], positions)
            _write(x, at, changed[at], INPUT["joint_velocities"], previous.velocities)
        return x, y

    def plan(self, rows: Tensor, ahead: int = 0, often: float = 1.0) -> CompositionPlan:
        """Draw the parts of other clips for base frames `rows` (`Composer.draw`); none without a composer."""
        if self.composer is None:
            return CompositionPlan.nothing(len(rows), rows.device)
        return self.composer.draw(rows, ahead, often)


def _put(y: Tensor, at: Tensor | slice, changed: Tensor, pose: UpperBodyPose, ground: Tensor) -> None:
    """Write composed upper bodies into y `(B, 473)` in place, into the rows of `at` that are `changed` `(n,)`."""
    _write(y, at, changed, OUTPUT["joint_positions"], _above(pose.positions, ground))
    _write(y, at, changed, OUTPUT["joint_velocities"], pose.velocities)
    _write(y, at, changed, OUTPUT["joint_rotations"], pose.rotations)


def _write(into: Tensor, at: Tensor | slice, changed: Tensor, field: slice, upper: Tensor) -> None:
    """Write upper-body values `(n, 20, m)` into the columns of these joints in a `field` of all joints."""
    columns = slice(field.start + upper.shape[2] * FIRST_OF_UPPER, field.stop)
    into[at, columns] = torch.where(changed[:, None], upper.flatten(1), into[at, columns])


def _above(positions: Tensor, ground: Tensor) -> Tensor:
    """Return positions `(B, n, 3)` with heights relative to `ground` `(B,)`."""
    return torch.stack([positions[..., 0], positions[..., 1] - ground[:, None], positions[..., 2]], dim=-1)


DRAWN_BATCHES = 32


class RandomRows:
    """Endless batches of row indices drawn by weight that leave `ahead` frames to the end of their clip."""

    def __init__(
        self, weights: np.ndarray, batch: int, ahead: int, last: Tensor, generator: torch.Generator
    ) -> None:
        self._cumulative = torch.as_tensor(np.cumsum(weights), dtype=torch.float64, device=last.device)
        self._last, self._batch, self._ahead, self._generator = last, batch, ahead, generator
        self._used = DRAWN_BATCHES

    def __iter__(self) -> RandomRows:
        return self

    def __next__(self) -> Tensor:
        if self._used == DRAWN_BATCHES:
            self._draw()
        draw = self._drawn[self._used] * self._cumulative[-1]
        self._used += 1
        rows = torch.searchsorted(self._cumulative, draw).clamp_max(len(self._cumulative) - 1)
        return torch.minimum(rows, self._last[rows] - self._ahead)

    def _draw(self) -> None:
        """Draw the random numbers of many batches at once on the CPU: equal on every device, one synchronisation."""
        self._before, self._used = self._generator.get_state(), 0
        size = (DRAWN_BATCHES, self._batch)
        drawn = torch.rand(size, generator=self._generator, dtype=torch.float64)
        self._drawn = drawn.to(self._last.device)

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the random number generator."""
        if self._used == DRAWN_BATCHES:
            return {"generator": self._generator.get_state(), "used": DRAWN_BATCHES}
        return {"generator": self._before, "used": self._used}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from a saved state."""
        self._generator.set_state(state["generator"])
        if state["used"] < DRAWN_BATCHES:
            self._draw()
        self._used = state["used"]


@dataclass
class Normalisation:
    """Mean and standard deviation of x `(472,)` and y `(473,)`, and the clipping limit of normalised x.

    Velocities and phases, which the network feeds back unbounded, are limited to the range of the capture: a phase beyond
    it blends the experts as in no captured frame and grows further, which made a jogging character unstable.
    """

    x_mean: Tensor
    x_deviation: Tensor
    y_mean: Tensor
    y_deviation: Tensor
    x_limit: Tensor = field(default_factory=lambda: torch.full((features.INPUT_SIZE,), float("inf")))

    @staticmethod
    def measure(x: Tensor, y: Tensor) -> Normalisation:
        """Measure samples `(n, 472)`, `(n, 473)`; all entries of a field share one deviation, as in PFNN."""
        mean, deviation = x.mean(0), _field_deviation(x, INPUT, _INPUT_SCALE)
        limit = torch.full_like(mean, float("inf"))
        for name in ("joint_velocities", "phase"):
            limit[INPUT[name]] = ((x - mean) / deviation).abs().amax(0)[INPUT[name]]
        return Normalisation(mean, deviation, y.mean(0), _field_deviation(y, OUTPUT, {}), limit)

    def normalised(self, x: Tensor) -> Tensor:
        """Return normalised x `(B, 472)`."""
        return normalised(x, self.x_mean, self.x_deviation, self.x_limit)

    def to(self, device: torch.device) -> Normalisation:
        return Normalisation(*(t.to(device) for t in vars(self).values()))


def normalised(x: Tensor, mean: Tensor, deviation: Tensor, limit: Tensor) -> Tensor:
    """Return (x - mean) / deviation of x `(B, n)`, clipped to ±`limit`."""
    return torch.maximum(torch.minimum((x - mean) / deviation, limit), -limit)


# A scale below one reduces a field's influence on the experts: the previous pose must not outweigh the controls.
_INPUT_SCALE = {"joint_positions": 0.4, "joint_velocities": 0.4}
_LOSS_WEIGHT = {
    "trajectory_positions": 2.0,
    "trajectory_directions": 2.0,
    "root": 8.0,
    "contacts": 2.0,
    "joint_velocities": 0.5,
}


# Loss weights of positions and rotations of these parts: words change them less than steps and arms change.
_PART_WEIGHT = {"left_leg": 2.2, "right_leg": 2.2, "torso": 2.0, "head": 2.5}


# Loss weights of rotations that vary little but determine the swing of pelvis, chest and shoulders.
_TRUNK_WEIGHT = dict.fromkeys(("Hips", "LowerBack", "Spine", "Spine1"), 2.5) | dict.fromkeys(
    ("LeftShoulder", "RightShoulder"), 5.0
)


def _field_deviation(values: Tensor, layout: dict[str, slice], scale: dict[str, float]) -> Tensor:
    deviation = values.std(0)
    for name, columns in layout.items():
        own = deviation[columns]
        shared = own.mean().clamp_min(1e-3)
        if name == "root":  # m/s and rad/s: kept apart
            continue
        deviation[columns] = torch.maximum(own, 0.5 * shared) / scale.get(name, 1.0)
    return deviation.clamp_min(1e-4)


@lru_cache
def loss_weights(device: torch.device) -> Tensor:
    """Return the weight of each entry of y in Eq. 11."""
    weights = torch.ones(features.OUTPUT_SIZE, device=device)
    for name, value in _LOSS_WEIGHT.items():
        weights[OUTPUT[name]] = value
    for name in ("joint_positions", "joint_rotations"):
        joints = weights[OUTPUT[name]].view(J, -1)
        for part, value in _PART_WEIGHT.items():
            joints[list(PART_JOINTS[part])] *= value
    for name, value in _TRUNK_WEIGHT.items():
        weights[OUTPUT["joint_rotations"]].view(J, -1)[SPORT_SKELETON.index(name)] *= value
    return weights / weights.mean()
