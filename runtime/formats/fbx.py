"""A take as binary FBX, converted object by object from the document of `runtime.formats.glb`.

Joints are limbs with their rest rotation as PreRotation; every frame is a key, and every take a stack.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.atomic import write_atomic
from runtime.character.mesh import skin_joints
from runtime.character.nodes import Nodes
from runtime.character.read import STRUCTURE_ERRORS, Entry, GltfFile
from runtime.errors import FileError
from runtime.formats.engines import engine_of
from runtime.formats.fbx_mesh import Meshes, Skin
from runtime.formats.fbx_nodes import TICKS_PER_S, ZERO, Document, Node, leaves, matrix, prop, properties
from runtime.formats.glb import further_takes, glb_document
from runtime.formats.glb_skeleton import rotation_and_scale
from runtime.formats.options import UNITS_PER_METRE, ExportOptions
from runtime.formats.prepare import Check, PreparedTake, go_on
from runtime.safe_read import reason
from runtime.terrain.height_map import Terrain

LEVEL_DEG = 1e-6  # a joint with a smaller rest rotation has no PreRotation
LINEAR_KEY_FLAGS = 24836  # flags of linear keys
KEY_VERSION = 4008


def save_fbx(
    take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None, check: Check = go_on
) -> None:
    """Write a prepared take as FBX; FileError if the character cannot be used or the file cannot be written."""
    takes = [take, *further_takes(options, terrain)]
    buffer, _ = glb_document(takes, replace(options, plain=True), terrain, check)
    units = UNITS_PER_METRE[engine_of(options.engine).fbx_unit if options.engine else "m"]
    try:
        scene = _Scene(buffer.as_file(path), units)
        scene.write(take.clip.fps, check)
    except STRUCTURE_ERRORS as error:
        raise FileError(f"{path}: its character is damaged ({reason(error)}).", "Write a .glb.") from error
    write_atomic(path, scene.document.to_bytes(units, take.clip.fps))


class _Scene:
    """A take's glTF document and the FBX made from it, at a number of units per metre."""

    def __init__(self, file: GltfFile, units: float) -> None:
        self.file, self.units, self.document = file, units, Document()
        nodes = Nodes(file)
        self.parents, self.world, self.joints = list(nodes.parents), nodes.rest, nodes.skeleton
        shown = nodes.nearest(set(file.gltf.scenes[0].nodes))
        self.order = [node for node in nodes.order if shown[node] >= 0]
        for node in self.order:
            if file.gltf.nodes[node].skin is not None:  # its skin alone determines its place
                self.world[node], self.parents[node] = np.eye(4), shown[node] if shown[node] != node else -1
        self.world[:, :3, 3] *= units
        self.turns: dict[int, Array] = {}  # rest rotations of joints
        self.ids: dict[int, np.int64] = {}
        self.binds = {node: self.world[node] for node in self.order}

    def write(self, fps: float, check: Check) -> None:
        """Add all objects of the scene to the document."""
        nodes = self.file.gltf.nodes
        for node in self.order:
            self._add_model(node, nodes[node])
        skins = [self._skin(index) for index in range(len(self.file.gltf.skins or []))]
        meshes = Meshes(self.file, self.document, self.units)
        for node in self.order:
            if nodes[node].mesh is not None:
                check()
                skin = None if nodes[node].skin is None else skins[nodes[node].skin]
                meshes.add(nodes[node].mesh, self.ids[node], skin)
        bound = [
            Node("PoseNode", children=[Node("Node", self.ids[node]), matrix("Matrix", self.binds[node])])
            for node in self.order
        ]
        head = leaves(Type="BindPose", Version=100, NbPoseNodes=len(bound))
        self.document.add("Pose", "Bind pose", "BindPose", [*head, *bound])
        for take in self.file.gltf.animations:
            self._add_take(take, fps, check)

    def _add_model(self, node: int, entry: Entry) -> None:
        """Add a node: a limb, a mesh, or a group."""
        above, name = self.parents[node], entry.name or f"node_{node}"
        kind = "LimbNode" if node in self.joints else "Null" if entry.mesh is None else "Mesh"
        facts = self._placed(node)
        if above < 0 and kind == "Null":
            facts.append(prop("sport", "KString", _note(self.file.gltf.scenes[0]), flags="U"))
        parts = [*leaves(Version=232), properties(*facts), *leaves(Shading=True, Culling="CullingOff")]
        self.ids[node] = self.document.add("Model", name, kind, parts, self.ids.get(above, ZERO))
        if kind != "Mesh":
            flags = leaves(TypeFlags="Skeleton" if kind == "LimbNode" else "Null")
            self.document.add("NodeAttribute", name, kind, flags, self.ids[node])

    def _placed(self, node: int) -> list[Node]:
        """Return the properties of a node's transform relative to its parent; without a joint's rotation."""
        above = self.parents[node]
        local = self.world[node] if above < 0 else np.linalg.inv(self.world[above]) @ self.world[node]
        turn, scale = rotation_and_scale(local)
        degrees = _degrees(turn[None])[0]
        facts = [prop("InheritType", "enum", 1), prop("DefaultAttributeIndex", "int", 0)]
        if node in self.joints and np.abs(degrees).max() > LEVEL_DEG:
            self.turns[node] = turn
            facts += [prop("RotationActive", "bool", 1), prop("PreRotation", "Vector3D", *degrees.tolist())]
        turned = np.zeros(3) if node in self.joints else degrees
        for name, values in (("Translation", local[:3, 3]), ("Rotation", turned), ("Scaling", scale)):
            facts.append(prop(f"Lcl {name}", f"Lcl {name}", *values.tolist(), flags="A"))
        return facts

    def _skin(self, index: int) -> Skin:
        """Return a skin with its mesh's transform at the rest pose of the first joint."""
        joints, inverse = skin_joints(self.file, index)
        unit = np.diag([self.units] * 3 + [1.0])
        binds = unit @ inverse[: len(joints)].astype(np.float64)
        place = self.world[joints[0]] @ binds[0]
        links = place @ np.linalg.inv(binds)
        self.binds.update(zip(joints, links, strict=True))
        names = [self.file.gltf.nodes[joint].name or "" for joint in joints]
        return Skin(place, links, [self.ids[joint] for joint in joints], names)

    def _add_take(self, take: Entry, fps: float, check: Check) -> None:
        """Add an animation: a curve for each animated axis, with a key in every frame."""
        count = self.file.count(take.samplers[0].input)
        times = np.round(np.arange(count) * (TICKS_PER_S / fps)).astype(np.int64)
        layer = self.document.add_take(take.name, times[-1], _note(take))
        alike = leaves(KeyVer=KEY_VERSION, KeyTime=times, KeyAttrFlags=np.array([LINEAR_KEY_FLAGS], np.int32),
                       KeyAttrDataFloat=np.zeros(4, np.float32), KeyAttrRefCount=np.array([count], np.int32))  # fmt: skip
        for channel in take.channels:
            check()
            node, what = channel.target.node, channel.target.path.capitalize()
            values = self.file.values(take.samplers[channel.sampler].output, "a track").astype(float)
            if what == "Rotation":
                rest = rotations.inverse(self.turns.get(node, rotations.identity()))
                values = _degrees(rotations.multiply(rest, values[:, [3, 0, 1, 2]]))
            else:
                values *= self.units
            columns = {f"d|{axis}": column for axis, column in zip("XYZ", values.T, strict=True)}
            begun = [prop(axis, "Number", float(v[0]), flags="A") for axis, v in columns.items()]
            moved = self.document.add("AnimationCurveNode", what[0], "", [properties(*begun)], layer)
            self.document.connect(moved, self.ids[node], f"Lcl {what}")
            for axis, column in columns.items():
                keys = leaves(Default=float(column[0]), KeyValueFloat=column.astype(np.float32))
                self.document.connect(self.document.add("AnimationCurve", "", "", keys + alike), moved, axis)


def _note(entry: Entry) -> str:
    """Return the JSON text of the metadata of a take."""
    return json.dumps(entry.extras["sport"], ensure_ascii=False)


def _degrees(turns: Array) -> Array:
    """Return continuous angles `(T, 3)` about x, then y, then z."""
    return np.rad2deg(rotations.continuous_euler(rotations.to_euler(turns, "ZYX")))[:, ::-1]
