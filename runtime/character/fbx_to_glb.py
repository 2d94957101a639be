"""An FBX character becomes a GLB, by the library ufbx in a process of its own (`native_worker`).

Meshes, skins, nodes, base colours and textures are kept; of animations the first one, where motion is wanted.
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

MAX_NODES, MAX_VERTICES = 20_000, 6_000_000  # of a file; the latter are corners of faces
MAX_SAMPLES = 3_000_000  # of the nodes of an animation
INFLUENCES = 8  # joints of a vertex, the strongest
_TYPES = {"f": (5126, np.float32), "u": (5125, np.uint32), "i": (5123, np.uint16)}
_WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


_KEPT: list[Any] = []


class Kept:
    """An object of ufbx 0.0.5, which frees elements that Python lets go of while the scene still points to them.

    Whatever is read through it is kept until the process ends.
    """

    __slots__ = ("value",)  # there is one for each vertex and weight

    def __init__(self, value: Any) -> None:
        _KEPT.append(value)
        self.value = value

    def __getattr__(self, name: str) -> Any:
        return _kept(getattr(self.value, name))

    def __getitem__(self, index: int) -> Any:
        return _kept(self.value[index])

    def __len__(self) -> int:
        return len(self.value)

    def __iter__(self) -> Iterator[Any]:
        return (self[k] for k in range(len(self)))

    def array(self) -> Any:
        """A list of numbers or vectors as an array."""
        return np.array(self.value)


def _kept(value: Any) -> Any:
    return value if value is None or isinstance(value, bool | int | float | str | bytes) else Kept(value)


class Document:
    """A glTF document and its only buffer."""

    def __init__(self) -> None:
        self.gltf: dict[str, Any] = {"asset": {"version": "2.0", "generator": "ufbx"}, "scene": 0}
        self.blob = bytearray()

    def append(self, field: str, entry: dict[str, Any]) -> int:
        """The index of a new entry of a list of the document."""
        entries = self.gltf.setdefault(field, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, data: bytes) -> int:
        """The index of a new buffer view."""
        self.blob.extend(b"\0" * (-len(self.blob) % 4))
        self.blob.extend(data)
        start = len(self.blob) - len(data)
        return self.append("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data)})

    def add(self, values: Any, kind: str = "f") -> int:
        """The index of an accessor of values `(count, width)`: "f" float32, "u" uint32, "i" uint16."""
        component, dtype = _TYPES[kind]
        values = np.ascontiguousarray(values, dtype)
        entry = {"bufferView": self.view(values.tobytes()), "componentType": component, "count": len(values),
                 "type": _WIDTHS[values.shape[1]], "min": values.min(0).tolist(), "max": values.max(0).tolist()}  # fmt: skip
        return self.append("accessors", entry)

    def to_bytes(self) -> bytes:
        """The GLB."""
        self.blob.extend(b"\0" * (-len(self.blob) % 4))
        self.gltf["buffers"] = [{"byteLength": len(self.blob)}]
        text = json.dumps(self.gltf).encode()
        text += b" " * (-len(text) % 4)
        size = 28 + len(text) + len(self.blob)
        head = struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON")
        return head + text + struct.pack("<I4s", len(self.blob), b"BIN\0") + self.blob


def convert(source: Path, motion: bool) -> bytes:
    """What an FBX shows at rest as GLB, in metres, Y up; with `motion` its first animation too."""
    import ufbx

    loaded = ufbx.load_file(
        str(source),
        target_axes=ufbx.axes_right_handed_y_up,
        target_unit_meters=1.0,
        space_conversion=ufbx.SpaceConversion.MODIFY_GEOMETRY,
        geometry_transform_handling=ufbx.GeometryTransformHandling.MODIFY_GEOMETRY,
        inherit_mode_handling=ufbx.InheritModeHandling.COMPENSATE,
        generate_missing_normals=True,
        clean_skin_weights=True,
        node_depth_limit=512,
    )
    scene = Kept(loaded)
    vertices = sum(mesh.num_indices for mesh in scene.meshes)
    if len(scene.nodes) > MAX_NODES or vertices > MAX_VERTICES:
        raise ValueError(f"{len(scene.nodes)} nodes and {vertices} corners of faces")
    document = Document()
    nodes = {node.typed_id: k for k, node in enumerate(scene.nodes)}
    materials = {m.typed_id: _material(document, m, source) for m in scene.materials}
    for node in scene.nodes:
        t = node.local_transform
        entry: dict[str, Any] = {
            "name": node.name or "root",
            "translation": [t.translation.x, t.translation.y, t.translation.z],
            "rotation": _unit([t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w]),
            "scale": [t.scale.x, t.scale.y, t.scale.z],
        }
        children = [nodes[child.typed_id] for child in node.children]
        if children:
            entry["children"] = children
        if node.mesh is not None and node.mesh.num_triangles > 0:
            entry["mesh"] = _mesh(document, node, materials)
            skin = _skin(document, node.mesh, nodes)
            if skin is not None:
                entry["skin"] = skin
        document.append("nodes", entry)
    if motion:
        _animate(document, ufbx.evaluate_transform, scene, nodes)
    document.gltf["scenes"] = [{"nodes": [nodes[scene.root_node.typed_id]]}]
    return document.to_bytes()


def _animate(document: Document, evaluate: Any, scene: Any, nodes: dict[int, int]) -> None:
    """The first animation, sampled at the rate of the file; the others by their names alone."""
    for number, stack in enumerate(scene.anim_stacks):
        entry: dict[str, Any] = {"name": stack.name, "channels": [], "samplers": []}
        document.append("animations", entry)
        if number:
            continue
        fps = min(max(float(scene.settings.frames_per_second), 1.0), 240.0)
        count = int(max(stack.time_end - stack.time_begin, 0.0) * fps + 1e-3) + 1
        if count * len(nodes) > MAX_SAMPLES:
            raise ValueError(f"an animation of {count} frames and {len(nodes)} nodes")
        times = np.arange(count) / fps
        input_ = document.add(times[:, None])
        for node in scene.nodes:
            moved = [evaluate(stack.anim.value, node.value, stack.time_begin + t) for t in times.tolist()]
            for path, fields in (("translation", "xyz"), ("rotation", "xyzw"), ("scale", "xyz")):
                values = np.array([[getattr(getattr(m, path), axis) for axis in fields] for m in moved])
                output = document.add(values)
                sampler = {"input": input_, "output": output, "interpolation": "LINEAR"}
                entry["samplers"].append(sampler)
                target = {"node": nodes[node.typed_id], "path": path}
                entry["channels"].append({"sampler": len(entry["samplers"]) - 1, "target": target})


def _unit(q: list[float]) -> list[float]:
    return (np.array(q) / max(float(np.linalg.norm(q)), 1e-12)).tolist()


def _triangles(mesh: Any) -> tuple[Any, Any]:
    """Corners `(n, 3)` of all triangles, faces as fans, and the material of each."""
    faces = mesh.faces.array().astype(np.int64)
    part = mesh.face_material.array().astype(np.int64)
    part = part if len(part) == len(faces) else np.zeros(len(faces), np.int64)
    corners, material = [], []
    for count in np.unique(faces[:, 1]):
        chosen = faces[:, 1] == count
        for k in range(1, int(count) - 1):
            corners.append(faces[chosen, :1] + np.array([0, k, k + 1]))
            material.append(part[chosen])
    return np.concatenate(corners), np.concatenate(material)


def _mesh(document: Document, node: Any, materials: dict[int, int]) -> int:
    mesh = node.mesh
    corners, parts = _triangles(mesh)
    weights = _weights(mesh)
    owner = node.materials if len(node.materials) else mesh.materials
    primitives = []
    for part in np.unique(parts):
        primitive = _primitive(document, mesh, corners[parts == part].ravel(), weights)
        if part < len(owner) and owner[int(part)] is not None:
            primitive["material"] = materials[owner[int(part)].typed_id]
        primitives.append(primitive)
    return document.append("meshes", {"name": mesh.name or node.name, "primitives": primitives})


def _primitive(
    document: Document, mesh: Any, corners: Any, weights: tuple[Any, Any] | None
) -> dict[str, Any]:
    """A primitive of some corners: one vertex for those that are alike in everything."""
    layers = {"POSITION": mesh.vertex_position, "NORMAL": mesh.vertex_normal,
              "TEXCOORD_0": mesh.vertex_uv, "COLOR_0": mesh.vertex_color}  # fmt: skip
    layers = {name: layer for name, layer in layers.items() if layer.exists}
    columns = [layer.indices.array().astype(np.int64)[corners] for layer in layers.values()]
    columns.append(mesh.vertex_indices.array().astype(np.int64)[corners])
    rows, indices = np.unique(np.stack(columns, -1), axis=0, return_inverse=True)
    primitive: dict[str, Any] = {"attributes": {}, "indices": document.add(indices.reshape(-1, 1), "u")}
    for column, (name, layer) in enumerate(layers.items()):
        values = layer.values.array()[rows[:, column]]
        if name == "TEXCOORD_0":
            values = np.stack([values[:, 0], 1.0 - values[:, 1]], -1)
        primitive["attributes"][name] = document.add(values)
    if weights is not None:
        joints, shares = (array[rows[:, -1]] for array in weights)
        for k in range(0, joints.shape[1], 4):
            primitive["attributes"][f"JOINTS_{k // 4}"] = document.add(joints[:, k : k + 4], "i")
            primitive["attributes"][f"WEIGHTS_{k // 4}"] = document.add(shares[:, k : k + 4])
    return primitive


def _weights(mesh: Any) -> tuple[Any, Any] | None:
    """Joints and weights `(vertices, 4 or 8)` of a skinned mesh, the strongest first."""
    if not len(mesh.skin_deformers):
        return None
    skin = mesh.skin_deformers[0]
    most = max((vertex.num_weights for vertex in skin.vertices), default=0)
    width = 4 if most <= 4 else INFLUENCES
    joints, shares = np.zeros((len(skin.vertices), width), np.int64), np.zeros((len(skin.vertices), width))
    for v, vertex in enumerate(skin.vertices):
        for k in range(min(vertex.num_weights, width)):
            weight = skin.weights[vertex.weight_begin + k]
            joints[v, k], shares[v, k] = weight.cluster_index, weight.weight
    total = shares.sum(1, keepdims=True)
    shares[total[:, 0] <= 0.0, 0] = 1.0
    return joints, shares / np.where(total > 0.0, total, 1.0)


def _skin(document: Document, mesh: Any, nodes: dict[int, int]) -> int | None:
    if not len(mesh.skin_deformers) or not len(mesh.skin_deformers[0].clusters):
        return None
    clusters = mesh.skin_deformers[0].clusters
    binds = np.tile(np.eye(4), (len(clusters), 1, 1))
    for k, cluster in enumerate(clusters):
        m = cluster.geometry_to_bone
        binds[k, :3] = np.array([[c.x, c.y, c.z] for c in (m.c0, m.c1, m.c2, m.c3)]).T
    joints = [nodes[cluster.bone_node.typed_id] for cluster in clusters]
    matrices = document.add(binds.transpose(0, 2, 1).reshape(-1, 16))
    return document.append("skins", {"joints": joints, "inverseBindMatrices": matrices})


def _material(document: Document, material: Any, source: Path) -> int:
    color = material.pbr.base_color
    value = color.value_vec4
    image = None if color.texture is None else _image(color.texture, source)
    surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.8}
    if image is not None:
        view = document.view(image)
        kind = "image/png" if image.startswith(b"\x89PNG") else "image/jpeg"
        number = document.append("images", {"bufferView": view, "mimeType": kind})
        surface["baseColorTexture"] = {"index": document.append("textures", {"source": number})}
    else:
        surface["baseColorFactor"] = [min(max(v, 0.0), 1.0) for v in (value.x, value.y, value.z)] + [1.0]
    return document.append(
        "materials", {"name": material.name or "material", "pbrMetallicRoughness": surface}
    )


def _image(texture: Any, source: Path) -> bytes | None:
    """A texture as PNG or JPEG: embedded, or next to the file under its own name; None where it is neither."""
    name = Path((texture.relative_filename or texture.filename or "").replace("\\", "/")).name
    data = bytes(texture.content or b"") or _file_beside(source, name)
    if data.startswith((b"\x89PNG", b"\xff\xd8\xff")) or not data:
        return data or None
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=("TGA", "TIFF", "BMP", "WEBP")) as image:
            out = io.BytesIO()
            image.convert("RGB").save(out, "PNG")
            return out.getvalue()
    except (OSError, ValueError, Image.DecompressionBombError):
        return None


def _file_beside(source: Path, name: str) -> bytes:
    """The bytes of a texture's file where exporters put it; none where it is in none of these folders."""
    folders = (source.parent, source.with_suffix(".fbm"), source.parent / "textures")
    return next((path.read_bytes() for folder in folders if name and (path := folder / name).is_file()), b"")
