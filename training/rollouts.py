"""Autoregressive rollouts ("lanes") that continue from one training step to the next.

A network trained on captured frames alone drifts or freezes on its own output. So part of every batch are lanes: each
has a clip frame, and the pose and phases that the network itself produced for the previous frame. The forward pass that
trains a lane also advances it, so that rollouts of any length cost nothing extra.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from runtime.arrays import Array
from runtime.motion import features
from runtime.motion.features import FPS, INPUT, OUTPUT, TRAJECTORY_OFFSETS, L
from training.batches import FrameTensors, RandomRows, window_around
from training.composition import CompositionPlan
from training.gpu import constant, rows_of
from training.kinematics import TURNS, shown_joints, turned_back, turns

PRESENT = 60
_POSE = ("joint_positions", "joint_velocities")
# Fraction of lanes that start from another clip's pose. Captures contain no change of style: without these lanes the
# network would keep its present pose regardless of the prompt.
FOREIGN_POSE_FRACTION = 0.5
ENERGY_FRAMES = 45  # averaging time, most of a gait cycle, for comparing a lane with its clip
MOVEMENTS = 93 + TURNS  # joint coordinates, then angles of trunk, head and feet
PLANNED_FRAMES = 60  # minimum remaining length of a part's clip
RENEWED = 4  # lanes restart only every so many steps, so they end so many frames before their clip
SWING_FRAMES = 15  # about a quarter of a gait cycle: time difference over which swings are measured


class RolloutLanes:
    """A set of rollouts; each ends at random, after `mean_frames` on average, or with its clip.

    Some have parts of other clips throughout, see `training.composition`. All state keeps its memory addresses
    (`training.gpu`).
    """

    def __init__(
        self,
        frames: FrameTensors,
        lanes: int,
        mean_frames: float,
        fresh: Iterator[Tensor],
        often: float = 1.0,
    ) -> None:
        self.frames = frames
        self.mean_frames = mean_frames
        self._fresh = fresh
        self._often = often  # factor on the frequency of composed lanes, see `Composer.draw`
        device = frames.phase.device
        self.rows = torch.zeros(lanes, dtype=torch.long, device=device)
        self.patch = torch.zeros(lanes, dtype=torch.long, device=device)
        self.pose = {name: torch.zeros(lanes, 93, device=device) for name in _POSE}
        self.phase = torch.zeros(lanes, 2 * PRESENT + 1, 2 * features.C, device=device)
        self.age = torch.zeros(lanes, dtype=torch.long, device=device)  # frames since its start
        # movements of the last frames, oldest first, of lanes and clips
        self._history = torch.zeros(2, SWING_FRAMES, lanes, MOVEMENTS, device=device)
        self._energy = torch.zeros(2, lanes, MOVEMENTS, device=device)  # of swings, of lanes and clips
        self._offset = torch.zeros(lanes, MOVEMENTS, device=device)  # mean difference of lanes from clips
        self.plan = CompositionPlan.nothing(lanes, device)
        self._coming = torch.zeros(lanes, dtype=torch.long, device=device)  # frames at which lanes restart
        self._steps, self._renews = 0, True
        self.draw()
        self._restart(torch.ones(lanes, dtype=torch.bool, device=device))

    def draw(self) -> bool:
        """Prepare a step: return whether lanes may restart in it (every `RENEWED` steps), and draw the frames for it."""
        self._renews = self._steps % RENEWED == 0
        self._steps += 1
        if self._renews:
            self._coming.copy_(next(self._fresh)[: len(self._coming)])
        return self._renews

    def _restart(self, ended: Tensor) -> None:
        """Restart the lanes that have `ended` `(lanes,)`."""
        at = rows_of(ended)
        began, rows = ended[at], self._coming[at]
        plan = self.frames.plan(rows, PLANNED_FRAMES, self._often)
        patch = (torch.rand(len(rows), device=rows.device) * self.frames.patches[rows]).long()
        x, _ = self.frames.pairs(rows, patch, plan)
        foreign = torch.rand(len(rows), device=rows.device) < FOREIGN_POSE_FRACTION
        order = torch.arange(len(rows), device=rows.device)
        order = torch.where(foreign, torch.rand(len(rows), device=rows.device).argsort(), order)
        offsets = torch.arange(-PRESENT - 1, PRESENT, device=rows.device)
        index = window_around(rows, offsets, self.frames.first, self.frames.last)
        for own, new in (
            (self.rows, rows),
            (self.patch, patch),
            (self.phase, self.frames.phase[index].flatten(2)),
            *((self.pose[name], x[order][:, INPUT[name]]) for name in _POSE),
            *zip(vars(self.plan).values(), vars(plan).values(), strict=True),
        ):
            own[at] = torch.where(began.view(-1, *[1] * (new.ndim - 1)), new, own[at])
        self.age.masked_fill_(ended, 0)
        self._energy.masked_fill_(ended[:, None], 0.0)
        self._offset.masked_fill_(ended[:, None], 0.0)

    def inputs(self) -> Tensor:
        """Return x `(lanes, 472)`: the captured trajectory with the lane's own pose and phases."""
        x = self.frames.inputs(self.rows, self.patch)
        for name in _POSE:
            x[:, INPUT[name]] = self.pose[name]
        x[:, INPUT["phase"]] = self.phase[:, :: features.SAMPLE_STEP].flatten(1)
        return x

    def previous_joints(self) -> Tensor:
        """Return the last pose of each lane, `(lanes, 31, 3)` in metres, relative to the root of the next frame."""
        before = (self.rows - 1).clamp_min(0)
        root = self.frames.y[before][:, OUTPUT["root"]].float() / FPS
        joints = self.pose["joint_positions"].unflatten(1, (-1, 3))
        ground = (
            self.frames.previous_ground[self.rows, self.patch] - self.frames.ground[self.rows, self.patch]
        )
        moved = torch.stack([-root[:, 0], ground, -root[:, 1]], dim=1)
        return turned_back(joints + moved[:, None], root[:, 2])

    def swings(self, own: Tensor, captured: Tensor) -> tuple[Tensor, Tensor]:
        """Return changes of the `movements` of lanes and clips over `SWING_FRAMES`; undefined for younger lanes."""
        return own - self._history[0, 0], captured - self._history[1, 0]

    @torch.no_grad()
    def offsets(self, own: Tensor, captured: Tensor, since: int) -> Tensor:
        """Update and return running means over `ENERGY_FRAMES` of the lanes' `movements` minus the clips', `(lanes, 102)`.

        They start when a lane is `since` frames old, as in `energies`. Call it in every frame.
        """
        away = (own - captured) * (self.age >= since)[:, None]
        self._offset += (away - self._offset) / ENERGY_FRAMES
        return self._offset

    @torch.no_grad()
    def energies(self, own: Tensor, captured: Tensor, since: int) -> Tensor:
        """Update and return running mean squares over `ENERGY_FRAMES` of `swings`, `(2, lanes, 102)`; call it in every frame.

        They start when a lane is `since` frames old: before, it moves to the pose that its words describe.
        """
        squares = torch.stack([own, captured]).square() * (self.age >= since)[:, None]
        self._energy += (squares - self._energy) / ENERGY_FRAMES
        return self._energy

    @torch.no_grad()
    def advance(self, y: Tensor, target: Tensor) -> None:
        """Advance every lane by one frame with the network's y `(lanes, 473)` in physical units; `target` is the clips' y.

        As in the runtime, the displayed pose is fed back: forward kinematics of the rotations.
        """
        shown = shown_joints(y)
        self.pose["joint_positions"].copy_(shown.flatten(1))
        self.pose["joint_velocities"].copy_(y[:, OUTPUT["joint_velocities"]])
        captured = target[:, OUTPUT["joint_positions"]].unflatten(1, (-1, 3))
        moved = torch.stack([movements(y, shown), movements(target, captured)])
        self._history.copy_(torch.cat([self._history[:, 1:], moved[:, None]], dim=1))
        samples = y[:, OUTPUT["phase"]].unflatten(1, (-1, 2 * features.C))
        self.phase.copy_(torch.cat([self.phase[:, 1 : PRESENT + 1], _dense(samples)], dim=1))
        self.rows += 1
        self.age += 1
        if self._renews:
            self._restart(self._ended())

    def _ended(self) -> Tensor:
        """Return which lanes end, `(lanes,)`: at random, near the end of a clip in use, or when the pose diverged."""
        ahead = (self.rows + RENEWED - 1).clamp_max(len(self.frames.last) - 1)
        ended = ahead >= self.frames.last[self.rows.clamp_max(len(self.frames.last) - 1)]
        if self.frames.composer is not None:
            ended |= ~self.frames.composer.lasts(ahead, self.plan)
        chance = torch.rand(len(ahead), device=ahead.device) < RENEWED / self.mean_frames
        kept = self.pose["joint_positions"].abs().amax(1) <= 4.0  # NaN counts as diverged
        return ended | chance | ~kept

    def state_dict(self) -> dict[str, object]:
        """Return all state that later steps depend on."""
        return {name: getattr(self, name) for name in _STATE} | {
            "steps": self._steps,
            "pose": self.pose,
            "plan": vars(self.plan),
            "fresh": self._fresh.state_dict() if isinstance(self._fresh, RandomRows) else {},
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from a saved state."""
        device = self.rows.device
        self._steps = state["steps"]
        for name in _STATE:
            setattr(self, name, state[name].to(device))
        self.pose = {name: value.to(device) for name, value in state["pose"].items()}
        self.plan = CompositionPlan(**{name: value.to(device) for name, value in state["plan"].items()})
        if isinstance(self._fresh, RandomRows):
            self._fresh.load_state_dict(state["fresh"])


_STATE = ("rows", "patch", "phase", "age", "_history", "_energy", "_offset")


def movements(y: Tensor, joints: Tensor) -> Tensor:
    """Return the quantities whose swings are measured, `(B, 102)`: coordinates of `joints` `(B, 31, 3)` in m, `turns` in rad."""
    return torch.cat([joints.flatten(1), turns(y, joints)], dim=1)


def _dense(samples: Tensor) -> Tensor:
    """Interpolate seven samples `(B, 7, n)` linearly to every frame `(B, 61, n)`, as in the runtime."""
    step = features.SAMPLE_STEP
    frames = torch.arange((samples.shape[1] - 1) * step + 1, device=samples.device)
    low = (frames // step).clamp_max(samples.shape[1] - 2)
    t = (frames - low * step)[None, :, None] / step
    return (1 - t) * samples[:, low] + t * samples[:, low + 1]


EXACT_PATH_FRACTION = 0.35  # of rows that keep the captured path


def steered(x: Tensor) -> Tensor:
    """Return x `(B, n)` in physical units with path and facing of random rows smoothed towards parabolas through the root.

    Captured paths sway with every step. A network that infers the step from this sway loses it on the smooth path of a
    stick: hands and feet swung a fifth less at the same speed. The future path of most rows is smoothed completely, the
    past, which the character walked itself, by a random amount.
    """
    count = len(x)
    free = (torch.rand(count, 1, device=x.device) >= EXACT_PATH_FRACTION).float()
    past = free * torch.rand(count, 1, device=x.device)
    coming = free * (1.5 * torch.rand(count, 1, device=x.device)).clamp_max(1.0)
    ahead = constant((TRAJECTORY_OFFSETS > 0).tolist(), x.device)
    weight = torch.where(ahead, coming, past)[..., None]
    result = x.clone()
    for name, fit in zip(("trajectory_positions", "trajectory_directions"), _fits(x.device), strict=True):
        values = x[:, INPUT[name]].unflatten(1, (L, 2))
        values = values + weight * (fit @ values - values)
        if name == "trajectory_directions":
            values = torch.nn.functional.normalize(values, dim=-1)
        result[:, INPUT[name]] = values.flatten(1)
    return result


@lru_cache(2)
def _fits(device: torch.device) -> tuple[Tensor, Tensor]:
    """Return least-squares parabola fits to the 12 samples as `(12, 12)`: through the root for positions, free for directions."""
    time = np.asarray(TRAJECTORY_OFFSETS) / FPS
    powers = np.stack([time**k for k in range(3)], 1)

    def fit(basis: Array) -> Tensor:
        return torch.as_tensor(basis @ np.linalg.pinv(basis), dtype=torch.float32, device=device)

    return fit(powers[:, 1:]), fit(powers)
