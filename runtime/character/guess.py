"""Which joint of a user's character plays which SPORT joint: by what was chosen, by names, by tree and rest pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.character.joint_map import joint_map_path
from runtime.character.joints import HANDS, NEEDED, REQUIRED, canonical_axes, match_names
from runtime.character.mesh import MeshData
from runtime.character.structure import guess_by_structure, leg_count
from runtime.character.tree import JointTree
from runtime.errors import FileError
from runtime.skeleton import SPORT_SKELETON

Array = NDArray[Any]

BY_TREE = "tree and rest pose"
CROOKED = 0.04  # share of the body's size by which left and right of a rest pose may differ


class JointsUnknown(FileError):
    """A character whose joints could not all be found; they can be chosen by hand."""


class NotUpright(FileError):
    """A character with four legs."""


@dataclass(frozen=True)
class JointGuess:
    """The joints of a file and what they play.

    `found` maps SPORT joints to indices, `origin` says by what (the convention of the names, or `BY_TREE`),
    `chosen` are those that a joint map names, `missing` those without which nothing can be driven.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: Array  # (K, 3) rest pose, scene space
    found: dict[str, int]
    origin: str
    chosen: frozenset[str]
    missing: tuple[str, ...]


def guess_joints(
    path: Path, data: MeshData, names: tuple[str, ...], joint_map: Mapping[str, str]
) -> tuple[JointGuess, MeshData]:
    """What the joints play, and the mesh data in the rest pose they were read off: as the file stands, or as it was bound.

    FileError where the map names a joint that is not there; `NotUpright` for a quadruped.
    """
    standing = _found(data, names)
    best = (*standing, data)
    bound = bind_pose(data)
    if bound is not None and _lopsided(standing[0], data) > CROOKED:
        other = _found(bound, names)
        if _lopsided(other[0], bound) < 0.5 * _lopsided(standing[0], data):
            best = (*other, bound)
    found, origin, data = best
    if not _complete(found) and not joint_map and leg_count(_tree(data)) > 2:
        raise _not_upright(path)
    found = found | _chosen(path, names, joint_map)
    found = {joint: index for joint, index in found.items() if index >= 0}
    if _four_legged(found, data.rest_world[:, :3, 3]):
        raise _not_upright(path)
    missing = tuple(name for name in NEEDED if name not in found)
    guess = JointGuess(
        names, data.joint_parents, data.rest_world[:, :3, 3], found, origin, frozenset(joint_map), missing
    )
    return guess, data


def require(path: Path, guess: JointGuess) -> None:
    """`JointsUnknown` where something is missing, with where to name it."""
    if guess.missing:
        raise JointsUnknown(
            f"{path}: no joints found for {', '.join(guess.missing)} (neither by known names nor by tree and rest"
            " pose).",
            "Choose them in the window Joints, which opens when the file is dropped on the viewer; or write"
            f" {joint_map_path(path).name} beside it, or give such a file as --joint-map:"
            ' {"LeftArm": "name in the file", ...}.',
        )


def _not_upright(path: Path) -> FileError:
    return NotUpright(
        f"{path}: it stands on four legs; characters here have two legs and two arms.",
        "Choose a human or humanoid character.",
    )


def guess_skeleton(
    path: Path, names: tuple[str, ...], tree: JointTree, points: Array, joint_map: Mapping[str, str]
) -> JointGuess:
    """What the joints of a skeleton without a mesh play, in a rest pose with `points` `(N, 3)` on its body.

    FileError where the map names a joint that is not there, `NotUpright` for a quadruped.
    """
    found, origin = _told(tree, points, names, {})
    if not _complete(found) and not joint_map and leg_count(tree) > 2:
        raise _not_upright(path)
    found = {joint: k for joint, k in (found | _chosen(path, names, joint_map)).items() if k >= 0}
    if _four_legged(found, tree.positions):
        raise _not_upright(path)
    missing = tuple(name for name in NEEDED if name not in found)
    return JointGuess(names, tree.parents, tree.positions, found, origin, frozenset(joint_map), missing)


def _found(data: MeshData, names: tuple[str, ...]) -> tuple[dict[str, int], str]:
    return _told(_tree(data), data.rest_positions(), names, data.humanoid)


def _told(
    tree: JointTree, points: Array, names: tuple[str, ...], humanoid: Mapping[str, int]
) -> tuple[dict[str, int], str]:
    by_name, convention = match_names(names)
    by_name = {**by_name, **humanoid}
    if all(name in by_name for name in REQUIRED):
        return by_name, "VRM" if humanoid else convention
    by_tree = guess_by_structure(tree, points)
    if _complete(by_tree) or len(by_tree) > len(by_name):
        return by_tree, BY_TREE
    return by_name, convention if by_name else ""


def _complete(found: Mapping[str, int]) -> bool:
    return all(name in found for name in NEEDED)


def _tree(data: MeshData) -> JointTree:
    return JointTree(data.joint_parents, data.rest_world[:, :3, 3])


def _chosen(path: Path, names: tuple[str, ...], joint_map: Mapping[str, str]) -> dict[str, int]:
    chosen = {}
    for joint, name in joint_map.items():
        if joint not in SPORT_SKELETON.names or (name and name not in names):
            raise FileError(
                f"{path}: the joint map names {joint!r} -> {name!r}, which is not in the skeleton.",
                f"Joints of the file: {', '.join(names[:80])}.",
            )
        chosen[joint] = names.index(name) if name else -1
    return chosen


def bind_pose(data: MeshData) -> MeshData | None:
    """The same mesh as it was bound to its joints, None where its skins do not agree on that.

    Many files rest in a frame of an animation; what they were bound in is a T- or A-pose.
    """
    root = next((k for k, parent in enumerate(data.joint_parents) if parent < 0), 0)
    try:
        bind = np.linalg.inv(data.inverse_bind.astype(np.float64))
    except np.linalg.LinAlgError:
        return None
    to_scene = data.rest_world[root] @ data.inverse_bind[root]
    scale = float(np.cbrt(abs(np.linalg.det(to_scene[:3, :3]))))
    turn = np.zeros((3, 3))
    for row in range(3):  # an animation may have turned the root a little; files stand on an axis
        axis = int(np.argmax(np.abs(to_scene[row, :3])))
        turn[row, axis] = np.sign(to_scene[row, axis])
    if scale < 1e-9 or abs(np.linalg.det(turn) - 1.0) > 1e-6:
        return None
    frame = np.eye(4)
    frame[:3, :3] = turn * scale
    worlds = frame @ bind
    return replace(data, rest_world=worlds) if np.all(np.isfinite(worlds)) else None


def _lopsided(found: Mapping[str, int], data: MeshData) -> float:
    """How far left and right limbs are from mirror images, as a share of the body's size; 1 where joints lack."""
    if not _complete(found):
        return 1.0
    position = data.rest_world[:, :3, 3] @ canonical_axes(found, data.rest_world[:, :3, 3]).T
    middle = 0.5 * (position[found["LeftUpLeg"], 0] + position[found["RightUpLeg"], 0])
    gaps = []
    for bone in ("Leg", "Foot", "ForeArm", "Hand"):
        if f"Left{bone}" in found and f"Right{bone}" in found:
            left, right = position[found[f"Left{bone}"]], position[found[f"Right{bone}"]]
            mirrored = np.array([2.0 * middle - left[0], left[1], left[2]])
            gaps.append(float(np.linalg.norm(mirrored - right)))
    return float(np.mean(gaps)) / max(float(np.ptp(position[:, 1])), 1e-9)


def _four_legged(found: Mapping[str, int], position: Array) -> bool:
    """Whether arms are legs: they point where the legs point, across the trunk, and end as low."""
    limbs = ("UpLeg", "Foot", "Arm", *(HANDS if "LeftHand" in found else ("ForeArm",)))
    if any(side + bone not in found for side in ("Left", "Right") for bone in limbs):
        return False

    def middle(bone: str) -> Array:
        return np.asarray(
            0.5 * (position[found["Left" + bone]] + position[found["Right" + bone]]), np.float64
        )

    down, fore = middle("Foot") - middle("UpLeg"), middle(limbs[-1]) - middle("Arm")
    trunk = middle("Arm") - middle("UpLeg")
    length = max(float(np.linalg.norm(down)), 1e-9)
    along = down / length
    leaning = float(along @ trunk) / max(float(np.linalg.norm(trunk)), 1e-9)
    pointing = float(along @ fore) / max(float(np.linalg.norm(fore)), 1e-9)
    deep = float((middle(limbs[-1]) - middle("UpLeg")) @ along) / length
    return leaning > -0.6 and pointing > 0.5 and deep > 0.6
