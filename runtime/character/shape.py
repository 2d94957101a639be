"""Body shape of the mannequin: height, leg length and shoulder width, as a character of its own."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.assets import asset_path
from runtime.character.character import DEFAULT_CHARACTER, Character, load_character, own_size
from runtime.character.joints import align
from runtime.character.writer import write_character
from runtime.errors import UsageError
from runtime.skeleton import SPORT_SKELETON

MIN_FACTOR, MAX_FACTOR = 0.4, 2.5  # of every factor
GIRTH_GROWTH_FACTOR = 0.5  # exponent of a limb's thickness relative to its length


@dataclass(frozen=True)
class BodyShape:
    """Proportions of the mannequin, as factors of its default measures."""

    height: float = 1.0  # of the whole body
    legs: float = 1.0  # their length
    shoulders: float = 1.0  # their width
    arms: float = 1.0
    head: float = 1.0

    def check(self) -> None:
        """Raise UsageError for a factor out of range."""
        for name, value in vars(self).items():
            if not MIN_FACTOR <= value <= MAX_FACTOR:
                problem = f" {value:g}: expected {MIN_FACTOR:g} to {MAX_FACTOR:g} of the {name}."
                raise UsageError(problem, "Try 1.", name)


def shaped(character: Character, shape: BodyShape) -> Character:
    """Return the mannequin with other proportions; limbs grow along their bones, and less in thickness. Raises UsageError."""
    shape.check()
    if shape == BodyShape():
        return character
    if not character.alignment.native:
        raise UsageError("Only the mannequin has a shape to choose.", "Leave the character's file away.")
    grown = np.stack([_growth(name, shape) for name in SPORT_SKELETON.names])  # (31, 3) of each joint's mesh
    offsets = SPORT_SKELETON.offsets.astype(np.float64)
    offsets[1:] *= grown[list(SPORT_SKELETON.parents[1:])]  # the hips come first
    for side in ("Left", "Right"):
        offsets[SPORT_SKELETON.index(f"{side}Arm"), 0] *= shape.shoulders
    old = character.rest_world[:, :3, 3].astype(np.float64)
    new = np.zeros_like(old)
    for j, parent in enumerate(SPORT_SKELETON.parents):
        new[j] = offsets[j] + new[parent] if parent >= 0 else old[0]
    joints, weights = character.joint_indices, character.joint_weights[..., None]
    base = character.positions.astype(np.float64)[:, None] - old[joints]  # (V, 4, 3)
    vertices = shape.height * ((base * grown[joints] + new[joints]) * weights).sum(axis=1)
    normals = character.normals / (grown[joints] * weights).sum(axis=1)
    world = np.tile(np.eye(4), (len(new), 1, 1))
    world[:, :3, 3] = shape.height * new
    found = {name: j for j, name in enumerate(SPORT_SKELETON.names)}
    alignment = align(found, SPORT_SKELETON.parents, world, vertices)
    return replace(
        character,
        positions=vertices.astype(np.float32),
        normals=rotations.normalize(normals.astype(np.float64)).astype(np.float32),
        inverse_bind=np.linalg.inv(world).astype(np.float32),
        rest_world=world.astype(np.float32),
        alignment=alignment,
        size=own_size(alignment, vertices),
    )


def shaped_file(shape: BodyShape, folder: Path) -> Path:
    """Write the mannequin with other proportions as a GLB in `folder` and return its path. Raises UsageError, FileError."""
    shares = "-".join(f"{100 * value:.0f}" for value in (shape.height, shape.legs, shape.shoulders))
    path = folder / f"mannequin-{shares}.glb"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_character(path, shaped(load_character(asset_path(DEFAULT_CHARACTER)), shape), path.stem)
    return path


def _growth(name: str, shape: BodyShape) -> AnyArray:
    """Return the growth factors `(3,)` of the mesh around a joint along the axes of the rest pose."""
    if name.endswith(("UpLeg", "Leg")):
        return np.array([shape.legs**GIRTH_GROWTH_FACTOR, shape.legs, shape.legs**GIRTH_GROWTH_FACTOR])
    if name.endswith(("Arm", "ForeArm")):
        return np.array([shape.arms, shape.arms**GIRTH_GROWTH_FACTOR, shape.arms**GIRTH_GROWTH_FACTOR])
    if name == "Head":
        return np.full(3, shape.head)
    if name in ("LowerBack", "Spine", "Spine1"):
        return np.array([0.5 + 0.5 * shape.shoulders, 1.0, 1.0])
    return np.ones(3)
