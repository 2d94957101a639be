"""The bodies of a file: which of its nodes are the joints of one character, whatever skins, cameras and other characters there are."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.joints import CONVENTIONS, NEEDED, name_variants
from runtime.character.mesh import vrm_bones
from runtime.character.read import Entry, GltfFile, ancestors, nearest_of, node_world_matrices, open_gltf
from runtime.character.structure import guess_by_structure, leg_count
from runtime.character.tree import JointTree
from runtime.safe_read import printable

MAX_BODY_JOINTS = 1024
FBX_ROOT = "root"  # what holds all nodes of a file that was an FBX
LEAST_JOINTS = len(NEEDED)  # of a body that is told by its tree
MAX_LOOSE_BODIES = 8  # that no names tell
# of the moved nodes of a file without skins hang on the top of a body, cameras and props apart
MOVED_FRACTION = 0.8


@dataclass(frozen=True)
class Nodes:
    """The nodes of a file, parents first."""

    file: GltfFile
    order: list[int]
    parents: list[int]

    @staticmethod
    def of(file: GltfFile) -> Nodes:
        """The nodes of a file. FileError where they are no tree."""
        return Nodes(file, *ancestors(file))

    @cached_property
    def skinned(self) -> set[int]:
        """The joints that skins name; reading the skins says of others that they are not there."""
        every = range(len(self.parents))
        return {joint for skin in self.file.gltf.skins or [] for joint in skin.joints or [] if joint in every}

    @cached_property
    def rest(self) -> AnyArray:
        """World matrices `(nodes, 4, 4)` of the nodes as they stand in the file."""
        return node_world_matrices(self.file, self.order, self.parents)

    def entry(self, node: int) -> Entry:
        """Return the glTF object of a node."""
        entry: Entry = self.file.gltf.nodes[node]
        return entry

    def name(self, node: int) -> str:
        """The name of a node, or its number."""
        return str(self.entry(node).name or f"node {node}")

    def children(self, node: int) -> list[int]:
        return self.entry(node).children or []

    def under(self, top: int) -> list[int]:
        """A node and all below it, parents first."""
        found = [top]
        for node in found:  # which grows meanwhile
            found.extend(self.children(node))
        return found

    def with_ancestors(self, nodes: Collection[int]) -> list[int]:
        """Some nodes and all above them, parents first."""
        wanted = set(nodes)
        for node in reversed(self.order):
            if node in wanted:
                wanted.add(self.parents[node])
        return [node for node in self.order if node in wanted]

    def counts(self, nodes: Collection[int]) -> list[int]:
        """For each node how many of some nodes are in its branch."""
        below = [int(node in nodes) for node in range(len(self.parents))]
        for node in reversed(self.order):
            if self.parents[node] >= 0:
                below[self.parents[node]] += below[node]
        return below


@dataclass(frozen=True)
class Body:
    """Nodes that are the joints of one character, parents first; `known` where names or tree tell legs and arms."""

    name: str
    joints: tuple[int, ...]
    known: bool

    def half(self, count: int) -> float:
        """Half of a count of joints, or of a known body that has fewer: what an animation of it moves at least."""
        return min(count, len(self.joints) if self.known else count) / 2


def find_bodies(nodes: Nodes, moved: Collection[int] = ()) -> list[Body]:
    """The bodies of a file, known ones first: joints of skins and `moved` nodes that hang together.

    A branch that has the names of a whole body is one, with all that hangs on it and wherever it hangs itself. What is
    left is one body for what holds the joints of its skins, or most of what moves; it is parted where its branches are
    bodies by their rest poses. FileError where the nodes are no tree.
    """
    shown = {n for n in moved if nodes.entry(n).skin is None and not _films(nodes.entry(n))}
    tops = dict.fromkeys(_named_tops(nodes), True)
    for bones, fraction in ((nodes.skinned, 1.0), (shown, MOVED_FRACTION)):
        for _ in range(MAX_LOOSE_BODIES):
            inside, above = nearest_of(nodes.order, nodes.parents, tops), set(nodes.with_ancestors(tops))
            apart = {node for node in set(bones) - above if inside[node] < 0}
            if not apart:
                break
            top, loose = _top(nodes, apart, fraction), {n for n in nodes.skinned | shown if inside[n] < 0}
            tops |= _parted(nodes, top, loose) or {top: False}
    inside = nearest_of(nodes.order, nodes.parents, tops)
    kept = _joints(nodes, inside, nodes.skinned | shown)
    bodies = []
    for top, known in tops.items():
        holder = nodes.parents[top]  # what holds this body alone, as an armature does, has its name
        alone = holder >= 0 and {inside[node] for node in nodes.under(holder)} <= {-1, top}
        name = nodes.name(holder if alone and nodes.name(holder) != FBX_ROOT else top)
        bodies.append(Body(name, tuple(kept[top]), known))
    return sorted(bodies, key=lambda body: (not body.known, nodes.order.index(body.joints[0])))


def open_character(path: Path) -> tuple[GltfFile, str]:
    """A file without the skins and meshes of further bodies, and a sentence about them, "" where there is one body. FileError."""
    file = open_gltf(path)
    nodes = Nodes.of(file)
    known = [body for body in find_bodies(nodes) if body.known] if nodes.skinned else []
    others = {joint for body in known[1:] for joint in body.joints}
    if not others:
        return file, ""
    skins = file.gltf.skins
    kept = [k for k, s in enumerate(skins) if 2 * len(others.intersection(s.joints)) <= len(s.joints)]
    inside = nearest_of(nodes.order, nodes.parents, others)
    for node, entry in enumerate(file.gltf.nodes):
        if (inside[node] >= 0) if entry.skin is None else entry.skin not in kept:
            entry.pop("mesh", None), entry.pop("skin", None)
        elif entry.skin is not None:
            entry["skin"] = kept.index(entry.skin)
    file.gltf["skins"] = [skins[k] for k in kept]
    names = [printable(body.name)[:60] for body in known]
    return file, f"{path.name}: {len(names)} bodies; {names[0]} is taken, not {', '.join(names[1:7])}."


def _films(entry: Entry) -> bool:
    """Return whether a node is a camera or a light."""
    return entry.camera is not None or bool((entry.extensions or {}).get("KHR_lights_punctual"))


def _bits() -> dict[str, AnyArray]:
    """For each name, without case and punctuation, the joints of NEEDED that it has in each convention, as bits."""
    bits: dict[str, AnyArray] = {}
    for number, table in enumerate(CONVENTIONS.values()):
        for bit, joint in enumerate(NEEDED):
            found = bits.setdefault(table[joint], np.zeros(len(CONVENTIONS), np.int64))
            # hips and head as any convention calls them
            found[slice(None) if bit < 2 else number] |= 1 << bit
    return bits


def _named_tops(nodes: Nodes) -> list[int]:
    """The lowest nodes in whose branch, but for those of others, are all the names of a body in one convention."""
    bits, bones = _bits(), vrm_bones(nodes.file)
    found = np.zeros((len(nodes.parents), len(CONVENTIONS)), np.int64)
    tops = []
    for node in reversed(nodes.order):
        for name in name_variants(str(bones.get(node) or nodes.entry(node).name or "")):
            found[node] |= bits.get(name, 0)
        if np.any(found[node] == (1 << len(NEEDED)) - 1):
            tops.append(node)
        elif nodes.parents[node] >= 0:
            found[nodes.parents[node]] |= found[node]
    return tops[::-1]


def _top(nodes: Nodes, bones: Collection[int], fraction: float) -> int:
    """The lowest node that is one of some nodes, or has a fraction of those of its tree in its branch."""
    below = nodes.counts(bones)
    top = max((node for node in nodes.order if nodes.parents[node] < 0), key=lambda node: below[node])
    least = fraction * below[top]
    while top not in bones:
        deeper = [child for child in nodes.children(top) if below[child] >= least]
        if not deeper:
            break
        top = deeper[0]
    return top


def _parted(nodes: Nodes, top: int, bones: Collection[int], depth: int = 8) -> dict[int, bool]:
    """The lowest nodes, from a top down, whose branches are bodies by their rest pose; none where no branch is."""
    below = nodes.counts(bones)
    while len(deeper := [child for child in nodes.children(top) if below[child]]) == 1 and top not in bones:
        top = deeper[0]
    if depth == 0 or not LEAST_JOINTS <= below[top] <= MAX_BODY_JOINTS:
        return {}
    branch = list(filter(below.__getitem__, nodes.under(top)))
    place = {node: k for k, node in enumerate(branch)}
    tree = JointTree([place.get(nodes.parents[node], -1) for node in branch], nodes.rest[branch, :3, 3])
    known = bool(guess_by_structure(tree, tree.positions))
    if known or leg_count(tree) <= 2:
        return {top: True} if known else {}
    return {node: True for child in deeper for node in _parted(nodes, child, bones, depth - 1)}


def _joints(nodes: Nodes, inside: list[int], bones: Collection[int]) -> dict[int, list[int]]:
    """Return the joints of each body by its top, parents first: its branch without leaf meshes, cameras and lights.

    Those are more than skins name, which many programs write without joints that hold no vertex.
    """
    kept = set[int]()
    for node in reversed(nodes.order):
        bare = nodes.entry(node).mesh is None and not _films(nodes.entry(node))
        if bare or node in bones or not kept.isdisjoint(nodes.children(node)):
            kept.add(node)
    joints: dict[int, list[int]] = {top: [top] for top in inside if top >= 0}
    for node in nodes.order:
        if inside[node] >= 0 and node in kept and node not in joints:
            joints[inside[node]].append(node)
    return joints
