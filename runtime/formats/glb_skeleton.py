"""A user's character as rig of a take: its own skeleton, transformed to the take's space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.character.character import Character
from runtime.character.glb_buffer import GlbBuffer
from runtime.character.mesh import MeshData, skin_joints
from runtime.character.nodes import Nodes
from runtime.character.read import GltfFile
from runtime.character.tree import ancestors
from runtime.formats.prepare import PreparedTake
from runtime.skeleton import SPORT_SKELETON

if TYPE_CHECKING:
    from pygltflib import GLTF2, Node


ROOT_NAMES = ("Root", "GroundRoot", "SportGroundRoot")
# offset of a root joint at rest: Blender merges hips with a root bone that ends at them, and loses their translation
OFF_THE_HIPS_M = 1e-3
HANDS_FRAMES = 120  # extra frames before and after the written ones, which smooth the hands
SAME_TOLERANCE = 1e-4  # a character that needs less scaling and rotation is already in our space


@dataclass
class Rig:
    """A character's node hierarchy, prepared for animation.

    `joints` maps nodes to character joints, `space` `(4, 4)` transforms the file's space to the take's (metres, Y up,
    facing +Z), `parents` are the nodes' parents, `rest` their world matrices in the take's space.
    """

    character: Character
    gltf: GLTF2
    joints: dict[int, int]
    parents: list[int]
    rest: Array
    space: Array
    size: float  # scale relative to the take
    ground_point: Array  # (3,) under the hips on the level of the soles, rest pose, take's space
    root_node: int = -1  # the node on the ground, if any
    plain: bool = False  # written without scales and without nodes above the joints
    # inverse bind matrices (n, 4, 4) of skins, as written
    binds: dict[int, Array] = field(default_factory=dict)

    @property
    def sport_nodes(self) -> dict[str, int]:
        """The node of each SPORT joint that the character has."""
        played = self.character.sport_joints
        return {SPORT_SKELETON.names[played[k]]: node for node, k in self.joints.items() if played[k] >= 0}


def open_rig(
    buffer: GlbBuffer,
    file: GltfFile,
    character: Character,
    data: MeshData,
    ground_root: bool,
    plain: bool = False,
    size: float = 1.0,
) -> Rig:
    """Return the rig of a character; its document then contains the character alone, in the take's space.

    `plain` removes joint scales and all but one node above the joints, as engines expect. `size` is the factor on the
    take's metres; 1 keeps the file's metres.
    """
    joints: dict[int, int] = {}
    for k, node in enumerate(data.joint_nodes):
        joints.setdefault(node, k)  # a joint of several skins follows the first one
    hips = int(np.flatnonzero(character.sport_joints == SPORT_SKELETON.index("Hips"))[0])
    space = np.eye(4)
    axes = character.rest_world[hips, :3, :3].astype(np.float64)
    space[:3, :3] = size * character.alignment.basis[hips] @ np.linalg.inv(axes)
    nodes = Nodes(file)
    rest = space @ nodes.rest
    soles = float((data.rest_positions() @ space[:3, :3].T)[:, 1].min())
    x, _, z = rest[data.joint_nodes[hips], :3, 3]
    rig = Rig(character, buffer.gltf, joints, list(nodes.parents), rest, space, size, np.array([x, soles, z]))
    for index, skin in enumerate(rig.gltf.skins):
        rig.binds[index] = skin_joints(file, index)[1][: len(skin.joints)].astype(np.float64)
    (_set_plain_scene if plain else _set_scene)(rig)
    if plain:
        _part_from_hips(rig, data.joint_nodes[hips])
    if ground_root:
        _add_root(rig, data.joint_nodes[hips])
    for index, skin in enumerate(rig.gltf.skins):
        if plain or ground_root:
            flat = rig.binds[index].swapaxes(1, 2).reshape(-1, 16)
            skin.inverseBindMatrices = buffer.add(flat.astype(np.float32))
    return rig


def _set_plain_scene(rig: Rig) -> None:
    """Replace the scene by one node, the joints without scales below it, and the meshes, with skins rebound."""
    import pygltflib as g

    gltf, parents, count = rig.gltf, rig.parents, len(rig.parents)
    moving = {n for joint in rig.joints for n in ancestors(parents, joint) if _under_joint(rig, n)}
    rig.plain, rig.space = True, np.eye(4)
    for index, skin in enumerate(gltf.skins):
        rest = rig.rest[skin.joints]
        rig.binds[index] = np.linalg.inv(written(rig, rest)) @ rest @ rig.binds[index]
        rig.binds[index][:, 3] = (0.0, 0.0, 0.0, 1.0)
        skin.skeleton = None
    heads = [n for n in sorted(moving) if parents[n] not in moving]
    loose = _loose_meshes(rig, ancestors(parents, heads[0])[-1])
    for node in (*heads, *loose):
        if parents[node] >= 0:
            gltf.nodes[parents[node]].children.remove(node)
        parents[node] = count
    _append_node(rig, g.Node(name="Armature", children=[*heads, *loose]), -1, np.eye(4))
    _set_plain_locals(rig, moving, loose)
    gltf.scenes, gltf.scene = [g.Scene(name="take", nodes=[count])], 0


def _loose_meshes(rig: Rig, own: int) -> list[int]:
    """Return nodes with meshes that are not below a joint: skinned ones, and those below the `own` uppermost node."""
    meshes = [
        n for n, node in enumerate(rig.gltf.nodes) if node.mesh is not None and not _under_joint(rig, n)
    ]
    return [n for n in meshes if rig.gltf.nodes[n].skin is not None or ancestors(rig.parents, n)[-1] == own]


def _set_plain_locals(rig: Rig, moving: set[int], loose: list[int]) -> None:
    """Set the transforms of joints without scales, of loose meshes, and of nodes attached to joints."""
    nodes, parents = rig.gltf.nodes, rig.parents
    for node in range(len(nodes) - 1):
        if node in moving:
            set_local(nodes[node], local_rest(rig, node))
        elif node in loose:
            set_local(nodes[node], np.eye(4) if nodes[node].skin is not None else rig.rest[node])
        elif parents[node] in moving:
            above = written(rig, rig.rest[parents[node]])
            set_local(nodes[node], np.linalg.inv(above) @ rig.rest[node])


def _under_joint(rig: Rig, node: int) -> bool:
    """Return whether a node is a joint or a descendant of one."""
    return any(above in rig.joints for above in ancestors(rig.parents, node))


def written(rig: Rig, world: Array) -> Array:
    """Return joint world matrices `(..., 4, 4)` as they are written to the file: without scale for a plain rig."""
    if not rig.plain:
        return world
    result = world.copy()
    result[..., :3, :3] = rotations.to_matrix(nearest_rotation(world[..., :3, :3]))
    return result


def _set_scene(rig: Rig) -> None:
    """Keep only the character in the scene, in the take's space."""
    import pygltflib as g

    gltf = rig.gltf
    carried = {ancestors(rig.parents, joint)[-1] for joint in rig.joints}
    moved = sorted(carried)
    alone = [top for top, above in enumerate(rig.parents) if above < 0 and not gltf.nodes[top].children]
    skinned = [top for top in alone if top not in carried and gltf.nodes[top].skin is not None]
    if np.allclose(rig.space, np.eye(4), atol=SAME_TOLERANCE):
        rig.space = np.eye(4)
    else:
        turn, scale = rotation_and_scale(rig.space)
        above = g.Node(name="Character", children=moved, rotation=_xyzw(turn), scale=scale.tolist())
        number = _append_node(rig, above, -1, rig.space)
        for top in moved:
            rig.parents[top] = number
        moved = [number]
    gltf.scenes, gltf.scene = [g.Scene(name="take", nodes=[*moved, *skinned])], 0


def _append_node(rig: Rig, node: Node, parent: int, rest: Array) -> int:
    """Return the index of a new node with the rest transform `rest` `(4, 4)` in the take's space."""
    rig.gltf.nodes.append(node)
    rig.parents.append(parent)
    rig.rest = np.concatenate([rig.rest, rest[None]])
    return len(rig.parents) - 1


def _add_root(rig: Rig, hips: int) -> None:
    """Add a joint above the hips that stays on the ground: the character's own uppermost joint, or a new one."""
    import pygltflib as g

    top = [node for node in ancestors(rig.parents, hips) if node in rig.joints][-1]
    if top != hips:
        rig.root_node = top
        return
    above, gltf = rig.parents[hips], rig.gltf
    frame = rig.rest[above].copy() if above >= 0 else np.eye(4)
    frame[:3, 3] = rig.ground_point
    if rig.plain:
        frame[2, 3] -= OFF_THE_HIPS_M
    free = set(ROOT_NAMES) - {node.name for node in gltf.nodes}
    name = min(free or {ROOT_NAMES[-1]}, key=ROOT_NAMES.index)
    rig.root_node = _append_node(rig, g.Node(name=name, children=[hips]), above, frame)
    siblings = gltf.nodes[above].children if above >= 0 else gltf.scenes[0].nodes
    siblings[siblings.index(hips)] = rig.root_node
    rig.parents[hips] = rig.root_node
    for node in (rig.root_node, hips):
        set_local(gltf.nodes[node], local_rest(rig, node))
    _bind_root(rig, hips, frame)


def _part_from_hips(rig: Rig, hips: int) -> None:
    """Offset the character's own root at rest if the hips lie on its Y axis."""
    root, nodes = rig.parents[hips], rig.gltf.nodes
    frame = written(rig, rig.rest[root])
    way = rig.rest[hips, :3, 3] - frame[:3, 3]
    if root not in rig.joints or np.linalg.norm(frame[:3, 1] * np.linalg.norm(way) - way) > OFF_THE_HIPS_M:
        return
    rig.rest[root, 2, 3] -= OFF_THE_HIPS_M
    moved = np.linalg.inv(written(rig, rig.rest[root])) @ frame
    for index, skin in enumerate(rig.gltf.skins):
        bound = np.array(skin.joints) == root
        rig.binds[index][bound] = moved @ rig.binds[index][bound]
    for node in (root, *nodes[root].children):
        set_local(nodes[node], local_rest(rig, node))


def _bind_root(rig: Rig, hips: int, frame: Array) -> None:
    """Make the root joint at `frame` a joint of every skin of the hips."""
    back = np.linalg.inv(written(rig, frame)) @ written(rig, rig.rest[hips])
    for index, skin in enumerate(rig.gltf.skins):
        if hips in skin.joints:  # in the mesh's space, which may have another unit
            bind = back @ rig.binds[index][skin.joints.index(hips)]
            bind[3] = (0.0, 0.0, 0.0, 1.0)
            rig.binds[index] = np.concatenate([rig.binds[index], bind[None]])
            skin.joints.append(rig.root_node)
            skin.skeleton = None


def local_rest(rig: Rig, node: int) -> Array:
    """Return the rest transform `(4, 4)` of a node relative to its parent."""
    parent = rig.parents[node]
    world = written(rig, rig.rest[node])
    return world if parent < 0 else np.linalg.inv(written(rig, rig.rest[parent])) @ world


def set_local(node: Node, matrix: Array) -> tuple[Array, Array]:
    """Set a node's transform as translation, rotation and scale; return the rotation `(4,)` and scale `(3,)`."""
    turn, scale = rotation_and_scale(matrix)
    node.matrix, node.translation, node.rotation = None, matrix[:3, 3].tolist(), _xyzw(turn)
    node.scale = None if np.allclose(scale, 1.0, atol=1e-6) else scale.tolist()
    return turn, scale


def rotation_and_scale(matrix: Array) -> tuple[Array, Array]:
    """Return the rotation `(4,)` and scale `(3,)` of a transform `(4, 4)`."""
    linear = matrix[:3, :3]
    scale = np.linalg.norm(linear, axis=0) * (1.0 if np.linalg.det(linear) >= 0.0 else -1.0)
    return nearest_rotation(linear / scale), scale


def _xyzw(turn: Array) -> list[float]:
    return [float(v) for v in turn[[1, 2, 3, 0]]]


def nearest_rotation(linear: Array) -> Array:
    """Return the quaternions `(..., 4)` nearest to matrices `(..., 3, 3)`."""
    left, _, right = np.linalg.svd(linear)
    sign = np.linalg.det(left @ right)
    left = left * np.stack([np.ones_like(sign), np.ones_like(sign), sign], -1)[..., None, :]
    return rotations.normalize(rotations.from_matrix(left @ right))


def joint_worlds(rig: Rig, take: PreparedTake, frames: slice) -> dict[int, Array]:
    """Return the world matrices `(n, 4, 4)` of every joint node in the take's space, for a range of frames."""
    clip, character = take.clip, rig.character
    begin = max(frames.start - HANDS_FRAMES, 0)  # hands are smoothed across the ends of a chunk
    wide = slice(begin, min(frames.stop + HANDS_FRAMES, len(clip)))
    hips = np.asarray(clip.hips_positions[wide], np.float64)
    skeleton_positions, world = SPORT_SKELETON.forward_kinematics(
        hips, np.asarray(clip.local_rotations[wide], np.float64)
    )
    contacts = np.asarray(clip.contacts[wide], np.float64)
    adapted = character.adapted(skeleton_positions, world, contacts)
    own = slice(frames.start - begin, frames.stop - begin)
    hips, adapted = hips[own], (adapted[0][own], adapted[1][own])
    pivots, turns = character.joint_transforms(*adapted)
    pivots = rig.size * pivots
    linear = rig.size * rotations.to_matrix(turns) @ character.alignment.basis
    result: dict[int, Array] = {}
    # of the root joint, and from the rest pose to it
    root: Array = np.tile(np.eye(4), (len(hips), 1, 1))
    root[:, :3, :3] = rotations.to_matrix(rotations.from_yaw(take.root.yaw[frames]))
    root[:, :3, 3] = rig.size * take.root.positions[frames]
    for node, k in rig.joints.items():
        matrices: Array = np.tile(np.eye(4), (len(hips), 1, 1))
        matrices[:, :3, :3], matrices[:, :3, 3] = linear[:, k], pivots[:, k]
        if frames.start == 0 and take.rest_frame:
            matrices[0] = root[0] @ rig.rest[node]
            matrices[0, :3, 3] -= root[0, :3, :3] @ rig.ground_point
        result[node] = matrices
    if rig.root_node >= 0:
        root[:, :3, :3] = root[:, :3, :3] @ rig.rest[rig.root_node, :3, :3]
        result[rig.root_node] = root
    return {node: written(rig, matrices) for node, matrices in result.items()}


def rename_bones(rig: Rig, bones: Mapping[str, str]) -> None:
    """Rename the joints of a rig to an engine's humanoid names; joints without an entry keep their names."""
    node_of = rig.sport_nodes | {"Root": rig.root_node}
    wanted: dict[int, str] = {}
    for name, bone in bones.items():
        if node_of.get(name, -1) >= 0:
            wanted.setdefault(node_of[name], bone)
    taken = set(wanted.values())
    for number, node in enumerate(rig.gltf.nodes):
        if number in wanted:
            node.name = wanted[number]
        elif node.name in taken:
            node.name = f"{node.name}_{number}"
