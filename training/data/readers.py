"""Readers of JSON, and of takes that are not BVH with Y up."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime import rotations
from runtime.errors import FileError
from runtime.formats.bvh import BvhMotion, read_bvh
from runtime.safe_read import open_npz
from runtime.skeleton import Skeleton


def read_json(path: Path, remedy: str) -> Any:
    """Read a JSON file; FileError if it cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: not a readable JSON file.", remedy) from error


def read_z_up(path: Path) -> BvhMotion:
    """Read a take with Z up and rotate it to Y up."""
    motion = read_bvh(path)
    upright = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(-0.5 * np.pi))
    positions, local = motion.positions.copy(), motion.local_rotations.copy()
    positions[:, 0] = rotations.rotate(upright, positions[:, 0])
    local[:, 0] = rotations.multiply(upright, local[:, 0])
    return replace(motion, positions=positions, local_rotations=local)


def read_transforms(path: Path) -> BvhMotion:
    """Read a take of global joint positions and rotations as a hierarchy; FileError for other files."""
    with open_npz(path, "Unpack the archive again.") as file:
        positions, world = file["positions"].astype(np.float64), file["quaternions"].astype(np.float64)
        names, parents = file["bone_names"], file["parent_indices"]
        fps = float(file["framerate"])
    world = world[..., [3, 0, 1, 2]]  # stored as x, y, z, w
    local, bones = world.copy(), positions.copy()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            back = rotations.inverse(world[:, parent])
            local[:, joint] = rotations.multiply(back, world[:, joint])
            bones[:, joint] = rotations.rotate(back, positions[:, joint] - positions[:, parent])
    skeleton = Skeleton(tuple(map(str, names)), tuple(map(int, parents)), np.median(bones, axis=0))
    return BvhMotion(skeleton, bones, local, 1.0 / fps, {})
