"""A take as binary FBX: the document of `runtime.formats.glb` written again, object by object.

Joints are limbs whose rest rotation is their PreRotation; every frame is a key, and every take a stack.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.atomic import write_atomic
from runtime.character.mesh import skin_joints
from runtime.character.read import (
    STRUCTURE_ERRORS,
    Entry,
    GltfFile,
    accessor_count,
    ancestors,
    node_world_matrices,
    read_accessor,
)
from runtime.errors import FileError
from runtime.formats.engines import engine_of
from runtime.formats.fbx_mesh import Meshes, Skin
from runtime.formats.fbx_nodes import Document, Node, matrix, prop, properties, ticks
from runtime.formats.glb import glb_document
from runtime.formats.glb_skeleton import rotation_and_scale
from runtime.formats.options import UNITS_PER_METRE, ExportOptions
from runtime.formats.prepare import Check, PreparedTake, go_on
from runtime.safe_read import reason
from runtime.terrain.height_map import Terrain

LEVEL_DEG = 1e-6  # a joint that is turned by less at rest has no PreRotation
LINEAR = 24836  # flags of keys that are joined by lines
KEY_VERSION = 4008
KEY_KIND = [
    Node("KeyAttrFlags", np.array([LINEAR], np.int32)),
    Node("KeyAttrDataFloat", np.zeros(4, np.float32)),
]


def save_fbx(
    take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None, check: Check = go_on
) -> None:
    """Write a prepared take as FBX; FileError when the character cannot be used or the file not be written."""
    buffer, _ = glb_document(take, replace(options, plain=True), terrain, check)
    units = UNITS_PER_METRE[engine_of(options.engine).fbx_unit if options.engine else "m"]
    try:
        scene = _Scene(buffer.as_file(path), units)
        scene.write(take.clip.fps, check)
    except STRUCTURE_ERRORS as error:
        raise FileError(f"{path}: its character is damaged ({reason(error)}).", "Write a .glb.") from error
    write_atomic(path, scene.document.to_bytes(take.clip.name, units, take.clip.fps))


class _Scene:
    """A file of a take, and the FBX that it becomes, with so many units in a metre."""

    def __init__(self, file: GltfFile, units: float) -> None:
        self.file, self.units, self.document = file, units, Document()
        every, self.parents = ancestors(file)
        shown = set(file.gltf.scenes[0].nodes)
        for node in every:
            if self.parents[node] in shown:
                shown.add(node)
        self.order = [node for node in every if node in shown]
        self.world = node_world_matrices(file, every, self.parents)
        for node in self.order:
            if file.gltf.nodes[node].skin is not None:  # carried by its joints alone
                self.world[node] = np.eye(4)
                self.parents[node] = self._top(node)
        self.world[:, :3, 3] *= units
        self.joints = self._joint_nodes()
        self.turns: dict[int, Array] = {}  # of nodes at rest
        self.ids: dict[int, np.int64] = {}
        self.binds = {node: self.world[node] for node in self.order}

    def _top(self, node: int) -> int:
        """The uppermost node above one, -1 where there is none."""
        above = self.parents[node]
        while above >= 0 and self.parents[above] >= 0:
            above = self.parents[above]
        return above

    def _joint_nodes(self) -> set[int]:
        """Nodes of the skeleton: those of skins, those that move, and what lies between."""
        gltf = self.file.gltf
        wanted = {node for skin in gltf.skins or [] for node in skin.joints}
        wanted |= {channel.target.node for take in gltf.animations for channel in take.channels}
        for node in reversed(self.order):
            above = self.parents[node]
            if node in wanted and above >= 0 and self.parents[above] >= 0:
                wanted.add(above)
        return wanted

    def write(self, fps: float, check: Check) -> None:
        """Add all objects to the document."""
        nodes, skins = self.file.gltf.nodes, self.file.gltf.skins or []
        for node in self.order:
            self._model(node, nodes[node])
        bound = [self._skin(index) for index in range(len(skins))]
        meshes = Meshes(self.file, self.document, self.units)
        for node in self.order:
            if nodes[node].mesh is not None:
                check()
                skin = None if nodes[node].skin is None else bound[nodes[node].skin]
                meshes.add(nodes[node].mesh, self.ids[node], skin)
        self._bind_pose()
        for take in self.file.gltf.animations:
            self._animate(take, fps, check)

    def _model(self, node: int, entry: Entry) -> None:
        """Add a node: a limb, a mesh, or one that only carries others."""
        above, name, joint = self.parents[node], entry.name or f"node_{node}", node in self.joints
        local = self.world[node] if above < 0 else np.linalg.inv(self.world[above]) @ self.world[node]
        turn, scale = rotation_and_scale(local)
        facts = [prop("InheritType", "enum", 1), prop("DefaultAttributeIndex", "int", 0)]
        degrees = _degrees(turn[None])[0]
        if joint and np.abs(degrees).max() > LEVEL_DEG:
            self.turns[node] = turn
            facts += [prop("RotationActive", "bool", 1), prop("PreRotation", "Vector3D", *degrees.tolist())]
        turned = np.zeros(3) if joint else degrees
        for what, values in (("Translation", local[:3, 3]), ("Rotation", turned), ("Scaling", scale)):
            facts.append(prop(f"Lcl {what}", f"Lcl {what}", *values.tolist(), flags="A"))
        if above < 0 and entry.mesh is None:
            text = json.dumps(self.file.gltf.scenes[0].extras["sport"], ensure_ascii=False)
            facts.append(prop("sport", "KString", text, flags="U"))
        kind = "LimbNode" if joint else "Null" if entry.mesh is None else "Mesh"
        parts = [
            Node("Version", 232),
            properties(*facts),
            Node("Shading", True),
            Node("Culling", "CullingOff"),
        ]
        self.ids[node] = self.document.add("Model", name, kind, parts)
        self.document.connect(self.ids[node], np.int64(0) if above < 0 else self.ids[above])
        if kind != "Mesh":
            flags = Node("TypeFlags", "Skeleton" if joint else "Null")
            attribute = self.document.add("NodeAttribute", name, kind, [flags])
            self.document.connect(attribute, self.ids[node])

    def _skin(self, index: int) -> Skin:
        """A skin with its mesh where the first joint has it at rest."""
        joints, inverse = skin_joints(self.file, index)
        binds = inverse[: len(joints)].astype(np.float64)
        unit = np.diag([self.units] * 3 + [1.0])
        place = self.world[joints[0]] @ unit @ binds[0]
        links = place @ np.linalg.inv(unit @ binds)
        for joint, link in zip(joints, links, strict=True):
            self.binds[joint] = link
        names = [self.file.gltf.nodes[joint].name or "" for joint in joints]
        return Skin(place, links, [self.ids[joint] for joint in joints], names)

    def _bind_pose(self) -> None:
        nodes = [
            Node("PoseNode", children=[Node("Node", self.ids[node]), matrix("Matrix", self.binds[node])])
            for node in self.order
        ]
        head = [Node("Type", "BindPose"), Node("Version", 100), Node("NbPoseNodes", len(nodes))]
        self.document.add("Pose", "Bind pose", "BindPose", [*head, *nodes])

    def _animate(self, take: Entry, fps: float, check: Check) -> None:
        """Add an animation: a curve for each axis of what moves."""
        times = ticks(np.arange(accessor_count(self.file, take.samplers[0].input)), fps)
        shared = [Node("KeyVer", KEY_VERSION), Node("KeyTime", times), *KEY_KIND]
        shared.append(Node("KeyAttrRefCount", np.array([len(times)], np.int32)))
        layer = self.document.add_take(take.name, times[-1])
        for channel in take.channels:
            check()
            node, what = channel.target.node, channel.target.path.capitalize()
            values = read_accessor(self.file, take.samplers[channel.sampler].output, "a track").astype(float)
            if what == "Rotation":
                turns, rest = values[:, [3, 0, 1, 2]], self.turns.get(node, rotations.identity())
                values = _degrees(rotations.multiply(rotations.inverse(rest), turns))
            else:
                values *= self.units
            axes = [f"d|{axis}" for axis in "XYZ"]
            first = [prop(a, "Number", v, flags="A") for a, v in zip(axes, values[0].tolist(), strict=True)]
            moved = self.document.add("AnimationCurveNode", what[0], "", [properties(*first)])
            self.document.connect(moved, layer)
            self.document.connect(moved, self.ids[node], f"Lcl {what}")
            for axis, column in zip(axes, values.T, strict=True):
                keys = [Node("Default", float(column[0])), Node("KeyValueFloat", column.astype(np.float32))]
                curve = self.document.add("AnimationCurve", "", "", keys + shared)
                self.document.connect(curve, moved, axis)


def _degrees(turns: Array) -> Array:
    """Angles `(T, 3)` about x, y and z without jumps, which FBX takes one after the other."""
    return np.rad2deg(rotations.continuous_euler(rotations.to_euler(turns, "ZYX")))[:, ::-1]
