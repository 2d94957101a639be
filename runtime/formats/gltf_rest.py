"""The rest pose of a body in a glTF file: that in which its skins are bound, put where its nodes stand."""

from __future__ import annotations

from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.character.bodies import Nodes
from runtime.character.read import accessor_count, nearest_of, read_accessor
from runtime.formats.gltf_keys import KEYS_REMEDY

MAX_BIND_MATRICES = 50_000
LEAST_TO_AGREE = 3  # joints of a skin that can tell its space
ALIKE_FRACTION = 1e-3  # of a body's size, by which rounding moves a joint
SAME_LENGTH_FACTOR = 1.03
MAX_STRETCH_FACTOR = 1.5  # bones of skin and nodes that differ by more do not belong together
REMEDY = "Apply the scale of the armature and export it again."


def bind_worlds(nodes: Nodes, joints: list[int]) -> Array:
    """Transforms `(joints, 4, 4)` in the world at rest: the bind pose where skins tell it, else the nodes as they stand.

    Each skin tells it in a space of its own (`_space`). What no skin tells lies to the joint above it, or below, as the
    nodes do. FileError where bones of a skin and of the nodes differ in length.
    """
    rest, told, spaces, count = nodes.rest, dict[int, Array](), list[Array](), 0
    skins = nodes.file.gltf.skins or []
    for number in sorted(range(len(skins)), key=lambda number: -len(skins[number].joints)):
        count += max(len(skins[number].joints), accessor_count(nodes.file, skins[number].inverseBindMatrices))
        if count > MAX_BIND_MATRICES:
            raise nodes.file.error(f"more than {MAX_BIND_MATRICES} bind matrices.", KEYS_REMEDY)
        bound = _bound(nodes, skins[number])
        members = [node for node in joints if node in bound]
        bind = np.array([bound[node] for node in members]).reshape(-1, 4, 4)
        space = _space(nodes, number, members, bind, spaces, told) if members else None
        if space is not None:
            spaces.append(space)
            told = dict(zip(members, space @ bind, strict=True)) | told
    # from where a node stands to where it was bound
    moved = {node: matrix @ np.linalg.inv(rest[node]) for node, matrix in told.items()}
    if not moved:
        return np.asarray(rest[joints])
    for node in nodes.with_ancestors(moved)[::-1]:
        moved.setdefault(nodes.parents[node], moved[node])
    for node in nodes.order:
        moved.setdefault(node, moved[nodes.parents[node]])
    return np.array([moved[joint] @ rest[joint] for joint in joints])


def _bound(nodes: Nodes, skin: Any) -> dict[int, Array]:
    """Bind matrices `(4, 4)` of a skin's joints in its own space; none of a skin that tells none."""
    if skin.inverseBindMatrices is None:
        return {}
    inverse = read_accessor(nodes.file, skin.inverseBindMatrices, "the bind pose").astype(float)
    matrices = inverse.reshape(-1, 4, 4).transpose(0, 2, 1)[: len(skin.joints)]
    usable = np.flatnonzero(np.abs(np.linalg.det(matrices)) > 1e-15)
    return {skin.joints[k]: matrix for k, matrix in zip(usable, np.linalg.inv(matrices[usable]), strict=True)}


def _space(
    nodes: Nodes, skin: int, members: list[int], bind: Array, spaces: list[Array], told: dict[int, Array]
) -> Array | None:
    """The transform `(4, 4)` from a skin's own space, in which its `members` have the matrices `bind`, to the world.

    It is the one that most joints agree on, for they stand as they were bound. Where they stand otherwise, as in a frame
    of a motion, it is the space of another skin, of a node that holds this one, or the world: of those in which bones
    are as long as those of the nodes the one that moves joints least. Else the uppermost joint stands as it was bound.
    None where that cannot be known. FileError where no space makes bones as long as those of the nodes.
    """
    at = nodes.rest[members]
    bones = _Bones(nodes, members, told)
    choices = [*spaces, *(nodes.rest[node] for node in _holders(nodes, skin, members[0])), np.eye(4)]
    if len(members) >= LEAST_TO_AGREE:
        if np.ptp(bind[:, :3, 3], axis=0).max() <= ALIKE_FRACTION * np.abs(bind[:, :3, :3]).max():
            return None  # matrices that tell nothing
        found = at @ np.linalg.inv(bind)
        apart = np.einsum("kab,jb->kja", found[:, :3], bind[:, :, 3]) - at[None, :, :3, 3]
        agreeing = (np.abs(apart).max(axis=-1) < ALIKE_FRACTION * _extent(at)).sum(axis=1)
        if 2 * agreeing.max() > len(members):
            return np.asarray(found[int(np.argmax(agreeing))])
    fitting = [
        space for space in choices if abs(np.log(bones.stretch(space @ bind))) < np.log(SAME_LENGTH_FACTOR)
    ]
    if fitting:
        return min(fitting, key=lambda space: _extent_moved(space @ bind, at))
    if told and len(members) < LEAST_TO_AGREE:
        return None
    space = at[0] @ np.linalg.inv(bind[0])
    if abs(np.log(bones.stretch(space @ bind))) > np.log(MAX_STRETCH_FACTOR):
        raise nodes.file.error(bones.difference(space @ bind), REMEDY)
    return np.asarray(space)


def _holders(nodes: Nodes, skin: int, top: int) -> list[int]:
    """The node above the joints of a skin, those that show it, and those above them."""
    shown = [node for node in nodes.order if nodes.entry(node).skin == skin]
    return [node for node in (nodes.parents[top], *shown, *(nodes.parents[n] for n in shown)) if node >= 0]


class _Bones:
    """Bones from joints of a skin to the nearest joint above, of this skin or of those that are `told`."""

    def __init__(self, nodes: Nodes, members: list[int], told: dict[int, Array]) -> None:
        place = {node: k for k, node in enumerate(members)}
        nearest = nearest_of(nodes.order, nodes.parents, {*members, *told})
        above = [nearest[nodes.parents[node]] if nodes.parents[node] >= 0 else -1 for node in members]
        self.nodes, self.members = nodes, members
        self.pairs = [(k, node) for k, node in enumerate(above) if node >= 0]
        self.place, self.told = place, told
        ends = nodes.rest[:, :3, 3]
        self.lengths = np.array([np.linalg.norm(ends[members[k]] - ends[node]) for k, node in self.pairs])

    def _own(self, worlds: Array) -> Array:
        """Lengths `(bones,)` where joints have the matrices `worlds` `(members, 4, 4)`."""
        above = [
            worlds[self.place[node]] if node in self.place else self.told[node] for _, node in self.pairs
        ]
        return np.array(
            [np.linalg.norm(worlds[k, :3, 3] - m[:3, 3]) for (k, _), m in zip(self.pairs, above, strict=True)]
        )

    def stretch(self, worlds: Array) -> float:
        """How much longer bones are than those of the nodes; 1 where these have none."""
        usable = self.lengths > ALIKE_FRACTION * self.lengths.max(initial=0.0)
        ratios = self._own(worlds)[usable] / self.lengths[usable]
        return max(float(np.median(ratios)), 1e-9) if len(ratios) else 1.0

    def difference(self, worlds: Array) -> str:
        """What is wrong with the longest bone."""
        longest = int(np.argmax(self.lengths))
        joint, above = (
            self.nodes.name(node) for node in (self.members[self.pairs[longest][0]], self.pairs[longest][1])
        )
        return (
            f"its skin binds {joint[:40]!r} {self._own(worlds)[longest]:.3g} from {above[:40]!r}, but the node is"
            f" {self.lengths[longest]:.3g} from it."
        )


def _extent(worlds: Array) -> float:
    return max(float(np.linalg.norm(np.ptp(worlds[:, :3, 3], axis=0))), 1e-9)


def _extent_moved(worlds: Array, at: Array) -> float:
    """Mean distance between joints of two poses whose middles lie on each other."""
    gaps = worlds[:, :3, 3] - at[:, :3, 3]
    return float(np.linalg.norm(gaps - gaps.mean(axis=0), axis=-1).mean())
