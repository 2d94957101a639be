"""Losses of the pose that a walk shows, by forward kinematics of the rotations, and of how rollouts move in it."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from sport.runtime.motion.features import FPS, OUTPUT
from sport.runtime.skeleton import J
from sport.training import losses as terms
from sport.training.batches import Normalisation, loss_weights
from sport.training.kinematics import KNEES, knee_flexion, shown_joints
from sport.training.rollouts import ENERGY_FRAMES, SWING_FRAMES, RolloutLanes

SETTLED_FRAMES = 10  # a rollout that began in another pose than its clip's has to move towards it first


def shown_losses(
    normal: Normalisation, lanes: RolloutLanes, target: Tensor, supervised: Tensor, y: Tensor
) -> dict[str, Tensor]:
    """Of the pose that is shown, by forward kinematics of the normalised prediction y `(B, n)`, and of the lanes'
    movements in it: `shown` holds it to the capture, the others are those of `sport.training.losses`."""
    field = OUTPUT["joint_positions"]
    scale = normal.y_deviation[field]
    real = y * normal.y_deviation + normal.y_mean
    joints = shown_joints(real)
    wanted = target[:, field] * scale + normal.y_mean[field]
    weights = _shown_weights(y.device) * supervised[:, field]
    result = {"shown": (weights * ((joints.flatten(1) - wanted) / scale).square()).mean()}

    count = len(lanes.rows)
    result["bend"] = _bend(real, target * normal.y_deviation + normal.y_mean, supervised, count)
    own, kept = joints[-count:], supervised[-count:, field]
    settled = (lanes.age >= SETTLED_FRAMES).float()[:, None]
    velocity = OUTPUT["joint_velocities"]
    moved = (own - lanes.previous_joints()).flatten(1) * FPS
    result["unrest"] = terms.unrest(
        moved, real[-count:, velocity], normal.y_deviation[velocity], kept * settled
    )
    since = SETTLED_FRAMES + SWING_FRAMES
    swings, captured = lanes.swings(own)
    result["swing"] = terms.swing(swings, captured, scale, kept * _older(lanes, since))
    energies = lanes.energies(swings.detach(), captured, since)
    lived = kept * _older(lanes, since + ENERGY_FRAMES)
    result["own_swing"] = terms.own_swing(swings, energies, scale, lived)
    return result


def _older(lanes: RolloutLanes, frames: int) -> Tensor:
    """`(lanes, 1)`: one where a rollout has gone on for so many frames."""
    return (lanes.age >= frames).float()[:, None]


def _bend(real: Tensor, wanted: Tensor, supervised: Tensor, lanes: int) -> Tensor:
    """Of the knees' flexion: its error, and for the last `lanes` rows, out of step as they may be, its distribution."""
    own, captured = knee_flexion(real), knee_flexion(wanted)
    kept = supervised[:, OUTPUT["joint_rotations"]].unflatten(1, (J, 6))[:, KNEES, 0]
    error = (kept * ((own - captured) / terms.BEND).square()).mean()
    chosen = kept[-lanes:].all(1)
    return error + terms.distribution(own[-lanes:][chosen], captured[-lanes:][chosen], terms.BEND)


@lru_cache(2)
def _shown_weights(device: torch.device) -> Tensor:
    """Weight of every joint's position `(93,)`: that of Eq. 11."""
    weights = loss_weights(device)[OUTPUT["joint_positions"]]
    return weights / weights.mean()
