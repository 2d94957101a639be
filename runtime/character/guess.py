"""Which joint of a user's character plays which SPORT joint: by what was chosen, by names, by tree and rest pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.doubts import doubts, lopsided, on_four_legs
from runtime.character.joint_map import joint_map_path
from runtime.character.joints import NEEDED, REQUIRED, canonical_axes, match_centre, match_names
from runtime.character.mesh import MeshData
from runtime.character.structure import guess_by_structure, leg_count
from runtime.character.tree import JointTree
from runtime.errors import FileError
from runtime.skeleton import SPORT_SKELETON

BY_TREE = "tree and rest pose"
STILL = 0.01  # radians: a joint that turns less in a whole motion does not move
CROOKED = 0.04  # share of the body's size by which left and right of a rest pose may differ


class JointsUnknown(FileError):
    """A character whose joints could not all be found; they can be chosen by hand."""


class NotUpright(FileError):
    """A character with four legs."""


@dataclass(frozen=True)
class JointGuess:
    """The joints of a file and what they play.

    `found` maps SPORT joints to indices, `origin` says by what (the convention of the names, or `BY_TREE`),
    `chosen` are those that a joint map names, `missing` those without which nothing can be driven. `doubts` says of
    joints found by names or tree that geometry refused, why: they are not in `found`.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: AnyArray  # (K, 3) rest pose, scene space
    found: dict[str, int]
    origin: str
    chosen: frozenset[str]
    missing: tuple[str, ...]
    doubts: dict[str, str]


def guess_joints(
    path: Path, data: MeshData, names: tuple[str, ...], joint_map: Mapping[str, str]
) -> tuple[JointGuess, MeshData]:
    """What the joints play, and the mesh data in the rest pose they were read off: as the file stands, or as it was bound.

    FileError where the map names a joint that is not there; `NotUpright` for a quadruped.
    """
    standing = _found(data, names)
    best = (*standing, data)
    bound = bind_pose(data)
    if bound is not None and _crookedness(standing[0], data) > CROOKED:
        other = _found(bound, names)
        if _crookedness(other[0], bound) < 0.5 * _crookedness(standing[0], data):
            best = (*other, bound)
    found, origin, data = best
    return _believed(path, names, _tree(data), found, origin, joint_map), data


def require(path: Path, guess: JointGuess) -> None:
    """`JointsUnknown` where something is missing, with where to name it."""
    if guess.missing:
        raise JointsUnknown(
            f"{path}: no joints found for {', '.join(guess.missing)} (neither by known names nor by tree and rest"
            f" pose{''.join(f'; {reason}' for reason in guess.doubts.values())}).",
            "Choose them in the window Joints, which opens when the file is dropped on the viewer; or write"
            f" {joint_map_path(path).name} next to it, or give such a file as --joint-map:"
            ' {"LeftArm": "name in the file", ...}.',
        )


def _not_upright(path: Path) -> FileError:
    return NotUpright(
        f"{path}: it stands on four legs; characters here have two legs and two arms.",
        "Choose a human or humanoid character.",
    )


def guess_skeleton(
    path: Path,
    names: tuple[str, ...],
    tree: JointTree,
    points: AnyArray,
    joint_map: Mapping[str, str],
    turning: AnyArray | None = None,
) -> JointGuess:
    """What the joints of a skeleton without a mesh play, in a rest pose with `points` `(N, 3)` on its body.

    `turning` `(K,)` is how far each joint turns against its parent in a motion, radians: joints of limbs must turn.

    FileError where the map names a joint that is not there, `NotUpright` for a quadruped.
    """
    found, origin = _guessed_joints(tree, points, names, {})
    if turning is not None:
        found = _bending(found, tree, turning)
    return _believed(path, names, tree, found, origin, joint_map)


def _believed(
    path: Path,
    names: tuple[str, ...],
    tree: JointTree,
    found: Mapping[str, int],
    origin: str,
    joint_map: Mapping[str, str],
) -> JointGuess:
    """A guess without what geometry refuses, and with what was chosen by hand."""
    if _missing(found) and not joint_map and leg_count(tree) > 2:
        raise _not_upright(path)
    refused = doubts(found, tree)
    chosen = _chosen(path, names, joint_map)
    used = {joint: k for joint, k in ({**found, **dict.fromkeys(refused, -1)} | chosen).items() if k >= 0}
    if on_four_legs(dict(found) | used, tree):
        raise _not_upright(path)
    reasons = {
        joint: f"{names[found[joint]]!r} is not believed to be {joint}: {why}"
        for joint, why in refused.items()
        if joint not in used
    }
    return JointGuess(
        names, tree.parents, tree.positions, used, origin, frozenset(joint_map), _missing(used), reasons
    )


def _bending(found: Mapping[str, int], tree: JointTree, turning: AnyArray) -> dict[str, int]:
    """The guess with limbs that begin at the joint that turns: a buttock or a shoulder piece above it does not."""
    moved = dict(found)
    for side in ("Left", "Right"):
        for upper, lower in (("UpLeg", "Leg"), ("Arm", "ForeArm")):
            top, below = moved.get(side + upper, -1), moved.get(side + lower, -1)
            if top < 0 or below < 0 or top not in tree.ancestors(below) or turning[top] > STILL:
                continue
            between = tree.chain(top, below)[1:-1]
            moved[side + upper] = next((k for k in between if turning[k] > STILL), top)
    return moved


def _found(data: MeshData, names: tuple[str, ...]) -> tuple[dict[str, int], str]:
    return _guessed_joints(_tree(data), data.rest_positions(), names, data.humanoid)


def _guessed_joints(
    tree: JointTree, points: AnyArray, names: tuple[str, ...], humanoid: Mapping[str, int]
) -> tuple[dict[str, int], str]:
    by_name, convention = match_names(names)
    by_name = {**by_name, **humanoid}
    named = all(name in by_name for name in REQUIRED)
    if named and not doubts(by_name, tree):
        return by_name, "VRM" if humanoid else convention
    by_tree = guess_by_structure(tree, points)
    if not _missing(by_tree) and (not named or not doubts(by_tree, tree)):
        return by_tree, BY_TREE
    by_name |= match_centre(names, by_name)
    if _missing(by_name) and len(by_tree) > len(by_name):
        return by_tree, BY_TREE
    return by_name, convention


def _missing(found: Mapping[str, int]) -> tuple[str, ...]:
    """Joints without which nothing can be driven."""
    return tuple(name for name in NEEDED if name not in found)


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


def _crookedness(found: Mapping[str, int], data: MeshData) -> float:
    """`lopsided` of a mesh's rest pose, 1 where joints lack."""
    tree = _tree(data)
    return 1.0 if _missing(found) else lopsided(found, tree, canonical_axes(found, tree.positions))
