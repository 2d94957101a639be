"""Skinned characters with unknown joint names: humanoids modelled on published ones, and a quadruped."""

from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.character.character import Character
from runtime.character.writer import write_character
from tests.helpers.gltf_characters import user_character

Points = dict[str, tuple[str, tuple[float, float, float]]]  # name -> parent, position in metres


def _both(points: Points) -> Points:
    """Add mirrored entries "R ..." for those that begin with "L "."""
    left = {name: at for name, at in points.items() if name.startswith("L ")}
    parents = {name: "R" + parent[1:] if parent in left else parent for name, (parent, _) in left.items()}
    other = {"R" + name[1:]: (parents[name], (-x, y, z)) for name, (_, (x, y, z)) in left.items()}
    return points | other


# three joints in the trunk, no toes to the side, arms in an A (as Khronos' CesiumMan)
PLAIN: Points = _both({
    "a": ("", (0, 0.68, 0)), "b": ("a", (0, 0.82, 0.01)), "c": ("b", (0, 1.07, 0)), "d": ("c", (0, 1.14, 0)),
    "e": ("d", (0, 1.19, 0)), "L f": ("c", (0.09, 1.07, 0)), "L g": ("L f", (0.31, 0.96, -0.02)),
    "L h": ("L g", (0.45, 0.87, 0.06)), "L i": ("a", (0.07, 0.61, 0.02)), "L j": ("L i", (0.08, 0.35, 0.06)),
    "L k": ("L j", (0.08, 0.09, 0)), "L l": ("L k", (0.085, 0.02, 0.03)),
})  # fmt: skip
# a joint on the ground, helper joints along the limbs, fingers, eyes and an end above the head (as Meta's Cranberry)
HELPED: Points = _both({
    "world": ("", (0, 0, 0)), "root": ("world", (0, 0.92, 0)), "s0": ("root", (0, 0.95, -0.03)),
    "s1": ("s0", (0, 1.06, -0.02)), "s2": ("s1", (0, 1.2, -0.04)), "s3": ("s2", (0, 1.35, -0.04)),
    "n": ("s3", (0, 1.47, 0.01)), "n twist": ("n", (0, 1.5, 0.02)), "h": ("n", (0, 1.54, 0.03)),
    "h end": ("h", (0, 1.74, 0.03)), "L eye": ("h", (0.03, 1.62, 0.1)), "L eye end": ("L eye", (0.03, 1.62, 0.12)),
    "L c": ("s3", (0.03, 1.41, 0.06)), "L scap": ("L c", (0.16, 1.45, -0.03)), "L arm": ("L scap", (0.18, 1.42, -0.03)),
    "L arm twist": ("L arm", (0.27, 1.32, -0.02)), "L fore": ("L arm", (0.35, 1.23, -0.02)),
    "L fore twist": ("L fore", (0.44, 1.17, 0.04)), "L wrist": ("L fore", (0.53, 1.12, 0.12)),
    **{f"L {f}{i}": (f"L {f}{i - 1}" if i else "L wrist", (0.56 + 0.03 * i + 0.01 * (f == "q"), 1.07 - 0.03 * i, z + 0.02 * i))
       for f, z in (("p", 0.13), ("q", 0.16), ("r", 0.19)) for i in range(3)},
    "L up": ("root", (0.08, 0.9, 0)), "L knee": ("L up", (0.13, 0.48, -0.03)), "L kt": ("L knee", (0.16, 0.3, -0.05)),
    "L ankle": ("L knee", (0.19, 0.07, -0.07)), "L ball": ("L ankle", (0.2, 0.02, 0.07)),
})  # fmt: skip
# feet and targets are children of the root, hands are pieces without their own joint (as RobotExpressive)
LOOSE: Points = _both({
    "bone": ("", (0, -0.01, -0.2)), "L foot": ("bone", (0.63, 0.02, -0.14)), "body": ("bone", (0, 1.41, 0.1)),
    "L pole": ("bone", (0.9, 1.05, 1.5)), "hips": ("body", (0, 1.32, 0)), "belly": ("hips", (0, 1.64, -0.07)),
    "torso": ("belly", (0, 2.12, -0.06)), "neck": ("torso", (0, 2.7, 0.02)), "head": ("neck", (0, 3.0, 0.04)),
    "L shoulder": ("torso", (0.58, 2.41, 0)), "L upper": ("L shoulder", (0.62, 2.33, 0)),
    "L lower": ("L upper", (0.9, 1.76, -0.1)), "L palm1": ("L lower", (1.3, 1.3, 0.3)),
    "L palm2": ("L lower", (1.3, 1.29, 0.3)), "L palm3": ("L lower", (1.29, 1.3, 0.3)),
    "L thigh": ("body", (0.63, 1.51, -0.07)), "L shank": ("L thigh", (0.66, 0.92, 0.1)),
})  # fmt: skip
DOG: Points = _both({
    "a": ("", (0, 0.47, -0.18)), "b": ("a", (0, 0.45, 0.0)), "c": ("b", (0, 0.45, 0.22)), "d": ("c", (0, 0.5, 0.37)),
    "tail": ("a", (0, 0.46, -0.25)), "tail end": ("tail", (0, 0.35, -0.45)), "L f": ("c", (0.07, 0.41, 0.22)),
    "L g": ("L f", (0.08, 0.26, 0.16)), "L h": ("L g", (0.06, 0.09, 0.2)), "L i": ("L h", (0.06, 0.03, 0.24)),
    "L j": ("a", (0.05, 0.4, -0.24)), "L k": ("L j", (0.06, 0.26, -0.15)), "L l": ("L k", (0.06, 0.14, -0.28)),
    "L m": ("L l", (0.06, 0.03, -0.26)),
})  # fmt: skip


def odd_character(points: Points, names: dict[str, str] | None = None) -> Character:
    """Return a character with a triangle at each joint, and soles forward of the ankles; `names` renames joints."""
    order = list(points)
    parents = tuple(order.index(parent) if parent else -1 for parent, _ in points.values())
    where = np.array([place for _, place in points.values()], float)
    rng = np.random.default_rng(3)
    world = np.tile(np.eye(4), (len(order), 1, 1))
    world[:, :3, :3] = rotations.to_matrix(rotations.normalize(rng.normal(size=(len(order), 4))))
    world[:, :3, 3] = where
    low = where[:, 1] < where[:, 1].min() + 0.1 * np.ptp(where[:, 1])
    corners = np.array([(0, 0, 0), (0.01, 0, 0), (0, 0, 0.01)])
    mesh = (where[:, None] + corners * np.where(low, 10.0, 1.0)[:, None, None]).reshape(-1, 3)
    mesh[3 * int(np.argmax(where[:, 1]))] += (0, 0.2 * np.ptp(where[:, 1]), 0)  # the crown of the head
    count = len(mesh)
    like = user_character()
    return Character(
        mesh.astype(np.float32), np.tile(np.float32([0, 1, 0]), (count, 1)), np.full((count, 3), 0.5, np.float32),
        np.stack([np.repeat(np.arange(len(order)), 3)] + [np.zeros(count, int)] * 3, 1).astype(np.uint16),
        np.tile(np.float32([1, 0, 0, 0]), (count, 1)), np.arange(count, dtype=np.uint32).reshape(-1, 3),
        tuple((names or {}).get(name, name) for name in order), parents,
        np.linalg.inv(world).astype(np.float32), world.astype(np.float32), np.full(len(order), -1), like.alignment,
    )  # fmt: skip


def write_odd(path: Path, points: Points, names: dict[str, str] | None = None) -> Path:
    """Write one of the rigs as GLB."""
    write_character(path, odd_character(points, names))
    return path
