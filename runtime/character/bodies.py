"""Bodies of a file: finds the joint nodes of each character among its skins, cameras, props and other characters."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.joints import CONVENTIONS, NEEDED, name_variants
from runtime.character.mesh import vrm_bones
from runtime.character.nodes import Nodes
from runtime.character.read import Entry, GltfFile, open_gltf
from runtime.character.structure import guess_by_structure, leg_count
from runtime.safe_read import printable

MAX_BODY_JOINTS = 1024
FBX_ROOT = "root"  # node above all others in a converted FBX
MIN_BODY_JOINTS = len(NEEDED)  # minimum joints of a body that is recognised by its hierarchy
MAX_LOOSE_BODIES = 8  # without recognisable names
# of a file without skins: fraction of the animated nodes, cameras and props apart, below the top of a body
MOVED_FRACTION = 0.8


@dataclass(frozen=True)
class Body:
    """The joint nodes of one character, parents first; `known` if names or the hierarchy identify its legs and arms."""

    name: str
    joints: tuple[int, ...]
    known: bool

    def half(self, count: int) -> float:
        """Return how many joints an animation must move to count as one of this body: half of `count`, or of a known smaller body's joints."""
        return min(count, len(self.joints) if self.known else count) / 2


def find_bodies(nodes: Nodes, moved: Collection[int] = ()) -> list[Body]:
    """Return the bodies of a file, recognised ones first: connected joints of skins and `moved` nodes.

    A branch with the joint names of a whole body is one body. Other joints form one body for each connected group,
    split where branches look like bodies in the rest pose. Raises FileError if the nodes do not form a tree.
    """
    shown = {node for node in moved if _bare(nodes.entry(node), "skin")}
    bones, tops = nodes.skinned | shown, dict.fromkeys(_named_tops(nodes), True)
    for wanted, fraction in ((nodes.skinned, 1.0), (shown, MOVED_FRACTION)):
        for _ in range(MAX_LOOSE_BODIES):
            inside = nodes.nearest(tops)
            loose = {node for node in bones if inside[node] < 0}
            apart = wanted & loose - set(nodes.with_ancestors(tops))
            if not apart:
                break
            top = _top(nodes, apart, fraction)
            tops |= _parted(nodes, top, loose) or {top: False}
    inside = nodes.nearest(tops)
    kept = _joints(nodes, tops, inside, bones)
    bodies = [Body(_body_name(nodes, top, inside), tuple(kept[top]), known) for top, known in tops.items()]
    return sorted(bodies, key=lambda body: (not body.known, nodes.order.index(body.joints[0])))


def _body_name(nodes: Nodes, top: int, inside: list[int]) -> str:
    """Return the name of the node that holds this body alone, such as an armature, else of its top."""
    holder = nodes.parents[top]
    alone = holder >= 0 and {inside[node] for node in nodes.under(holder)} <= {-1, top}
    return nodes.name(holder if alone and nodes.name(holder) != FBX_ROOT else top)


def open_character(path: Path) -> tuple[GltfFile, str]:
    """Read a glTF file with its first body alone; also return a sentence that names the bodies left out, or "". Raises FileError."""
    file = open_gltf(path)
    nodes = Nodes(file)
    known = [body for body in find_bodies(nodes) if body.known] if nodes.skinned else []
    others = {joint for body in known[1:] for joint in body.joints}
    if not others:
        return file, ""
    _drop_skins(file, nodes.nearest(others), others)
    names = [printable(body.name)[:60] for body in known]
    return file, f"{path.name}: {len(names)} bodies; {names[0]} is used, not {', '.join(names[1:7])}."


def _drop_skins(file: GltfFile, inside: list[int], others: set[int]) -> None:
    """Remove skins that mostly consist of `others` joints, with their meshes and those attached to such joints."""
    skins = file.gltf.skins
    kept = [k for k, s in enumerate(skins) if 2 * len(others.intersection(s.joints)) <= len(s.joints)]
    for node, entry in enumerate(file.gltf.nodes):
        if (inside[node] >= 0) if entry.skin is None else entry.skin not in kept:
            entry.pop("mesh", None), entry.pop("skin", None)
        elif entry.skin is not None:
            entry["skin"] = kept.index(entry.skin)
    file.gltf["skins"] = [skins[k] for k in kept]


def _bare(entry: Entry, field: str) -> bool:
    """Whether a node lacks the given `field` ("mesh" or "skin") and is not a camera or light."""
    light = (entry.extensions or {}).get("KHR_lights_punctual")
    return entry.get(field) is None and entry.camera is None and not light


def _bits() -> dict[str, AnyArray]:
    """Return, by simplified name, the joints of NEEDED with that name in each convention, as bits."""
    bits: dict[str, AnyArray] = {}
    for number, table in enumerate(CONVENTIONS.values()):
        for bit, joint in enumerate(NEEDED):
            found = bits.setdefault(table[joint], np.zeros(len(CONVENTIONS), np.int64))
            # hips and head by any convention's name
            found[slice(None) if bit < 2 else number] |= 1 << bit
    return bits


def _named_tops(nodes: Nodes) -> list[int]:
    """Return the lowest nodes whose branches, without other bodies, contain all joint names of one convention."""
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
    """Return the lowest node that is one of `bones`, or has this fraction of its tree's in its branch."""
    below = nodes.counts(bones)
    top = max((node for node in nodes.order if nodes.parents[node] < 0), key=lambda node: below[node])
    least = fraction * below[top]
    while top not in bones:
        deeper = [child for child in nodes.children[top] if below[child] >= least]
        if not deeper:
            break
        top = deeper[0]
    return top


def _parted(nodes: Nodes, top: int, bones: Collection[int], depth: int = 8) -> dict[int, bool]:
    """Return the lowest nodes below a top whose branches are bodies by their rest pose; empty if none are."""
    below = nodes.counts(bones)
    while len(deeper := list(filter(below.__getitem__, nodes.children[top]))) == 1 and top not in bones:
        top = deeper[0]
    if depth == 0 or not MIN_BODY_JOINTS <= below[top] <= MAX_BODY_JOINTS:
        return {}
    tree = nodes.joint_tree(list(filter(below.__getitem__, nodes.under(top))))
    if guess_by_structure(tree, tree.positions):
        return {top: True}
    if leg_count(tree) <= 2:
        return {}
    return {node: True for child in deeper for node in _parted(nodes, child, bones, depth - 1)}


def _joints(
    nodes: Nodes, tops: Collection[int], inside: list[int], bones: Collection[int]
) -> dict[int, list[int]]:
    """Return the joints of each body by its top, parents first: its branch without leaf meshes, cameras and lights.

    Skins name fewer: many programs leave out joints without vertices.
    """
    kept = set[int]()
    for node in reversed(nodes.order):
        if _bare(nodes.entry(node), "mesh") or node in bones or not kept.isdisjoint(nodes.children[node]):
            kept.add(node)
    joints = {top: [top] for top in tops}
    for node in nodes.order:
        if inside[node] >= 0 and node in kept and node not in joints:
            joints[inside[node]].append(node)
    return joints
