"""A skinned mesh with its joints, posed by the SPORT skeleton."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.joints import Alignment
from runtime.skeleton import SPORT_SKELETON


@dataclass(frozen=True)
class Surface:
    """Triangles in the bind pose with the joints and weights of each vertex; colours are linear RGB."""

    positions: AnyArray  # (V, 3) float32
    normals: AnyArray  # (V, 3) float32, unit
    colors: AnyArray  # (V, 3) float32, linear RGB 0..1
    joint_indices: AnyArray  # (V, 4) uint16
    joint_weights: AnyArray  # (V, 4) float32, rows sum to one
    triangles: AnyArray  # (F, 3) uint32, counter-clockwise from outside


@dataclass(frozen=True)
class SkinnedMesh(Surface):
    """A surface with its joints, driven by the SPORT skeleton.

    `sport_joints` `(K,)` is the SPORT joint that drives each joint, -1 if the joint follows its parent rigidly.
    """

    joint_names: tuple[str, ...]
    joint_parents: tuple[int, ...]  # parents before children is not guaranteed; -1 at roots
    inverse_bind: AnyArray  # (K, 4, 4) float32
    rest_world: AnyArray  # (K, 4, 4) float32
    sport_joints: AnyArray  # (K,)
    alignment: Alignment
    size: float = 1.0  # its own size relative to ours; it is drawn at ours, see `Terrain.seen_by`

    def joint_transforms(self, positions: AnyArray, world_rotations: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Return pivots `(..., K, 3)` and rotations from rest `(..., K, 4)` of the character's joints in a SPORT pose.

        `positions` `(..., 31, 3)` and `world_rotations` `(..., 31, 4)` are the pose's joints, any leading shape.
        """
        a = self.alignment
        if a.native:
            return positions, world_rotations
        lead, order = positions.shape[:-2], list(a.order)
        turns = np.empty((*lead, len(a.driver), 4), np.float64)
        turns[..., order, :] = rotations.multiply(
            world_rotations[..., a.source[order], :], a.turns[order].astype(np.float64)
        )
        rigid = np.flatnonzero(a.source < 0)
        turns[..., rigid, :] = turns[..., a.driver[rigid], :]
        arms = rotations.rotate(turns[..., a.anchor, :], a.arms)
        pivots = np.empty((*lead, len(a.driver), 3), np.float64)
        pivots[..., order[0], :] = self._hips(positions, turns[..., order[0], :])
        for k in order[1:]:
            pivots[..., k, :] = pivots[..., a.anchor[k], :] + arms[..., k, :]
        pivots[..., rigid, :] = pivots[..., a.driver[rigid], :] + arms[..., rigid, :]
        return pivots, turns

    def _hips(self, positions: AnyArray, hips_turn: AnyArray) -> AnyArray:
        left, right = (SPORT_SKELETON.index(name) for name in ("LeftUpLeg", "RightUpLeg"))
        middle = 0.5 * (positions[..., left, :] + positions[..., right, :])
        lift = np.array([0.0, self.alignment.lift, 0.0])
        return middle + lift + rotations.rotate(hips_turn, self.alignment.hips_offset)

    def joint_matrices(self, positions: AnyArray, world_rotations: AnyArray) -> AnyArray:
        """Return world matrices `(..., K, 4, 4)` of the joints in a SPORT pose given as in `joint_transforms`."""
        pivots, turns = self.joint_transforms(positions, world_rotations)
        matrices = np.zeros((*pivots.shape[:-1], 4, 4), np.float32)
        matrices[..., :3, :3] = rotations.to_matrix(turns) @ self.alignment.basis
        matrices[..., :3, 3] = pivots
        matrices[..., 3, 3] = 1.0
        return matrices

    @cached_property
    def rest(self) -> tuple[AnyArray, AnyArray]:
        """Vertices `(V, 3)` and pivots `(K, 3)` in the SPORT rest pose."""
        still = rotations.identity((len(SPORT_SKELETON),)).astype(np.float64)
        rest = SPORT_SKELETON.rest_positions.astype(np.float64)
        vertices = skin_vertices(self, self.joint_matrices(rest, still) @ self.inverse_bind)
        return vertices, self.joint_transforms(rest, still)[0]


def skin_vertices(mesh: SkinnedMesh, matrices: AnyArray) -> AnyArray:
    """Return vertices `(V, 3)` skinned on the CPU by `matrices` `(K, 4, 4)`."""
    blended = np.einsum("vi,vijk->vjk", mesh.joint_weights, matrices[mesh.joint_indices, :3])
    return np.einsum("vjk,vk->vj", blended[..., :3], mesh.positions) + blended[..., 3]
