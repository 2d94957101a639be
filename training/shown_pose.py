"""Losses of the pose that a walk shows, by forward kinematics of the rotations, and of how rollouts move in it."""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor

from runtime.motion.features import FPS, OUTPUT
from runtime.skeleton import SPORT_SKELETON, J
from training import losses as terms
from training.batches import Normalisation, loss_weights
from training.kinematics import KNEES, TURNED, TURNS, knee_flexion, shown_joints, turns
from training.rollouts import ENERGY_FRAMES, SWING_FRAMES, RolloutLanes

_ARMS = [SPORT_SKELETON.index(name) for name in ("LeftArm", "RightArm")]
TURN = 0.15  # radians: unit of turns
MOST_WRONG = 4.0  # of these: a head or foot that points to the other side is not pulled farther than this
TURN_WEIGHT = 6.0  # of a turn beside a joint's coordinate
SETTLED_FRAMES = 10  # a rollout that began in another pose than its clip's has to move towards it first


def shown_losses(
    normal: Normalisation, lanes: RolloutLanes, target: Tensor, supervised: Tensor, y: Tensor
) -> dict[str, Tensor]:
    """Of the pose that is shown, by forward kinematics of the normalised prediction y `(B, n)`, and of the lanes'
    movements in it: `shown` holds it to the capture, the others are those of `training.losses`."""
    field = OUTPUT["joint_positions"]
    scale = normal.y_deviation[field]
    real = y * normal.y_deviation + normal.y_mean
    joints = shown_joints(real)
    wanted = target[:, field] * scale + normal.y_mean[field]
    weights = _shown_weights(y.device) * supervised[:, field]
    result = {"shown": (weights * ((joints.flatten(1) - wanted) / scale).square()).mean()}

    count = len(lanes.rows)
    captured_y = target * normal.y_deviation + normal.y_mean
    result["turn"] = _turn(
        turns(real, joints), turns(captured_y, wanted.unflatten(1, (J, 3))), supervised[:, field]
    )
    result["bend"] = _bend(real, captured_y, supervised, count)
    own, kept = joints[-count:], supervised[-count:, field]
    settled = (lanes.age >= SETTLED_FRAMES).float()[:, None]
    velocity = OUTPUT["joint_velocities"]
    moved = (own - lanes.previous_joints()).flatten(1) * FPS
    result["unrest"] = terms.unrest(
        moved, real[-count:, velocity], normal.y_deviation[velocity], kept * settled
    )
    kept = torch.cat([kept, TURN_WEIGHT * _turns_supervised(kept)], dim=1)
    scale = torch.cat([scale, scale.new_full((TURNS,), TURN)])
    return result | _movement_losses(lanes, lanes.movements(real[-count:], own), scale, kept)


def _movement_losses(
    lanes: RolloutLanes, moved: tuple[Tensor, Tensor], scale: Tensor, kept: Tensor
) -> dict[str, Tensor]:
    """Of the lanes' `movements` and their clips': how far they swing, and where they are on average."""
    since = SETTLED_FRAMES + SWING_FRAMES
    swings, captured = lanes.swings(*moved)
    energies = lanes.energies(swings.detach(), captured, since)
    offsets = lanes.offsets(*moved, since)
    lived = kept * _older(lanes, since + ENERGY_FRAMES)
    return {
        "swing": terms.swing(swings, captured, scale, kept * _older(lanes, since)),
        "own_swing": terms.own_swing(swings, energies, scale, lived),
        "offset": terms.offset(moved[0] - moved[1], offsets, scale, lived),
    }


def _turn(own: Tensor, wanted: Tensor, supervised: Tensor) -> Tensor:
    """Mean square error of `turns` `(B, 9)`, in units of `TURN`."""
    error = torch.remainder(own - wanted + math.pi, 2.0 * math.pi) - math.pi
    error = (error / TURN).clamp(-MOST_WRONG, MOST_WRONG)
    return (_turns_supervised(supervised) * error.square()).mean()


def _turns_supervised(supervised: Tensor) -> Tensor:
    """Which `turns` `(B, 9)` the target says something about, from the coordinates `(B, 93)`."""
    joints = supervised.unflatten(1, (J, 3))[..., 0]
    hips = joints[:, SPORT_SKELETON.index("Hips")]
    of = {name: hips * joints[:, SPORT_SKELETON.index(name)] for name in ("Head", "LeftFoot", "RightFoot")}
    of |= {"Hips": hips, "Shoulders": hips * joints[:, _ARMS].prod(1)}
    return torch.stack([of[name] for name in TURNED], dim=1)


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
