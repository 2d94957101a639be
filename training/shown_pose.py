"""Losses of the pose that a walk shows, by forward kinematics of the rotations, and of how rollouts move in it."""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from sport.runtime.motion.features import FPS, OUTPUT
from sport.runtime.skeleton import SPORT_SKELETON, J
from sport.training import losses as terms
from sport.training.batches import Normalisation, loss_weights
from sport.training.kinematics import KNEES, TRUNK_TURNS, knee_flexion, shown_joints, trunk_turns
from sport.training.rollouts import ENERGY_FRAMES, SWING_FRAMES, RolloutLanes

_ARMS = [SPORT_SKELETON.index(name) for name in ("LeftArm", "RightArm")]
TURN = 0.15  # radians: unit of the trunk's turns
TRUNK_WEIGHT = 6.0  # of a turn of the trunk beside a joint's coordinate
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
    result["turn"] = _turn(joints, wanted, supervised[:, field])
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
    scale = torch.cat([scale, scale.new_full((TRUNK_TURNS,), TURN)])
    kept = torch.cat([kept, TRUNK_WEIGHT * _trunk_supervised(kept)], dim=1)
    result["swing"] = terms.swing(swings, captured, scale, kept * _older(lanes, since))
    energies = lanes.energies(swings.detach(), captured, since)
    lived = kept * _older(lanes, since + ENERGY_FRAMES)
    result["own_swing"] = terms.own_swing(swings, energies, scale, lived)
    return result


def _turn(joints: Tensor, wanted: Tensor, supervised: Tensor) -> Tensor:
    """Mean square error of the trunk's turns, of joints `(B, 31, 3)` against `wanted` `(B, 93)`, in units of `TURN`."""
    error = trunk_turns(joints) - trunk_turns(wanted.unflatten(1, (J, 3)))
    return (_trunk_supervised(supervised) * (error / TURN).square()).mean()


def _trunk_supervised(supervised: Tensor) -> Tensor:
    """Which turns of the trunk `(B, 4)` the target says something about, from the coordinates `(B, 93)`."""
    joints = supervised.unflatten(1, (J, 3))[..., 0]
    hips = joints[:, SPORT_SKELETON.index("Hips")]
    shoulders = hips * joints[:, _ARMS].prod(1)
    return torch.stack([hips, hips, shoulders, shoulders], dim=1)


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
