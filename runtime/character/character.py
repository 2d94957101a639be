"""Skinned characters from glTF files: ours, or a user's own, driven by poses of the SPORT skeleton."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.bodies import open_character
from runtime.character.body_surface import BodySurface, fit_surface
from runtime.character.guess import JointGuess, guess_skeleton, require
from runtime.character.hand_contact import clear_hands
from runtime.character.joint_map import read_joint_map, saved_joint_map
from runtime.character.joints import Alignment, align
from runtime.character.mesh import MeshData, read_meshes
from runtime.character.nodes import Nodes
from runtime.character.planted_feet import Soles, find_soles, plant_feet
from runtime.character.read import MAX_VALUE, REMEDY, STRUCTURE_ERRORS, GltfFile
from runtime.character.rest_pose import bind_worlds
from runtime.character.skinned_mesh import SkinnedMesh, Surface
from runtime.character.tree import JointTree
from runtime.errors import FileError
from runtime.pose import Pose
from runtime.safe_read import is_text, reason

DEFAULT_CHARACTER = "character/mannequin.glb"  # an asset
FILE_UNITS = (1.0, 0.01, 0.1, 0.0254, 0.001)  # metres per unit of a file, the most common first
NAMED_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
SMALLEST_M, LARGEST_M = 0.3, 8.0
MIN_SIZE, MAX_SIZE = 0.05, 20.0  # the same as for a clip


@dataclass(frozen=True)
class Character(SkinnedMesh):
    """A skinned mesh with soles and a body surface that hands cannot enter; `note` says if its size was guessed."""

    note: str = ""

    def skin_matrices(self, pose: Pose) -> AnyArray:
        """Return skinning matrices `(K, 4, 4)` float32 from the bind pose to world space in `pose`, adapted to this body."""
        positions, world = self.adapted(pose.positions, pose.world_rotations, pose.contacts)
        return (self.joint_matrices(positions, world) @ self.inverse_bind).astype(np.float32)

    def adapted(
        self, positions: AnyArray, world_rotations: AnyArray, contacts: AnyArray
    ) -> tuple[AnyArray, AnyArray]:
        """Adapt a SPORT pose, or the frames of a motion `(T, ...)`, to this body: feet planted, hands on its own surface."""
        if not self.alignment.native:
            positions, world_rotations = plant_feet(self, self.soles, positions, world_rotations, contacts)
        return clear_hands(self, self.body, positions, world_rotations, positions.ndim > 2)

    @cached_property
    def soles(self) -> Soles:
        """The character's soles, relative to those of the SPORT skeleton."""
        return find_soles(self, *self.rest)

    @cached_property
    def body(self) -> BodySurface | None:
        """The surface that hands cannot enter, or None if the mesh does not have a usable one."""
        return fit_surface(self, *self.rest)

    @cached_property
    def height(self) -> float:
        """Height (metres) of the mesh in the SPORT rest pose."""
        return float(np.ptp(self.rest[0][:, 1]))


def load_character(
    path: str | Path, joint_map: Mapping[str, str] | Path | None = None, unit: str | None = None
) -> Character:
    """Load a skinned .glb, .gltf or .vrm; FileError names the file, what is wrong and what to do.

    Joints are found by known names, or by hierarchy and rest pose (`guess_skeleton`). `joint_map` (SPORT joint name to
    joint name in the file, "" for none), or a file of it, overrides single joints; the default is the map next to the
    file. `unit` is a key of `NAMED_UNITS`; None chooses metres, or the unit that fits the height of a body.
    """
    with _reading(path) as (file, note):
        character = _assemble(file, *_guessed(file, joint_map), unit)
        return replace(character, note=f"{note} {character.note}".strip())


def joints_of(path: str | Path, joint_map: Mapping[str, str] | None = None) -> JointGuess:
    """Guess the SPORT joint that each joint of a character file stands for, even if some are missing. Raises FileError."""
    with _reading(path) as (file, _):
        return _guessed(file, joint_map)[0]


@contextmanager
def _reading(path: str | Path) -> Iterator[tuple[GltfFile, str]]:
    """Open a file with its first body, and the note on the others; damage becomes a FileError."""
    try:
        with np.errstate(all="ignore"):  # the results are checked
            yield open_character(Path(path))
    except STRUCTURE_ERRORS as error:
        raise FileError(f"{path}: damaged glTF structure ({reason(error)}).", REMEDY) from error


def _guessed(file: GltfFile, joint_map: Mapping[str, str] | Path | None) -> tuple[JointGuess, MeshData]:
    data = read_meshes(file)
    data = replace(data, rest_world=bind_worlds(Nodes(file), data.joint_nodes))
    if joint_map is None:
        joint_map = saved_joint_map(file.path)
    elif isinstance(joint_map, Path):
        joint_map = read_joint_map(joint_map)
    named = ((n, file.gltf.nodes[n].get("name")) for n in data.joint_nodes)
    names = tuple(name if is_text(name) else f"node{n}" for n, name in named)
    tree = JointTree(data.joint_parents, data.rest_world[:, :3, 3])
    points, humanoid = data.rest_positions(), data.humanoid
    return guess_skeleton(file.path, names, tree, points, joint_map, humanoid=humanoid), data


def _assemble(file: GltfFile, guess: JointGuess, data: MeshData, unit: str | None) -> Character:
    require(file.path, guess)
    vertices = data.rest_positions()
    alignment = align(guess.found, data.joint_parents, data.rest_world, vertices)
    size = 1.0 if alignment.native else own_size(alignment, vertices, NAMED_UNITS.get(unit or ""))
    character = Character(
        **{field.name: getattr(data, field.name) for field in fields(Surface)},
        joint_names=guess.names,
        joint_parents=data.joint_parents,
        inverse_bind=data.inverse_bind,
        rest_world=data.rest_world.astype(np.float32),
        sport_joints=alignment.source,
        alignment=alignment,
        size=size,
    )
    for name, value in (vars(character) | vars(alignment)).items():  # a scale of zero cannot be drawn
        values = np.asarray(value)
        if values.dtype.kind == "f" and not np.all(np.abs(values) < MAX_VALUE):
            raise file.error(f"the {name.replace('_', ' ')} of its skeleton are not finite.")
    return replace(character, note=_size_note(file, character, vertices, unit))


def _size_note(file: GltfFile, character: Character, vertices: AnyArray, unit: str | None) -> str:
    """Return a sentence about the height of a body whose unit was guessed; "" if it is as the file says."""
    alignment = character.alignment
    metres, sure = alignment.units * NAMED_UNITS[unit or "m"], unit is not None or file_unit(vertices) == 1.0
    if alignment.native or (sure and np.isclose(character.size, metres)):
        return ""
    high = float(np.ptp(vertices, axis=0).max())
    taken = (
        f"{file.path.name}: {high:.4g} units high, taken as {high * character.size / alignment.units:.2f} m"
    )
    return f"{taken}; --character-unit m, cm, mm or in sets another unit."


def file_unit(vertices: AnyArray) -> float | None:
    """Return the file's unit in metres: the first of `FILE_UNITS` that makes the body `SMALLEST_M` to `LARGEST_M` tall, or None."""
    height = float(np.ptp(vertices, axis=0).max())
    return next((unit for unit in FILE_UNITS if SMALLEST_M <= height * unit <= LARGEST_M), None)


def own_size(alignment: Alignment, vertices: AnyArray, unit: float | None = None) -> float:
    """Return the size of a body relative to the SPORT skeleton, from `unit` (metres) or else `file_unit`; 1 if none fits."""
    unit = file_unit(vertices) if unit is None else unit
    return 1.0 if unit is None else float(np.clip(alignment.units * unit, MIN_SIZE, MAX_SIZE))
