"""Losses of the pose that a walk shows, by forward kinematics of the rotations, and of how rollouts move in it."""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor

from runtime.motion.features import FPS, OUTPUT
from runtime.skeleton import J
from training import losses as terms
from training.batches import Normalisation, loss_weights
from training.kinematics import TURNS, knee_flexion, shown_joints, turns
from training.rollouts import ENERGY_FRAMES, SWING_FRAMES, RolloutLanes, movements

TURN = 0.15  # radians: unit of turns
MOST_WRONG = 4.0  # of these: a head or foot that points to the other side is not pulled farther than this
TURN_WEIGHT = 6.0  # of a turn beside a joint's coordinate
SETTLED_FRAMES = 10  # a rollout that began in another pose than its clip's has to move towards it first


def shown_losses(normal: Normalisation, lanes: RolloutLanes, target: Tensor, y: Tensor) -> dict[str, Tensor]:
    """Of the pose that is shown, by forward kinematics of the normalised prediction y `(B, n)`, and of the lanes'
    movements in it: `shown` holds it to the capture, the others are those of `training.losses`."""
    field = OUTPUT["joint_positions"]
    scale = normal.y_deviation[field]
    real = y * normal.y_deviation + normal.y_mean
    joints = shown_joints(real)
    wanted = target[:, field] * scale + normal.y_mean[field]
    weights = _shown_weights(y.device)
    result = {"shown": (weights * ((joints.flatten(1) - wanted) / scale).square()).mean()}

    count = len(lanes.rows)
    captured = target * normal.y_deviation + normal.y_mean
    wanted_joints = wanted.unflatten(1, (J, 3))
    result["turn"] = _turn(turns(real, joints), turns(captured, wanted_joints))
    result["bend"] = _bend(real, captured, count)
    own = joints[-count:]
    velocity = OUTPUT["joint_velocities"]
    moved = (own - lanes.previous_joints()).flatten(1) * FPS
    settled = _older(lanes, SETTLED_FRAMES).expand_as(moved)
    result["unrest"] = terms.unrest(moved, real[-count:, velocity], normal.y_deviation[velocity], settled)
    both = movements(real[-count:], own), movements(captured[-count:], wanted_joints[-count:])
    return result | _movement_losses(lanes, both, torch.cat([scale, scale.new_full((TURNS,), TURN)]))


def _movement_losses(lanes: RolloutLanes, moved: tuple[Tensor, Tensor], scale: Tensor) -> dict[str, Tensor]:
    """Of the lanes' `movements` and their clips': how far they swing, and where they are on average."""
    since = SETTLED_FRAMES + SWING_FRAMES
    kept = torch.ones_like(moved[0])
    kept[:, -TURNS:] = TURN_WEIGHT
    swings, captured = lanes.swings(*moved)
    energies = lanes.energies(swings.detach(), captured, since)
    offsets = lanes.offsets(*moved, since)
    lived = kept * _older(lanes, since + ENERGY_FRAMES)
    return {
        "swing": terms.swing(swings, captured, scale, kept * _older(lanes, since)),
        "own_swing": terms.own_swing(swings, energies, scale, lived),
        "offset": terms.offset(moved[0] - moved[1], offsets, scale, lived),
    }


def _turn(own: Tensor, wanted: Tensor) -> Tensor:
    """Mean square error of `turns` `(B, 9)`, in units of `TURN`."""
    error = torch.remainder(own - wanted + math.pi, 2.0 * math.pi) - math.pi
    error = (error / TURN).clamp(-MOST_WRONG, MOST_WRONG)
    return error.square().mean()


def _older(lanes: RolloutLanes, frames: int) -> Tensor:
    """`(lanes, 1)`: one where a rollout has gone on for so many frames."""
    return (lanes.age >= frames).float()[:, None]


def _bend(real: Tensor, wanted: Tensor, lanes: int) -> Tensor:
    """Of the knees' flexion: its error, and for the last `lanes` rows, out of step as they may be, its distribution."""
    own, captured = knee_flexion(real), knee_flexion(wanted)
    error = ((own - captured) / terms.BEND).square().mean()
    return error + terms.distribution(own[-lanes:], captured[-lanes:], terms.BEND)


@lru_cache(2)
def _shown_weights(device: torch.device) -> Tensor:
    """Weight of every joint's position `(93,)`: that of Eq. 11."""
    weights = loss_weights(device)[OUTPUT["joint_positions"]]
    return weights / weights.mean()
