"""Converts an FBX character to GLB with the library ufbx, in a separate process (`native_worker`).

Meshes, skins, nodes, base colours and textures are kept; animations if motion is requested.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime import rotations
from runtime.character.glb_buffer import ARRAY_BUFFER, ELEMENT_BUFFER, GlbBuffer
from runtime.character.textures import linear

if TYPE_CHECKING:
    import pygltflib as g

MAX_NODES, MAX_VERTICES = 20_000, 6_000_000  # of a file; vertices are face corners
MAX_SAMPLES = 3_000_000  # of the animated nodes
STILL_TOLERANCE = 1e-7  # metres or quaternion components: smaller deviations from rest count as still
INFLUENCES = 8  # per vertex, the strongest
_KEPT: list[Any] = []


class Kept:
    """Keeps an object of ufbx 0.0.5 alive until the process ends, with everything read through it.

    The library frees elements that Python has released while the scene still refers to them.
    """

    __slots__ = ("value",)  # one exists for each vertex and weight

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
        """Return the kept list of numbers or vectors as an array."""
        return np.array(self.value)


def _kept(value: Any) -> Any:
    return value if value is None or isinstance(value, bool | int | float | str | bytes) else Kept(value)


def convert(source: Path, motion: bool) -> bytes:
    """Convert an FBX to GLB, in metres, Y up; `motion` includes its animations."""
    import pygltflib as g
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
    document = GlbBuffer(g.GLTF2(asset=g.Asset(version="2.0", generator="ufbx"), scene=0))
    nodes = {node.typed_id: k for k, node in enumerate(scene.nodes)}
    materials = {m.typed_id: _material(document, m, source) for m in scene.materials}
    for node in scene.nodes:
        document.append("nodes", _node(document, node, nodes, materials))
    if motion:
        _animate(document, ufbx.evaluate_transform, scene, nodes)
    document.append("scenes", g.Scene(nodes=[nodes[scene.root_node.typed_id]], extras=_note(*scene.nodes)))
    return document.to_bytes()


def _note(*elements: Any) -> dict[str, str]:
    """Return the metadata of our exports from the first node or take that has them."""
    told = [prop.value_str for each in elements if (prop := each.props.value.find_prop("sport"))]
    return {"sport": told[0]} if told else {}


def _node(document: GlbBuffer, node: Any, nodes: dict[int, int], materials: dict[int, int]) -> g.Node:
    import pygltflib as g

    t = node.local_transform
    turn = np.array([[t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w]])
    made = g.Node(
        name=node.name or "root",
        translation=[t.translation.x, t.translation.y, t.translation.z],
        rotation=_active(node, turn)[0].tolist(),
        scale=[t.scale.x, t.scale.y, t.scale.z],
        children=[nodes[child.typed_id] for child in node.children],
    )
    if node.mesh is not None and node.mesh.num_triangles > 0:
        made.mesh = _mesh(document, node, materials)
        made.skin = _skin(document, node.mesh, nodes)
    return made


def _animate(document: GlbBuffer, evaluate: Any, scene: Any, nodes: dict[int, int]) -> None:
    """Add the animations up to MAX_SAMPLES, sampled for the nodes they move at the file's rate; others by name only."""
    import pygltflib as g

    fps, left = min(max(float(scene.settings.frames_per_second), 1.0), 240.0), MAX_SAMPLES
    for number, stack in enumerate(scene.anim_stacks):
        made = g.Animation(name=stack.name, extras=_note(stack))
        document.append("animations", made)
        begin, end = _span(stack)
        count = int((end - begin) * fps + 1e-3) + 1
        left -= count * len(nodes)
        if left < 0 and number == 0:
            raise ValueError(f"an animation of {count} frames and {len(nodes)} nodes")
        if left < 0:
            continue
        times = begin + np.arange(count) / fps
        keys = document.add((times - begin)[:, None])
        for node in scene.nodes:
            moved = [evaluate(stack.anim.value, node.value, t) for t in times.tolist()]
            for path, values in _moved(node, moved):
                sampler = g.AnimationSampler(input=keys, output=document.add(values))
                made.samplers.append(sampler)
                target = g.AnimationChannelTarget(node=nodes[node.typed_id], path=path)
                made.channels.append(g.AnimationChannel(sampler=len(made.samplers) - 1, target=target))


def _moved(node: Any, transforms: list[Any]) -> Iterator[tuple[str, Any]]:
    """Yield the animated properties of a node that leave their rest value, with values `(T, 3 or 4)`."""
    for path, axes in (("translation", "xyz"), ("rotation", "xyzw"), ("scale", "xyz")):
        rows = [getattr(t, path) for t in (node.local_transform, *transforms)]
        values = np.array([[getattr(row, axis) for axis in axes] for row in rows])
        values = _active(node, values) if path == "rotation" else values
        if np.abs(values[1:] - values[0]).max() > STILL_TOLERANCE:
            yield path, values[1:]


def _span(stack: Any) -> tuple[float, float]:
    """Return the time range of an animation, as stated or else from its keys."""
    if stack.time_end > stack.time_begin:
        return float(stack.time_begin), float(stack.time_end)
    values = [value for layer in stack.layers for value in layer.anim_values]
    curves = [c for value in values for c in value.curves if c is not None and len(c.keyframes)]
    begin = min((float(curve.min_time) for curve in curves), default=0.0)
    return begin, max((float(curve.max_time) for curve in curves), default=begin)


def _active(node: Any, turns: Any) -> Any:
    """Return quaternions `(T, 4)`, x first, without the pre- and post-rotations that FBX ignores where RotationActive is 0."""
    turns = turns / np.maximum(np.linalg.norm(turns, axis=-1, keepdims=True), 1e-12)
    active = node.props.value.find_prop("RotationActive")
    if active is not None and active.value_int:
        return turns
    before, after = (_euler(node, name) for name in ("PreRotation", "PostRotation"))
    if not np.any(before) and not np.any(after):
        return turns
    first, last = (
        np.array([q.w, q.x, q.y, q.z]) for q in (node.adjust_pre_rotation, node.adjust_post_rotation)
    )
    pre, post = (rotations.from_euler(np.radians(degrees[::-1]), "ZYX") for degrees in (before, after))
    inverse, multiply = rotations.inverse, rotations.multiply
    left = multiply(multiply(first, inverse(pre)), inverse(first))
    right = multiply(multiply(inverse(last), post), last)
    made = multiply(multiply(left, np.roll(turns, 1, axis=-1)), right)
    return np.roll(made, -1, axis=-1)


def _euler(node: Any, name: str) -> list[float]:
    """Return three angles of a property in degrees, zeros if it is missing."""
    found = node.props.value.find_prop(name)
    value = None if found is None else Kept(found).value_vec4
    return [0.0, 0.0, 0.0] if value is None else [value.x, value.y, value.z]


def _triangles(mesh: Any) -> tuple[Any, Any]:
    """Return the corners `(n, 3)` of all triangles (faces as fans), and the material of each."""
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


def _mesh(document: GlbBuffer, node: Any, materials: dict[int, int]) -> int:
    import pygltflib as g

    mesh = node.mesh
    corners, parts = _triangles(mesh)
    weights = _weights(mesh)
    owner = node.materials if len(node.materials) else mesh.materials
    primitives = []
    for part in np.unique(parts):
        primitive = _primitive(document, mesh, corners[parts == part].ravel(), weights)
        if part < len(owner) and owner[int(part)] is not None:
            primitive.material = materials[owner[int(part)].typed_id]
        primitives.append(primitive)
    return document.append("meshes", g.Mesh(name=mesh.name or node.name, primitives=primitives))


def _primitive(document: GlbBuffer, mesh: Any, corners: Any, weights: tuple[Any, Any] | None) -> g.Primitive:
    """Return a primitive of some corners, with identical corners merged into one vertex."""
    import pygltflib as g

    layers = {"POSITION": mesh.vertex_position, "NORMAL": mesh.vertex_normal,
              "TEXCOORD_0": mesh.vertex_uv, "COLOR_0": mesh.vertex_color}  # fmt: skip
    layers = {name: layer for name, layer in layers.items() if layer.exists}
    columns = [layer.indices.array().astype(np.int64)[corners] for layer in layers.values()]
    columns.append(mesh.vertex_indices.array().astype(np.int64)[corners])
    rows, indices = np.unique(np.stack(columns, -1), axis=0, return_inverse=True)
    attributes = {}
    for column, (name, layer) in enumerate(layers.items()):
        values = layer.values.array()[rows[:, column]]
        if name == "TEXCOORD_0":
            values = np.stack([values[:, 0], 1.0 - values[:, 1]], -1)
        elif name == "COLOR_0":  # as programs write and show them
            values = np.concatenate([linear(values[:, :3]), values[:, 3:]], axis=1)
        attributes[name] = document.add(values, ARRAY_BUFFER, bounds=name == "POSITION")
    if weights is not None:
        joints, shares = (array[rows[:, -1]] for array in weights)
        for k in range(0, joints.shape[1], 4):
            attributes[f"JOINTS_{k // 4}"] = document.add(joints[:, k : k + 4], ARRAY_BUFFER)
            attributes[f"WEIGHTS_{k // 4}"] = document.add(shares[:, k : k + 4], ARRAY_BUFFER)
    faces = document.add(indices.reshape(-1, 1).astype(np.uint32), ELEMENT_BUFFER)
    return g.Primitive(attributes=g.Attributes(**attributes), indices=faces)


def _weights(mesh: Any) -> tuple[Any, Any] | None:
    """Joints and weights `(vertices, 4 or 8)` of a skinned mesh, the strongest first."""
    if not len(mesh.skin_deformers):
        return None
    skin = mesh.skin_deformers[0]
    most = max((vertex.num_weights for vertex in skin.vertices), default=0)
    width = 4 if most <= 4 else INFLUENCES
    joints, shares = np.zeros((len(skin.vertices), width), np.uint16), np.zeros((len(skin.vertices), width))
    for v, vertex in enumerate(skin.vertices):
        for k in range(min(vertex.num_weights, width)):
            weight = skin.weights[vertex.weight_begin + k]
            joints[v, k], shares[v, k] = weight.cluster_index, weight.weight
    total = shares.sum(1, keepdims=True)
    shares[total[:, 0] <= 0.0, 0] = 1.0
    return joints, shares / np.where(total > 0.0, total, 1.0)


def _skin(document: GlbBuffer, mesh: Any, nodes: dict[int, int]) -> int | None:
    import pygltflib as g

    if not len(mesh.skin_deformers) or not len(mesh.skin_deformers[0].clusters):
        return None
    clusters = mesh.skin_deformers[0].clusters
    binds = np.tile(np.eye(4), (len(clusters), 1, 1))
    for k, cluster in enumerate(clusters):
        m = cluster.geometry_to_bone
        binds[k, :3] = np.array([[c.x, c.y, c.z] for c in (m.c0, m.c1, m.c2, m.c3)]).T
    joints = [nodes[cluster.bone_node.typed_id] for cluster in clusters]
    matrices = document.add(binds.transpose(0, 2, 1).reshape(-1, 16))
    return document.append("skins", g.Skin(joints=joints, inverseBindMatrices=matrices))


def _material(document: GlbBuffer, material: Any, source: Path) -> int:
    import pygltflib as g

    color = material.pbr.base_color
    value = color.value_vec4
    image = None if color.texture is None else _image(color.texture, source)
    surface = g.PbrMetallicRoughness(metallicFactor=0.0, roughnessFactor=0.8)
    if image is not None:
        kind = "image/png" if image.startswith(b"\x89PNG") else "image/jpeg"
        number = document.append("images", g.Image(bufferView=document.add_view(image), mimeType=kind))
        texture = document.append("textures", g.Texture(source=number))
        surface.baseColorTexture = g.TextureInfo(index=texture)
    else:
        surface.baseColorFactor = [*np.clip([value.x, value.y, value.z], 0.0, 1.0).tolist(), 1.0]
    return document.append(
        "materials", g.Material(name=material.name or "material", pbrMetallicRoughness=surface)
    )


def _image(texture: Any, source: Path) -> bytes | None:
    """Return a texture as PNG or JPEG, embedded or next to the file; None if it is neither."""
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
    """Return a texture's file from the folders that exporters use; empty if there is none."""
    folders = (source.parent, source.with_suffix(".fbm"), source.parent / "textures")
    return next(
        (path.read_bytes() for folder in folders if name and os.path.isfile(path := folder / name)), b""
    )
