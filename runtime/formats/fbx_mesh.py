"""The meshes of an FBX: triangles with their layers, the skin that carries them, and their shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray, Array
from runtime.character.mesh import vertex_normals
from runtime.character.read import Entry, GltfFile, accessor_count, read_accessor
from runtime.character.textures import srgb
from runtime.formats.fbx_materials import Materials
from runtime.formats.fbx_nodes import Document, Node, matrix, properties

MAX_COLORS = 16  # of vertices: so few are materials of their own, since most programs do not show them


@dataclass(frozen=True)
class Skin:
    """A skin: what puts its mesh into the scene, and of each joint where it is bound, its id and its name."""

    place: Array  # (4, 4)
    links: Array  # (n, 4, 4)
    ids: list[np.int64]
    names: list[str]


class _Layer(NamedTuple):
    """Values of the vertices, corners or faces of a mesh: the name of a kind of layer, its number, title and arrays."""

    kind: str
    number: int
    title: str
    arrays: dict[str, AnyArray]

    def node(self) -> Node:
        mapping = {"Material": "ByPolygon", "Normal": "ByVertice"}.get(self.kind, "ByPolygonVertex")
        reference = "Direct" if self.kind == "Normal" else "IndexToDirect"
        return Node(f"LayerElement{self.kind}", self.number, children=[
            Node("Version", 101), Node("Name", self.title), Node("MappingInformationType", mapping),
            Node("ReferenceInformationType", reference), *(Node(n, a) for n, a in self.arrays.items()),
        ])  # fmt: skip


class Meshes:
    """Adds the meshes of a file to a document with so many units in a metre."""

    def __init__(self, file: GltfFile, document: Document, units: float) -> None:
        self.file, self.document, self.units = file, document, units
        self.materials = Materials(file, document)

    def add(self, index: int, model: np.int64, skin: Skin | None) -> None:
        """Add a mesh below a model; one without triangles adds nothing."""
        entry = self.file.gltf.meshes[index]
        parts = [_Part(self.file, p) for p in entry.primitives if p.mode in (None, 4)]
        if not parts:
            return
        place = np.diag([self.units] * 3 + [1.0]) if skin is None else skin.place
        points = np.concatenate([part.points for part in parts]) @ place[:3, :3].T + place[:3, 3]
        starts = np.cumsum([0] + [len(part.rows) for part in parts[:-1]])
        corners = np.concatenate([p.corners + start for p, start in zip(parts, starts, strict=True)])
        polygons = corners.reshape(-1, 3).copy()
        polygons[:, 2] = ~polygons[:, 2]  # the last corner of a face
        slots, faces = self._slots(parts)
        layers = [*_layers(parts, corners, place), _Layer("Material", 0, "", {"Materials": faces})]
        geometry = self.document.add("Geometry", entry.name or "mesh", "Mesh", [
            properties(), Node("GeometryVersion", 124), Node("Vertices", points.ravel()),
            Node("PolygonVertexIndex", polygons.ravel().astype(np.int32)),
            *(layer.node() for layer in layers), *_layer_lists(layers),
        ])  # fmt: skip
        self.document.connect(geometry, model)
        for material in slots:
            self.document.connect(material, model)
        if skin is not None:
            self._skin(parts, skin, geometry)
        self._shapes(entry, parts, place, geometry)

    def _slots(self, parts: list[_Part]) -> tuple[list[np.int64], AnyArray]:
        """Ids of the materials of a mesh, and for each face the place of its material among them."""
        slots: dict[np.int64, int] = {}
        faces = []
        for part in parts:
            colors: list[Array | None] = [*part.palette] or [None]
            ids = [self.materials.add(part.primitive.material, color) for color in colors]
            numbers = np.array([slots.setdefault(number, len(slots)) for number in ids], np.int32)
            faces.append(numbers[part.shades])
        return list(slots), np.concatenate(faces)

    def _skin(self, parts: list[_Part], skin: Skin, geometry: np.int64) -> None:
        """Which joint carries which vertices, and how much."""
        count = sum(len(part.rows) for part in parts)
        joints = np.concatenate([part.influences("JOINTS", len(skin.ids)) for part in parts]).astype(np.int64)
        weights = np.concatenate([part.influences("WEIGHTS", len(skin.ids)) for part in parts]).astype(float)
        keys = joints * count + np.arange(count)[:, None]
        held, slot = np.unique(keys[weights > 0.0], return_inverse=True)  # by joint, then by vertex
        amounts = np.bincount(slot, weights[weights > 0.0])
        ends = np.searchsorted(held, np.arange(len(skin.ids) + 1) * count)
        head = [Node("Version", 101), Node("Link_DeformAcuracy", 50.0)]
        deformer = self.document.add("Deformer", "Skin", "Skin", head)
        self.document.connect(deformer, geometry)
        for k, (joint, link) in enumerate(zip(skin.ids, skin.links, strict=True)):
            span, facts = slice(ends[k], ends[k + 1]), [Node("Version", 100), Node("UserData", "", "")]
            if ends[k] < ends[k + 1]:
                facts += [
                    Node("Indexes", (held[span] % count).astype(np.int32)),
                    Node("Weights", amounts[span]),
                ]
            facts += [matrix("Transform", np.linalg.inv(link)), matrix("TransformLink", link)]
            cluster = self.document.add("Deformer", skin.names[k], "Cluster", facts, "SubDeformer")
            self.document.connect(cluster, deformer)
            self.document.connect(joint, cluster)

    def _shapes(self, entry: Entry, parts: list[_Part], place: Array, geometry: np.int64) -> None:
        """The morph targets of a mesh, as offsets of vertices."""
        most = max(len(part.primitive.targets or []) for part in parts)
        if not most:
            return
        titles, weights = (entry.extras or {}).get("targetNames") or [], entry.weights or []
        deformer = self.document.add("Deformer", "Shapes", "BlendShape", [Node("Version", 100)])
        self.document.connect(deformer, geometry)
        for k in range(most):
            title = str(titles[k]) if k < len(titles) else f"shape_{k}"
            offsets = np.concatenate([part.offsets(k) for part in parts]) @ place[:3, :3].T
            rows = np.flatnonzero(np.abs(offsets).max(axis=1) > 0.0).astype(np.int32)
            amount = 100.0 * float(weights[k]) if k < len(weights) else 0.0
            facts = [
                Node("Version", 100),
                Node("DeformPercent", amount),
                Node("FullWeights", np.array([100.0])),
            ]
            channel = self.document.add("Deformer", title, "BlendShapeChannel", facts, "SubDeformer")
            shape = self.document.add("Geometry", title, "Shape", [
                Node("Version", 100), Node("Indexes", rows), Node("Vertices", offsets[rows].ravel()),
                Node("Normals", np.zeros(3 * len(rows))),
            ])  # fmt: skip
            self.document.connect(channel, deformer)
            self.document.connect(shape, channel)


class _Part:
    """A primitive: the rows of its accessors that it uses, and its corners among them.

    `palette` has its colours where they are few and no texture gives others, and `shades` which of them a face has.
    """

    def __init__(self, file: GltfFile, primitive: Entry) -> None:
        self.file, self.primitive = file, primitive
        if primitive.indices is None:
            every = np.arange(accessor_count(file, primitive.attributes.POSITION))
        else:
            every = read_accessor(file, primitive.indices, "indices").ravel().astype(np.int64)
        self.rows, corners = np.unique(every[: len(every) // 3 * 3], return_inverse=True)
        self.corners = corners.astype(np.int64)
        self.points = self.values("POSITION").astype(np.float64)
        self.palette: list[Array] = []
        self.shades = np.zeros(len(corners) // 3, int)
        if "COLOR_0" in primitive.attributes and not self._textured():
            palette, shades = np.unique(self.values("COLOR_0")[:, :3].round(4), axis=0, return_inverse=True)
            if len(palette) <= MAX_COLORS:
                self.palette, self.shades = list(palette), shades.ravel()[self.corners[::3]]

    def _textured(self) -> bool:
        index = self.primitive.material
        surface = None if index is None else self.file.gltf.materials[index].pbrMetallicRoughness
        return surface is not None and surface.baseColorTexture is not None

    def has(self, name: str) -> bool:
        """Whether a layer comes of this primitive."""
        return name in self.primitive.attributes and not (name == "COLOR_0" and self.palette)

    def values(self, name: str) -> AnyArray:
        """Values `(rows, n)` of an attribute that is there."""
        return read_accessor(self.file, self.primitive.attributes[name], name)[self.rows]

    def normals(self) -> AnyArray:
        """Normals `(rows, 3)`."""
        if self.has("NORMAL"):
            return self.values("NORMAL")
        return vertex_normals(self.points, self.corners.reshape(-1, 3))

    def uv(self, name: str) -> AnyArray:
        """Texture coordinates `(rows, 2)` from the lower left."""
        values = self.values(name) if self.has(name) else np.zeros((len(self.rows), 2))
        return np.stack([values[:, 0], 1.0 - values[:, 1]], -1)

    def colors(self) -> AnyArray:
        """Colours `(rows, 4)` in sRGB."""
        colors = np.ones((len(self.rows), 4))
        if self.has("COLOR_0"):
            values = self.values("COLOR_0")
            colors[:, : values.shape[1]] = values
        return np.concatenate([srgb(colors[:, :3]), colors[:, 3:]], axis=1)

    def influences(self, name: str, joints: int) -> AnyArray:
        """Joints or weights `(rows, 8)`; those of joints that the skin has not are none."""
        values = np.zeros((len(self.rows), 8))
        for k in (0, 1):
            if f"JOINTS_{k}" in self.primitive.attributes and f"WEIGHTS_{k}" in self.primitive.attributes:
                values[:, 4 * k : 4 * k + 4] = self.values(f"{name}_{k}")
        return np.minimum(values, joints - 1) if name == "JOINTS" else values

    def offsets(self, target: int) -> AnyArray:
        """Offsets `(rows, 3)` of a morph target."""
        targets = self.primitive.targets or []
        index = targets[target].get("POSITION") if target < len(targets) else None
        if index is None:
            return np.zeros((len(self.rows), 3))
        return read_accessor(self.file, index, "a morph target")[self.rows].astype(float)


def _layers(parts: list[_Part], corners: AnyArray, place: Array) -> list[_Layer]:
    """Normals, colours and texture coordinates of the corners of a mesh."""
    normals = np.concatenate([part.normals() for part in parts]) @ np.linalg.inv(place[:3, :3])
    layers = [_Layer("Normal", 0, "", {"Normals": rotations.normalize(normals).ravel()})]
    index = corners.astype(np.int32)
    if any(part.has("COLOR_0") for part in parts):
        colors = np.concatenate([part.colors() for part in parts])
        layers.append(_Layer("Color", 0, "Col", {"Colors": colors.ravel(), "ColorIndex": index}))
    names = sorted({n for part in parts for n in part.primitive.attributes if n.startswith("TEXCOORD_")})
    for number, name in enumerate(names):
        uv = np.concatenate([part.uv(name) for part in parts]).astype(float)
        layers.append(_Layer("UV", number, f"UV{number}", {"UV": uv.ravel(), "UVIndex": index}))
    return layers


def _layer_lists(layers: list[_Layer]) -> list[Node]:
    """Which layers go together: all first ones, all second ones, and so on."""
    lists = []
    for number in range(max(layer.number for layer in layers) + 1):
        entries = [
            Node("LayerElement", children=[
                Node("Type", f"LayerElement{layer.kind}"), Node("TypedIndex", number)
            ])
            for layer in layers if layer.number == number
        ]  # fmt: skip
        lists.append(Node("Layer", number, children=[Node("Version", 100), *entries]))
    return lists
