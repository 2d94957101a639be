"""Lanes of autoregressive rollouts that go on from one training step to the next.

A network trained on captured frames alone drifts, or comes to rest, once it sees its own output. Here part of every
batch are lanes: each holds a clip frame and the pose and phases that the network itself produced for the frame before.
The forward pass that trains a lane also moves it on, so that rollouts of any length cost nothing extra.
"""

from __future__ import annotations

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
# Fraction of lanes that begin in the pose of another clip. Capture holds no change of style: without these lanes the
# network would stay in the pose it finds itself in, whatever the prompt says.
FOREIGN_POSE_FRACTION = 0.5
ENERGY_FRAMES = 45  # most of a gait cycle: over so many a lane is compared with its own clip
MOVEMENTS = 93 + TURNS  # coordinates of the joints, then turns of trunk, head and feet
PLANNED_FRAMES = 60  # that a part of another clip goes on at least
RENEWED = 4  # steps from one to the next in which lanes may begin anew: they end so many frames before their clip does
SWING_FRAMES = 15  # about a quarter of a gait cycle: over so many frames a swing is compared with the clip's


class RolloutLanes:
    """`lanes` rollouts; each ends by chance after `mean_frames` on average, or with its clip.

    Some carry parts of other clips all along, see `training.composition`. All that is remembered stays where it is in
    memory (`training.gpu`).
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
        self._often = often  # parts of other clips are put on a lane, see `Composer.draw`
        device = frames.phase.device
        self.rows = torch.zeros(lanes, dtype=torch.long, device=device)
        self.patch = torch.zeros(lanes, dtype=torch.long, device=device)
        self.pose = {name: torch.zeros(lanes, 93, device=device) for name in _POSE}
        self.phase = torch.zeros(lanes, 2 * PRESENT + 1, 2 * features.C, device=device)
        self.age = torch.zeros(lanes, dtype=torch.long, device=device)  # frames since it began
        # movements of the last frames, oldest first: the lanes' and the clips'
        self._history = torch.zeros(2, SWING_FRAMES, lanes, MOVEMENTS, device=device)
        self._energy = torch.zeros(2, lanes, MOVEMENTS, device=device)  # of swings, the lanes' and the clips'
        self._offset = torch.zeros(lanes, MOVEMENTS, device=device)  # mean of the lanes' less the clips'
        self.plan = CompositionPlan.nothing(lanes, device)
        self._coming = torch.zeros(lanes, dtype=torch.long, device=device)  # where lanes begin anew
        self._steps, self._renews = 0, True
        self.draw()
        self._restart(torch.ones(lanes, dtype=torch.bool, device=device))

    def draw(self) -> bool:
        """Before a step: whether lanes may begin anew in it, `RENEWED` steps after they last could, and where."""
        self._renews = self._steps % RENEWED == 0
        self._steps += 1
        if self._renews:
            self._coming.copy_(next(self._fresh)[: len(self._coming)])
        return self._renews

    def _restart(self, ended: Tensor) -> None:
        """Begin the lanes that have `ended` `(lanes,)` anew."""
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
        """x `(lanes, 472)`: the captured trajectory, the lane's own pose and phases."""
        x = self.frames.inputs(self.rows, self.patch)
        for name in _POSE:
            x[:, INPUT[name]] = self.pose[name]
        x[:, INPUT["phase"]] = self.phase[:, :: features.SAMPLE_STEP].flatten(1)
        return x

    def previous_joints(self) -> Tensor:
        """The pose that each lane goes on from, `(lanes, 31, 3)` in metres, seen from the root of the coming frame."""
        before = (self.rows - 1).clamp_min(0)
        root = self.frames.y[before][:, OUTPUT["root"]].float() / FPS
        joints = self.pose["joint_positions"].unflatten(1, (-1, 3))
        ground = (
            self.frames.previous_ground[self.rows, self.patch] - self.frames.ground[self.rows, self.patch]
        )
        moved = torch.stack([-root[:, 0], ground, -root[:, 1]], dim=1)
        return turned_back(joints + moved[:, None], root[:, 2])

    def swings(self, own: Tensor, captured: Tensor) -> tuple[Tensor, Tensor]:
        """Changes of the `movements` of lanes and clips within `SWING_FRAMES`; without meaning for younger lanes."""
        return own - self._history[0, 0], captured - self._history[1, 0]

    @torch.no_grad()
    def offsets(self, own: Tensor, captured: Tensor, since: int) -> Tensor:
        """Running means over `ENERGY_FRAMES` of what `movements` gave, the lanes' less the clips', `(lanes, 102)`.

        They begin where a lane is `since` frames old, as `energies`; it is called in every frame.
        """
        away = (own - captured) * (self.age >= since)[:, None]
        self._offset += (away - self._offset) / ENERGY_FRAMES
        return self._offset

    @torch.no_grad()
    def energies(self, own: Tensor, captured: Tensor, since: int) -> Tensor:
        """Running means of squares over `ENERGY_FRAMES` of what `swings` gave, `(2, lanes, 102)`; it is called in every frame.

        They begin where a lane is `since` frames old: what goes before is its way to the pose of its words.
        """
        squares = torch.stack([own, captured]).square() * (self.age >= since)[:, None]
        self._energy += (squares - self._energy) / ENERGY_FRAMES
        return self._energy

    @torch.no_grad()
    def advance(self, y: Tensor, target: Tensor) -> None:
        """Move every lane on by one frame with the network's real-valued y `(lanes, 473)`; `target` is their clips'.

        As in the runtime, what is fed back is the pose shown: forward kinematics of the rotations.
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
        """By chance, soon with the clip or a part's clip, or because the pose is lost; `(lanes,)`."""
        ahead = (self.rows + RENEWED - 1).clamp_max(len(self.frames.last) - 1)
        ended = ahead >= self.frames.last[self.rows.clamp_max(len(self.frames.last) - 1)]
        if self.frames.composer is not None:
            ended |= ~self.frames.composer.lasts(ahead, self.plan)
        chance = torch.rand(len(ahead), device=ahead.device) < RENEWED / self.mean_frames
        kept = self.pose["joint_positions"].abs().amax(1) <= 4.0  # not a number is lost too
        return ended | chance | ~kept

    def state_dict(self) -> dict[str, object]:
        """Everything that the next steps depend on."""
        return {name: getattr(self, name) for name in _STATE} | {
            "steps": self._steps,
            "pose": self.pose,
            "plan": vars(self.plan),
            "fresh": self._fresh.state_dict() if isinstance(self._fresh, RandomRows) else {},
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from there."""
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
    """The quantities whose swings are measured, `(B, 102)`: coordinates of the joints `(B, 31, 3)`, metres, and `turns`, radians."""
    return torch.cat([joints.flatten(1), turns(y, joints)], dim=1)


def _dense(samples: Tensor) -> Tensor:
    """Every frame `(B, 61, n)` of the seven samples `(B, 7, n)`, linear as in the runtime."""
    step = features.SAMPLE_STEP
    frames = torch.arange((samples.shape[1] - 1) * step + 1, device=samples.device)
    low = (frames // step).clamp_max(samples.shape[1] - 2)
    t = (frames - low * step)[None, :, None] / step
    return (1 - t) * samples[:, low] + t * samples[:, low + 1]


EXACT_PATH_FRACTION = 0.35  # fraction of rows whose path stays as captured


def steered(x: Tensor) -> Tensor:
    """Real-valued x `(B, n)` whose paths and facing are drawn towards parabolas through the root, each row by chance.

    Captured paths sway with every step, and a network that reads its step off them loses it where the path is even: led by
    a stick, hands and feet swung a fifth less at the same speed. The coming path of most rows is smooth altogether; of the
    past, which the character walked itself, a random part is.
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
    """Least-squares parabolas of the 12 samples as `(12, 12)`: of positions through the root, of directions free."""
    time = np.asarray(TRAJECTORY_OFFSETS) / FPS
    powers = np.stack([time**k for k in range(3)], 1)

    def fit(basis: Array) -> Tensor:
        return torch.as_tensor(basis @ np.linalg.pinv(basis), dtype=torch.float32, device=device)

    return fit(powers[:, 1:]), fit(powers)
