"""Forward kinematics in torch: joint positions, knee flexion and body angles from the rotations in y."""

from functools import lru_cache

import torch
from torch import Tensor
from torch.nn.functional import normalize

from runtime.motion.features import OUTPUT
from runtime.skeleton import SPORT_SKELETON, J
from training.gpu import constant

_PARENTS = [max(parent, 0) for parent in SPORT_SKELETON.parents]


def shown_joints(y: Tensor) -> Tensor:
    """Return root-relative joint positions `(B, 31, 3)` in metres of y `(B, 473)` in physical units.

    The hips are at y's position; the other joints follow from the rotations on the fixed skeleton, as in
    `Controller._pose`.
    """
    chains, offsets = bone_chains(y.device)
    turned = matrices(y[:, OUTPUT["joint_rotations"]].unflatten(1, (J, 6)))
    parents = constant(_PARENTS, y.device)
    bones = (turned[:, parents] @ offsets[:, :, None])[..., 0]
    hips = y[:, OUTPUT["joint_positions"]][:, None, :3]
    return hips + chains @ bones


KNEES = [SPORT_SKELETON.index(name) for name in ("LeftLeg", "RightLeg")]


def knee_flexion(y: Tensor) -> Tensor:
    """Return knee flexion `(B, 2)` in radians of y `(B, 473)` in physical units."""
    turned = matrices(y[:, OUTPUT["joint_rotations"]].unflatten(1, (J, 6)))
    knees = constant(KNEES, y.device)
    thighs = constant([_PARENTS[knee] for knee in KNEES], y.device)
    _, offsets = bone_chains(y.device)
    shins = (turned[:, knees] @ offsets[knees + 1].to(y)[:, :, None])[..., 0]
    seen = (turned[:, thighs].transpose(-1, -2) @ shins[..., None])[..., 0]  # in the frame of the thigh
    return torch.atan2(-seen[..., 2], -seen[..., 1])


_ACROSS = [
    (SPORT_SKELETON.index(f"Left{name}"), SPORT_SKELETON.index(f"Right{name}")) for name in ("UpLeg", "Arm")
]
_FEET = [
    (SPORT_SKELETON.index(f"{side}Foot"), SPORT_SKELETON.index(f"{side}ToeBase"))
    for side in ("Left", "Right")
]
_HEAD = SPORT_SKELETON.index("Head")
TURNED = ("Hips", "Hips", "Shoulders", "Shoulders", "Head", "Head", "Head", "LeftFoot", "RightFoot")
TURNS = len(TURNED)


def turns(y: Tensor, joints: Tensor) -> Tensor:
    """Return root-relative angles in radians `(B, 9)` of y `(B, 473)` in physical units and its joints `(B, 31, 3)`.

    Yaw and roll of the lines across hips and shoulders; yaw, pitch and roll of the head; yaw of the feet: `TURNED`.
    """
    across = torch.stack([joints[:, left] - joints[:, right] for left, right in _ACROSS], dim=1)
    yaw = torch.atan2(-across[..., 2], across[..., 0])
    roll = torch.atan2(across[..., 1], across[..., ::2].norm(dim=-1))
    trunk = torch.stack([yaw, roll], dim=-1).flatten(1)
    head = matrices(y[:, OUTPUT["joint_rotations"]].unflatten(1, (J, 6))[:, _HEAD])
    level = head[:, ::2, 2].norm(dim=-1)
    gaze = [
        torch.atan2(head[:, 0, 2], head[:, 2, 2]),
        torch.atan2(-head[:, 1, 2], level),
        torch.atan2(head[:, 1, 0], head[:, 1, 1]),
    ]
    ahead = torch.stack([joints[:, toe] - joints[:, ankle] for ankle, toe in _FEET], dim=1)
    return torch.cat([trunk, torch.stack(gaze, dim=1), torch.atan2(ahead[..., 0], ahead[..., 2])], dim=1)


def turned_back(vectors: Tensor, turn: Tensor) -> Tensor:
    """Return vectors `(B, n, 3)` in the frame of a root that has since turned by `turn` `(B,)`."""
    c, s = turn.cos()[:, None], turn.sin()[:, None]
    x, y, z = vectors.unbind(-1)
    return torch.stack([c * x - s * z, y, s * x + c * z], dim=-1)


def matrices(d: Tensor) -> Tensor:
    """Return rotation matrices `(..., 3, 3)` of 6D rotations `(..., 6)` by Gram-Schmidt, as `rotations.from_6d`."""
    x = normalize(d[..., :3], dim=-1)
    second = d[..., 3:]
    y = normalize(second - (x * second).sum(-1, keepdim=True) * x, dim=-1)
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


@lru_cache(2)
def bone_chains(device: torch.device) -> tuple[Tensor, Tensor]:
    """Return the mask `(31, 31)` of bones between hips and each joint, and bone offsets `(31, 3)`; the hips' is zero."""
    chains = torch.zeros(J, J)
    for joint, parent in enumerate(SPORT_SKELETON.parents):
        if parent >= 0:
            chains[joint] = chains[parent]
            chains[joint, joint] = 1.0
    offsets = torch.as_tensor(SPORT_SKELETON.offsets, dtype=torch.float32).clone()
    offsets[0] = 0.0
    return chains.to(device), offsets.to(device)
