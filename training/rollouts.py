"""Lanes of autoregressive rollouts that go on from one training step to the next.

A network trained on captured frames alone drifts, or comes to rest, once it sees its own output. Here part of every
batch are lanes: each holds a clip frame and the pose and phases that the network itself produced for the frame before.
The forward pass that trains a lane also moves it on, so that rollouts of any length cost nothing extra.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from runtime.motion import features
from runtime.motion.features import INPUT, OUTPUT
from training.batches import Frames
from training.kinematics import TURNS, shown_joints, turns
from training.part_swaps import Swaps

PRESENT = 60
_POSE = ("joint_positions", "joint_velocities")
# Share of lanes that begin in the pose of another clip. Capture holds no change of style: without these lanes the
# network would stay in the pose it finds itself in, whatever the prompt says.
FOREIGN_POSE = 0.35
ENERGY_FRAMES = 45  # most of a gait cycle: over so many a lane is compared with its own clip
MOVEMENTS = 93 + TURNS  # coordinates of the joints, then turns of trunk, head and feet
SWING_FRAMES = 15  # about a quarter of a gait cycle: over so many frames a swing is compared with the clip's


class RolloutLanes:
    """`lanes` rollouts; each ends by chance after `mean_frames` on average, or with its clip.

    With `part_swaps` some are told of another clip's part, see `training.part_swaps`.
    """

    def __init__(
        self,
        frames: Frames,
        lanes: int,
        mean_frames: float,
        fresh: Iterator[Tensor],
        part_swaps: bool = True,
    ) -> None:
        self.frames = frames
        self.mean_frames = mean_frames
        self._fresh = fresh
        device = frames.phase.device
        self.rows = torch.zeros(lanes, dtype=torch.long, device=device)
        self.patch = torch.zeros(lanes, dtype=torch.long, device=device)
        self.pose = {name: torch.zeros(lanes, 93, device=device) for name in _POSE}
        self.phase = torch.zeros(lanes, 2 * PRESENT + 1, 2 * features.C, device=device)
        self.age = torch.zeros(lanes, dtype=torch.long, device=device)  # frames since it began
        self._history = torch.zeros(SWING_FRAMES, lanes, MOVEMENTS, device=device)  # oldest first
        self._energy = torch.zeros(2, lanes, MOVEMENTS, device=device)  # of swings, the lanes' and the clips'
        self._offset = torch.zeros(lanes, MOVEMENTS, device=device)  # mean of the lanes' less the clips'
        self.swaps = Swaps.none(lanes, device)
        self._part_swaps = part_swaps
        self._restart(torch.ones(lanes, dtype=torch.bool, device=device))

    def _restart(self, ended: Tensor) -> None:
        count = int(ended.sum())
        if not count:
            return
        drawn = next(self._fresh)
        rows = drawn[:count]
        ended = ended.nonzero()[:, 0][: len(rows)]
        if self._part_swaps:
            self.swaps.draw(ended, self.frames.clip[drawn.roll(-count)[: len(rows)]])
        self.rows[ended] = rows
        self.age[ended] = 0
        self._energy[:, ended] = 0.0
        self._offset[ended] = 0.0
        self.patch[ended] = (torch.rand(len(rows), device=rows.device) * self.frames.patches[rows]).long()
        x = self.frames.inputs(rows, self.patch[ended])
        foreign = torch.rand(len(rows), device=rows.device) < FOREIGN_POSE
        order = torch.arange(len(rows), device=rows.device)
        order = torch.where(foreign, order[torch.randperm(len(rows), device=rows.device)], order)
        for name in _POSE:
            self.pose[name][ended] = x[order][:, INPUT[name]]
        index = rows[:, None] - 1 + torch.arange(-PRESENT, PRESENT + 1, device=rows.device)
        index = torch.minimum(
            torch.maximum(index, self.frames.first[rows, None]), self.frames.last[rows, None]
        )
        self.phase[ended] = self.frames.phase[index].flatten(2)

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
        root = self.frames.y[before][:, OUTPUT["root"]].float() / features.FPS
        joints = self.pose["joint_positions"].unflatten(1, (-1, 3))
        ground = (
            self.frames.previous_ground[self.rows, self.patch] - self.frames.ground[self.rows, self.patch]
        )
        x, y, z = joints.unbind(-1)
        x, z = x - root[:, 0:1], z - root[:, 1:2]
        turn = root[:, 2:3]
        c, s = turn.cos(), turn.sin()
        return torch.stack([c * x - s * z, y + ground[:, None], s * x + c * z], -1)

    def movements(self, y: Tensor, joints: Tensor) -> tuple[Tensor, Tensor]:
        """Of the lanes' real-valued y `(lanes, 473)` and joints, and of their clips: `(lanes, 102)` each."""
        return movements(y, joints), self._captured(self.rows)

    def swings(self, own: Tensor, captured: Tensor) -> tuple[Tensor, Tensor]:
        """How far both `movements` have gone in `SWING_FRAMES`. Of no meaning for lanes younger than that."""
        before = (self.rows - SWING_FRAMES).clamp_min(0)
        return own - self._history[0], captured - self._captured(before)

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

    def _captured(self, rows: Tensor) -> Tensor:
        y = self.frames.y[rows].float()
        joints = y[:, OUTPUT["joint_positions"]].unflatten(1, (-1, 3)).clone()
        joints[:, :, 1] -= self.frames.ground[rows, self.patch][:, None]
        return movements(y, joints)

    @torch.no_grad()
    def advance(self, y: Tensor) -> None:
        """Move every lane on by one frame with the network's real-valued y `(lanes, 473)`.

        As in the runtime, what is fed back is the pose shown: forward kinematics of the rotations.
        """
        shown = shown_joints(y)
        self.pose["joint_positions"] = shown.flatten(1)
        self.pose["joint_velocities"] = y[:, OUTPUT["joint_velocities"]].detach().clone()
        self._history = torch.cat([self._history[1:], movements(y, shown)[None]])
        samples = y[:, OUTPUT["phase"]].detach().unflatten(1, (-1, 2 * features.C))
        moved = torch.cat([self.phase[:, 1:], self.phase[:, -1:]], dim=1)
        moved[:, PRESENT:] = _dense(samples)
        self.phase = moved
        self.rows, self.age = self.rows + 1, self.age + 1
        ended = self.rows >= self.frames.last[self.rows.clamp_max(len(self.frames.last) - 1)]
        chance = torch.rand(len(self.rows), device=self.rows.device) < 1.0 / self.mean_frames
        lost = ~torch.isfinite(y).all(1) | (self.pose["joint_positions"].abs().amax(1) > 4.0)
        self._restart(ended | chance | lost)


def movements(y: Tensor, joints: Tensor) -> Tensor:
    """What swings are measured on, `(B, 102)`: coordinates of the joints `(B, 31, 3)`, metres, and `turns`, radians."""
    return torch.cat([joints.flatten(1), turns(y, joints)], dim=1)


def _dense(samples: Tensor) -> Tensor:
    """Every frame `(B, 61, n)` of the seven samples `(B, 7, n)`, linear as in the runtime."""
    step = features.SAMPLE_STEP
    frames = torch.arange((samples.shape[1] - 1) * step + 1, device=samples.device)
    low = (frames // step).clamp_max(samples.shape[1] - 2)
    t = (frames - low * step)[None, :, None] / step
    return (1 - t) * samples[:, low] + t * samples[:, low + 1]
