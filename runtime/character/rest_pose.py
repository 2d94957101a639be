"""The rest pose of bodies in a glTF file: their bind pose, placed at the nodes' positions."""

from collections.abc import Sequence
from itertools import compress

import numpy as np

from runtime.arrays import AnyArray
from runtime.character.mesh import skin_joints
from runtime.character.nodes import Nodes

MAX_BIND_MATRICES = 50_000
MIN_AGREEING_JOINTS = 3  # minimum joints of a skin to determine its space
ALIKE_FRACTION = 1e-3  # of a body's size: tolerance for rounding of joint positions
SAME_LENGTH_FACTOR = 1.03
MAX_STRETCH_FACTOR = 1.5  # bones of skin and nodes that differ by more do not match
REMEDY = "Apply the scale of the armature and export it again."
Pose = dict[int, AnyArray]  # world matrices (4, 4) of joints, by node


def bind_worlds(nodes: Nodes, joints: Sequence[int]) -> AnyArray:
    """Return rest transforms `(joints, 4, 4)`: the bind pose where skins define it, else the nodes' own transforms.

    Skins may define it in different spaces (`_space`). Joints without a skin keep their transform relative to the next
    joint. Raises FileError if bone lengths of a skin and of the nodes differ.
    """
    rest = nodes.rest
    # transform from a node's position to its bind position
    moved = {node: matrix @ np.linalg.inv(rest[node]) for node, matrix in _told(nodes, set(joints)).items()}
    if not moved:
        return np.asarray(rest[list(joints)])
    for node in nodes.with_ancestors(moved)[::-1]:
        moved.setdefault(nodes.parents[node], moved[node])
    for node in nodes.order:
        moved.setdefault(node, moved[nodes.parents[node]])
    return np.array([moved[joint] @ rest[joint] for joint in joints])


def _told(nodes: Nodes, wanted: set[int]) -> Pose:
    """Return the world bind pose of wanted joints, as far as skins define it; skins with more joints have priority."""
    told, spaces, skins = Pose(), list[AnyArray](), nodes.file.gltf.skins or []
    if sum(len(skin.joints) for skin in skins) > MAX_BIND_MATRICES:
        raise nodes.file.error(f"more than {MAX_BIND_MATRICES} bind matrices.", REMEDY)
    for skin in sorted(range(len(skins)), key=lambda skin: -len(skins[skin].joints)):
        bound = _bound(nodes, skin, wanted)
        members, bind = list(bound), np.array([*bound.values()])
        space = _space(nodes, skin, members, bind, spaces, told) if members else None
        if space is not None:
            spaces.append(space)
            told = dict(zip(members, space @ bind, strict=True)) | told
    return told


def _bound(nodes: Nodes, skin: int, wanted: set[int]) -> Pose:
    """Return the bind matrices of a skin's wanted joints, parents first, in its own space; empty if it defines none."""
    if nodes.file.gltf.skins[skin].inverseBindMatrices is None:
        return {}
    joints, inverse = skin_joints(nodes.file, skin)
    inverse = inverse[: len(joints)].astype(np.float64)
    usable = np.flatnonzero(np.abs(np.linalg.det(inverse)) > 1e-15)
    found = {joints[k]: matrix for k, matrix in zip(usable, np.linalg.inv(inverse[usable]), strict=True)}
    return {node: found[node] for node in nodes.order if node in wanted and node in found}


def _space(
    nodes: Nodes, skin: int, members: list[int], bind: AnyArray, spaces: list[AnyArray], told: Pose
) -> AnyArray | None:
    """The transform `(4, 4)` from a skin's own space, in which its `members` have the matrices `bind`, to the world.

    It is the one that most joints agree on, since they stand as they were bound. If they do not, as in a frame of a
    motion, it is the space of another skin, of a node above this one, or the world: of those in which bones have the
    nodes' lengths, the one that moves joints least. Else the uppermost joint is assumed to stand as it was bound.
    None if it cannot be determined. FileError if no space gives bones the nodes' lengths.
    """
    at, agree = nodes.rest[members], len(members) >= MIN_AGREEING_JOINTS
    if agree and np.ptp(bind[:, :3, 3], axis=0).max() <= ALIKE_FRACTION * np.abs(bind[:, :3, :3]).max():
        return None  # degenerate matrices
    agreed = _agreed(at, bind) if agree else None
    if agreed is not None:
        return agreed
    candidates = (*spaces, *_holding(nodes, skin, members[0]), np.eye(4))
    stretches = [_stretch(nodes, members, space @ bind, told)[0] for space in candidates]
    fitting = list(compress(candidates, np.array(stretches) < SAME_LENGTH_FACTOR))
    if fitting:
        return min(fitting, key=lambda space: _moved(space @ bind, at))
    if told and not agree:
        return None
    space = nodes.rest[members[0]] @ np.linalg.inv(bind[0])
    stretch, problem = _stretch(nodes, members, space @ bind, told)
    if stretch > MAX_STRETCH_FACTOR:
        raise nodes.file.error(problem, REMEDY)
    return np.asarray(space)


def _agreed(at: AnyArray, bind: AnyArray) -> AnyArray | None:
    """Return the space in which more than half of the joints at `at` `(n, 4, 4)` stand as bound; None if there is none."""
    found = at @ np.linalg.inv(bind)
    apart = np.einsum("kab,jb->kja", found[:, :3], bind[:, :, 3]) - at[None, :, :3, 3]
    size = max(float(np.linalg.norm(np.ptp(at[:, :3, 3], axis=0))), 1e-9)
    agreeing = (np.abs(apart).max(axis=-1) < ALIKE_FRACTION * size).sum(axis=1)
    return np.asarray(found[int(np.argmax(agreeing))]) if 2 * agreeing.max() > len(at) else None


def _holding(nodes: Nodes, skin: int, first: int) -> AnyArray:
    """Return the transforms `(n, 4, 4)` of the nodes that show a skin, those above them, and the one above its first joint."""
    shown = [node for node in nodes.order if nodes.entry(node).skin == skin]
    above = (nodes.parents[node] for node in (first, *shown))
    return nodes.rest[[node for node in (*shown, *above) if node >= 0]]


def _stretch(nodes: Nodes, members: list[int], worlds: AnyArray, told: Pose) -> tuple[float, str]:
    """Return the factor by which bones at `worlds` differ in length from those of the nodes, and a sentence about the longest."""
    here = told | dict(zip(members, worlds, strict=True))
    nearest = nodes.nearest(here)
    pairs = [(nearest[nodes.parents[node]], node) for node in members if nodes.parents[node] >= 0]
    pairs = [(above, node) for above, node in pairs if above >= 0]
    lengths = np.array([np.linalg.norm(nodes.rest[b, :3, 3] - nodes.rest[a, :3, 3]) for a, b in pairs])
    own = np.array([np.linalg.norm(here[b][:3, 3] - here[a][:3, 3]) for a, b in pairs])
    usable = lengths > ALIKE_FRACTION * lengths.max(initial=0.0)
    if not np.any(usable):
        return 1.0, ""
    ratio = max(float(np.median(own[usable] / lengths[usable])), 1e-9)
    longest = int(np.argmax(lengths))
    above, joint = (nodes.name(node)[:40] for node in pairs[longest])
    problem = f"its skin binds {joint!r} {own[longest]:.3g} from {above!r}, but the node is {lengths[longest]:.3g} away."
    return max(ratio, 1.0 / ratio), problem


def _moved(worlds: AnyArray, at: AnyArray) -> float:
    """Mean distance between the joints of two poses with their centres aligned."""
    gaps = worlds[:, :3, 3] - at[:, :3, 3]
    return float(np.linalg.norm(gaps - gaps.mean(axis=0), axis=-1).mean())
