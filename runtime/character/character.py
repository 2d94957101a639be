"""Skinned characters from glTF files: ours, or a user's own, driven by poses of the SPORT skeleton."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.body_surface import BodySurface, fit_surface
from runtime.character.guess import JointGuess, guess_joints, require
from runtime.character.hand_contact import clear_hands
from runtime.character.joint_map import saved_joint_map
from runtime.character.joints import Alignment, align
from runtime.character.mesh import MeshData, read_meshes
from runtime.character.planted_feet import Soles, find_soles, plant_feet
from runtime.character.read import MAX_VALUE, REMEDY, STRUCTURE_ERRORS, GltfFile, open_gltf
from runtime.errors import FileError
from runtime.pose import Pose
from runtime.safe_read import is_text, reason
from runtime.skeleton import SPORT_SKELETON

DEFAULT_CHARACTER = "character/mannequin.glb"  # an asset
FILE_UNITS = (1.0, 0.01, 0.1, 0.0254, 0.001)  # metres of a unit of files, the most common first
SMALLEST_M, LARGEST_M = 0.3, 8.0
MIN_SIZE, MAX_SIZE = 0.1, 10.0


@dataclass(frozen=True)
class Character:
    """A skinned mesh in its bind pose and the joints that carry it; colours are linear RGB.

    `sport_joints` `(K,)` is the SPORT joint that drives each joint, -1 where it follows its parent rigidly.
    """

    positions: AnyArray  # (V, 3) float32
    normals: AnyArray  # (V, 3) float32, unit
    colors: AnyArray  # (V, 3) float32, linear RGB 0..1
    joint_indices: AnyArray  # (V, 4) uint16
    joint_weights: AnyArray  # (V, 4) float32, rows sum to one
    triangles: AnyArray  # (F, 3) uint32, counter-clockwise from outside
    joint_names: tuple[str, ...]
    joint_parents: tuple[int, ...]  # parents before children is not guaranteed; -1 at roots
    inverse_bind: AnyArray  # (K, 4, 4) float32
    rest_world: AnyArray  # (K, 4, 4) float32
    sport_joints: AnyArray  # (K,)
    alignment: Alignment
    size: float = (
        1.0  # metres of a metre of ours in its own size; drawn and moved in ours, see `Terrain.seen_by`
    )

    def joint_transforms(self, positions: AnyArray, world_rotations: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Pivots `(..., K, 3)` and turns from the rest pose `(..., K, 4)` of the character's joints in a SPORT pose.

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
        """World matrices `(..., K, 4, 4)` of the joints in a SPORT pose given as in `joint_transforms`."""
        pivots, turns = self.joint_transforms(positions, world_rotations)
        matrices = np.zeros((*pivots.shape[:-1], 4, 4), np.float32)
        matrices[..., :3, :3] = rotations.to_matrix(turns) @ self.alignment.basis
        matrices[..., :3, 3] = pivots
        matrices[..., 3, 3] = 1.0
        return matrices

    def skin_matrices(self, pose: Pose) -> AnyArray:
        """Skinning matrices `(K, 4, 4)` float32 that carry bind-pose vertices to world space in `pose`.

        It stands on its own feet (`adapted`).
        """
        positions, world = self.adapted(pose.positions, pose.world_rotations, pose.contacts)
        return (self.joint_matrices(positions, world) @ self.inverse_bind).astype(np.float32)

    def adapted(
        self, positions: AnyArray, world_rotations: AnyArray, contacts: AnyArray
    ) -> tuple[AnyArray, AnyArray]:
        """A SPORT pose of any leading shape as this body shows it: feet planted, hands on its own surface."""
        if not self.alignment.native:
            positions, world_rotations = plant_feet(self, positions, world_rotations, contacts)
        return clear_hands(self, positions, world_rotations)

    @cached_property
    def soles(self) -> Soles:
        """The feet, as they differ from ours."""
        vertices, pivots = self._rest
        return find_soles(self, vertices, np.asarray(pivots, np.float64))

    @cached_property
    def body(self) -> BodySurface | None:
        """The surface that hands end at, None where the mesh has none."""
        vertices, pivots = self._rest
        return fit_surface(self, vertices, np.asarray(pivots, np.float64))

    @cached_property
    def height(self) -> float:
        """Metres from the lowest to the highest vertex in our rest pose."""
        return float(np.ptp(self._rest[0][:, 1]))

    @cached_property
    def _rest(self) -> tuple[AnyArray, AnyArray]:
        """Vertices `(V, 3)` and pivots `(K, 3)` in our rest pose."""
        still = rotations.identity((len(SPORT_SKELETON),)).astype(np.float64)
        rest = SPORT_SKELETON.rest_positions.astype(np.float64)
        vertices = skin_vertices(self, self.joint_matrices(rest, still) @ self.inverse_bind)
        return vertices, self.joint_transforms(rest, still)[0]


def skin_vertices(character: Character, matrices: AnyArray) -> AnyArray:
    """Vertices `(V, 3)` skinned on the CPU by `matrices` `(K, 4, 4)`."""
    blended = np.einsum("vi,vijk->vjk", character.joint_weights, matrices[character.joint_indices, :3])
    return np.einsum("vjk,vk->vj", blended[..., :3], character.positions) + blended[..., 3]


def load_character(path: str | Path, joint_map: Mapping[str, str] | None = None) -> Character:
    """Load a skinned .glb, .gltf or .vrm; FileError names the file, what is wrong and what to do.

    Joints are found by known names or by the tree and the rest pose (`guess_joints`). `joint_map` (SPORT joint name ->
    joint name in the file, "" for none) overrides them one by one; by default it is the one beside the file.
    """
    file = open_gltf(Path(path))
    chosen = saved_joint_map(path) if joint_map is None else joint_map
    try:
        with np.errstate(all="ignore"):  # what comes of it is checked
            character = _assemble(file, read_meshes(file), chosen)
    except STRUCTURE_ERRORS as error:
        raise FileError(f"{file.name}: damaged glTF structure ({reason(error)}).", REMEDY) from error
    _check_finite(file, character)
    return character


def joints_of(path: str | Path, joint_map: Mapping[str, str] | None = None) -> JointGuess:
    """What the joints of a character file play, also where some are missing; FileError as `load_character`."""
    file = open_gltf(Path(path))
    chosen = saved_joint_map(path) if joint_map is None else joint_map
    try:
        with np.errstate(all="ignore"):
            data = read_meshes(file)
            return guess_joints(file.path, data, _names(file, data), chosen)[0]
    except STRUCTURE_ERRORS as error:
        raise FileError(f"{file.name}: damaged glTF structure ({reason(error)}).", REMEDY) from error


def _names(file: GltfFile, data: MeshData) -> tuple[str, ...]:
    nodes = file.gltf.nodes
    return tuple(nodes[n].name if is_text(nodes[n].name) else f"node{n}" for n in data.joint_nodes)


def _check_finite(file: GltfFile, character: Character) -> None:
    """FileError where scales of zero and the like have made numbers that nothing can be drawn with."""
    for holder in (character, character.alignment):
        for field in fields(holder):
            value = getattr(holder, field.name)
            real = isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f")
            if real and not np.all(np.abs(value) < MAX_VALUE):
                raise FileError(
                    f"{file.name}: the {field.name.replace('_', ' ')} of its skeleton are not finite.", REMEDY
                )


def _assemble(file: GltfFile, data: MeshData, joint_map: Mapping[str, str]) -> Character:
    names = _names(file, data)
    guess, data = guess_joints(file.path, data, names, joint_map)
    require(file.path, guess)
    vertices = data.rest_positions()
    alignment = align(guess.found, data.joint_parents, data.rest_world, vertices)
    return Character(
        positions=data.positions,
        normals=data.normals,
        colors=data.colors,
        joint_indices=data.joint_indices,
        joint_weights=data.joint_weights,
        triangles=data.triangles,
        joint_names=names,
        joint_parents=data.joint_parents,
        inverse_bind=data.inverse_bind,
        rest_world=data.rest_world.astype(np.float32),
        sport_joints=alignment.source,
        alignment=alignment,
        size=1.0 if alignment.native else own_size(alignment, vertices),
    )


def own_size(alignment: Alignment, vertices: AnyArray) -> float:
    """How large a body is in ours: by the file's metres where they give one from `SMALLEST_M` to `LARGEST_M` high.

    Files in centimetres and the like are told by their height; where no unit fits, the body has our size.
    """
    height = float(np.ptp(vertices, axis=0).max())
    for unit in FILE_UNITS:
        if SMALLEST_M <= height * unit <= LARGEST_M:
            return float(np.clip(alignment.units * unit, MIN_SIZE, MAX_SIZE))
    return 1.0
