"""The meshes of an FBX: triangles with layers, skin and morph targets, and materials with embedded images."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray, Array
from runtime.character.mesh import vertex_normals
from runtime.character.read import Entry, GltfFile
from runtime.character.textures import srgb
from runtime.formats.fbx_nodes import Document, Node, leaves, matrix, prop, properties

MAX_COLORS = 16  # as many vertex colours become materials, since most programs do not show vertex colours
SAME_COLOR_DISTANCE = 0.06  # in sRGB, within which colours are merged
MAX_SHADES = 256
EDGE_CLAMP = 33071  # of a sampler: clamp to edge


@dataclass(frozen=True)
class Skin:
    """An FBX skin: the transform of its mesh, and the bind transform, id and name of each joint."""

    place: Array  # (4, 4)
    links: Array  # (n, 4, 4)
    ids: list[np.int64]
    names: list[str]


class _Layer(NamedTuple):
    """One kind of values of a mesh's vertices, corners or faces: layer name, number, title and arrays."""

    kind: str
    number: int
    title: str
    arrays: dict[str, AnyArray]

    def node(self) -> Node:
        mapping = {"Material": "ByPolygon", "Normal": "ByVertice"}.get(self.kind, "ByPolygonVertex")
        reference = "Direct" if self.kind == "Normal" else "IndexToDirect"
        facts = leaves(Version=101, Name=self.title, MappingInformationType=mapping,
                       ReferenceInformationType=reference, **self.arrays)  # fmt: skip
        return Node(f"LayerElement{self.kind}", self.number, children=facts)


class Meshes:
    """Adds meshes of a file to an FBX document."""

    def __init__(self, file: GltfFile, document: Document, units: float) -> None:
        self.file, self.document, self.units = file, document, units
        self.materials = Materials(file, document)

    def add(self, index: int, model: np.int64, skin: Skin | None) -> None:
        """Add a mesh to a model; does nothing if it has no triangles."""
        entry = self.file.gltf.meshes[index]
        parts = _Parts(_Part(self.file, p) for p in entry.primitives if p.mode in (None, 4))
        if not parts:
            return
        place = np.diag([self.units] * 3 + [1.0]) if skin is None else skin.place
        slots, faces = self._slots(parts)
        content = _geometry(parts, place, faces)
        geometry = self.document.add("Geometry", entry.name or "mesh", "Mesh", content, model)
        for material in slots:
            self.document.connect(material, model)
        if skin is not None:
            self._add_skin(parts, skin, geometry)
        self._add_shapes(entry, parts, place, geometry)

    def _slots(self, parts: _Parts) -> tuple[list[np.int64], AnyArray]:
        """Return ids of the materials of a mesh, and for each face the index of its material."""
        slots: dict[np.int64, int] = {}
        faces = []
        for part in parts:
            colors: list[Array | None] = [*part.palette] or [None]
            ids = [self.materials.add(part.primitive.material, color) for color in colors]
            numbers = np.array([slots.setdefault(number, len(slots)) for number in ids], np.int32)
            faces.append(numbers[part.shades])
        return list(slots), np.concatenate(faces)

    def _add_skin(self, parts: _Parts, skin: Skin, geometry: np.int64) -> None:
        """Add the joint weights of vertices."""
        joints = parts.joined(_Part.influences, "JOINTS", len(skin.ids)).astype(np.int64)
        weights = parts.joined(_Part.influences, "WEIGHTS", len(skin.ids))
        count, used = len(joints), weights > 0.0
        keys = joints * count + np.arange(count)[:, None]
        held, slot = np.unique(keys[used], return_inverse=True)  # by joint, then by vertex
        amounts = np.bincount(slot, weights[used])
        ends = np.searchsorted(held, np.arange(len(skin.ids) + 1) * count)
        head = leaves(Version=101, Link_DeformAcuracy=50.0)
        deformer = self.document.add("Deformer", "Skin", "Skin", head, geometry)
        for k, (joint, link) in enumerate(zip(skin.ids, skin.links, strict=True)):
            span, facts = slice(ends[k], ends[k + 1]), [Node("Version", 100), Node("UserData", "", "")]
            if ends[k] < ends[k + 1]:
                facts += leaves(Indexes=(held[span] % count).astype(np.int32), Weights=amounts[span])
            facts += [matrix("Transform", np.linalg.inv(link)), matrix("TransformLink", link)]
            cluster = self.document.add("Deformer", skin.names[k], "Cluster", facts, deformer, "SubDeformer")
            self.document.connect(joint, cluster)

    def _add_shapes(self, entry: Entry, parts: _Parts, place: Array, geometry: np.int64) -> None:
        """Add the morph targets of a mesh, as vertex offsets."""
        count = max(len(part.targets) for part in parts)
        if not count:
            return
        head = leaves(Version=100)
        deformer = self.document.add("Deformer", "Shapes", "BlendShape", head, geometry)
        titles, weights = (entry.extras or {}).get("targetNames") or [], entry.weights or []
        for k in range(count):
            title = str(titles[k]) if k < len(titles) else f"shape_{k}"
            percent = 100.0 * float(weights[k]) if k < len(weights) else 0.0
            offsets = parts.joined(_Part.offsets, k) @ place[:3, :3].T
            rows = np.flatnonzero(offsets.any(axis=1)).astype(np.int32)
            facts = leaves(Version=100, DeformPercent=percent, FullWeights=np.array([100.0]))
            channel = self.document.add(
                "Deformer", title, "BlendShapeChannel", facts, deformer, "SubDeformer"
            )
            arrays = leaves(Indexes=rows, Vertices=offsets[rows].ravel(), Normals=np.zeros(3 * len(rows)))
            self.document.add("Geometry", title, "Shape", [*head, *arrays], channel)


class _Part:
    """A primitive: the rows it uses of its accessors, and its corners as indices into them.

    `palette` has its colours if they are few and there is no texture, `shades` the index of each face's colour.
    """

    def __init__(self, file: GltfFile, primitive: Entry) -> None:
        self.file, self.primitive, self.targets = file, primitive, primitive.targets or []
        if primitive.indices is None:
            every = np.arange(file.count(primitive.attributes.POSITION))
        else:
            every = file.values(primitive.indices, "indices").ravel().astype(np.int64)
        self.rows, corners = np.unique(every[: len(every) // 3 * 3], return_inverse=True)
        self.corners = corners.astype(np.int64)
        self.points = self.values("POSITION").astype(np.float64)
        self.palette: list[Array] = []
        self.shades = np.zeros(len(corners) // 3, int)
        material = Entry() if primitive.material is None else file.gltf.materials[primitive.material]
        textured = (material.pbrMetallicRoughness or Entry()).baseColorTexture is not None
        if "COLOR_0" in primitive.attributes and not textured:
            palette, shades = _palette(self.values("COLOR_0")[:, :3])
            if len(palette) <= MAX_COLORS:
                self.palette, self.shades = list(palette), shades[self.corners[::3]]

    def has(self, name: str) -> bool:
        """Return whether this primitive has the vertex attribute."""
        return name in self.primitive.attributes and not (name == "COLOR_0" and self.palette)

    def values(self, name: str) -> AnyArray:
        """Return the values `(rows, n)` of an existing attribute."""
        return self.file.values(self.primitive.attributes[name], name)[self.rows]

    def normals(self) -> AnyArray:
        """Return vertex normals `(rows, 3)`, computed if the primitive has none."""
        if self.has("NORMAL"):
            return self.values("NORMAL")
        return vertex_normals(self.points, self.corners.reshape(-1, 3))

    def uv(self, name: str) -> AnyArray:
        """Return texture coordinates `(rows, 2)` with the origin at the lower left."""
        values = self.values(name) if self.has(name) else np.zeros((len(self.rows), 2))
        return np.stack([values[:, 0], 1.0 - values[:, 1]], -1)

    def colors(self) -> AnyArray:
        """Return vertex colours `(rows, 4)` in sRGB, white if the primitive has none."""
        colors = np.ones((len(self.rows), 4))
        if self.has("COLOR_0"):
            values = self.values("COLOR_0")
            colors[:, : values.shape[1]] = values
        return np.concatenate([srgb(colors[:, :3]), colors[:, 3:]], axis=1)

    def influences(self, name: str, joints: int) -> AnyArray:
        """Return joint indices or weights `(rows, 8)`; influences of joints outside the skin are removed."""
        values = np.zeros((len(self.rows), 8))
        for k in (0, 1):
            if f"JOINTS_{k}" in self.primitive.attributes and f"WEIGHTS_{k}" in self.primitive.attributes:
                values[:, 4 * k : 4 * k + 4] = self.values(f"{name}_{k}")
        return np.minimum(values, joints - 1) if name == "JOINTS" else values

    def offsets(self, target: int) -> AnyArray:
        """Return vertex offsets `(rows, 3)` of a morph target."""
        index = self.targets[target].get("POSITION") if target < len(self.targets) else None
        if index is None:
            return np.zeros((len(self.rows), 3))
        return self.file.values(index, "a morph target")[self.rows].astype(float)


def _palette(colors: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Return the vertex colours `(n, 3)` with rare ones merged into similar frequent ones, and each vertex's index."""
    exact, which, counts = np.unique(colors.round(4), axis=0, return_inverse=True, return_counts=True)
    if len(exact) > MAX_SHADES:
        return exact, which.ravel()
    seen, kept = srgb(exact), list[int]()
    for one in np.argsort(-counts, kind="stable"):
        if not (np.abs(seen[kept] - seen[one]).max(axis=1, initial=0.0) < SAME_COLOR_DISTANCE).any():
            kept.append(int(one))
    nearest = np.abs(seen[:, None] - seen[kept]).max(axis=2).argmin(axis=1)
    return exact[kept], nearest[which.ravel()]


class _Parts(list[_Part]):
    """The primitives of a mesh, with consecutive vertices."""

    def joined(self, values: Callable[..., AnyArray], *given: Any) -> AnyArray:
        """Return the results of a `_Part` method for all parts, concatenated."""
        return np.concatenate([values(part, *given) for part in self])

    def corners(self) -> AnyArray:
        """Return the vertex index `(3 F,)` of each triangle corner, int32."""
        starts = np.cumsum([0] + [len(part.rows) for part in self[:-1]])
        found = [part.corners + start for part, start in zip(self, starts, strict=True)]
        return np.concatenate(found).astype(np.int32)


def _geometry(parts: _Parts, place: Array, faces: AnyArray) -> list[Node]:
    """Return vertices, polygons and layers of a mesh; `faces` have the material indices."""
    points = np.concatenate([part.points for part in parts]) @ place[:3, :3].T + place[:3, 3]
    corners = parts.corners()
    polygons = corners.reshape(-1, 3) ^ np.array([0, 0, -1], np.int32)  # the last index of a face is inverted
    layers = [*_layers(parts, corners, place), _Layer("Material", 0, "", {"Materials": faces})]
    content = leaves(GeometryVersion=124, Vertices=points.ravel(), PolygonVertexIndex=polygons.ravel())
    content += [layer.node() for layer in layers]
    for number in range(max(layer.number for layer in layers) + 1):  # first all first layers, and so on
        kinds = [f"LayerElement{layer.kind}" for layer in layers if layer.number == number]
        named = [Node("LayerElement", children=leaves(Type=kind, TypedIndex=number)) for kind in kinds]
        content.append(Node("Layer", number, children=[*leaves(Version=100), *named]))
    return content


def _layers(parts: _Parts, corners: AnyArray, place: Array) -> list[_Layer]:
    """Return normals, colours and texture coordinates of the corners of a mesh."""
    normals = rotations.normalize(parts.joined(_Part.normals) @ np.linalg.inv(place[:3, :3]))
    layers = [_Layer("Normal", 0, "", {"Normals": normals.ravel()})]
    if any(part.has("COLOR_0") for part in parts):
        colors = parts.joined(_Part.colors).ravel()
        layers.append(_Layer("Color", 0, "Col", {"Colors": colors, "ColorIndex": corners}))
    names = sorted({n for part in parts for n in part.primitive.attributes if n.startswith("TEXCOORD_")})
    for number, name in enumerate(names):
        uv = parts.joined(_Part.uv, name).astype(float)
        layers.append(_Layer("UV", number, f"UV{number}", {"UV": uv.ravel(), "UVIndex": corners}))
    return layers


class Materials:
    """Adds materials of a file to an FBX document, each once."""

    def __init__(self, file: GltfFile, document: Document) -> None:
        self.file, self.document = file, document
        self._materials: dict[tuple[object, ...], np.int64] = {}
        self._textures: dict[int, np.int64] = {}
        self._videos: dict[int, tuple[np.int64, str, str]] = {}

    def add(self, index: int | None, color: Array | None = None) -> np.int64:
        """Return the id of a material (None: white), tinted by a vertex colour if given."""
        key = (index, None if color is None else tuple(color.tolist()))
        if key not in self._materials:
            entry = Entry() if index is None else self.file.gltf.materials[index]
            name = entry.name or "material"
            name = name if color is None else f"{name} {len(self._materials) + 1}"
            self._materials[key] = self._material(entry, name, np.ones(3) if color is None else color)
        return self._materials[key]

    def _material(self, entry: Entry, name: str, color: Array) -> np.int64:
        surface = entry.pbrMetallicRoughness or Entry()
        factor = np.array(surface.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)), np.float64)
        alpha = 1.0 if entry.alphaMode in (None, "OPAQUE") else float(factor[3])
        unlit = "KHR_materials_unlit" in (entry.extensions or {})
        textured = unlit or surface.metallicRoughnessTexture  # then the factor is unused
        metal = 0.0 if textured else float(surface.get("metallicFactor", 1.0))
        shine = (10.0 * (1.0 - float(surface.get("roughnessFactor", 1.0)))) ** 2  # as Blender reads it
        colors = {"AmbientColor": np.zeros(3), "DiffuseColor": factor[:3] * color, "SpecularColor": np.ones(3),
                  "EmissiveColor": np.array(entry.get("emissiveFactor", (0.0, 0.0, 0.0))),
                  "TransparentColor": np.full(3, 1.0 - alpha)}  # fmt: skip
        numbers = {"DiffuseFactor": 1.0, "SpecularFactor": 0.25, "EmissiveFactor": 1.0, "Shininess": shine,
                   "ShininessExponent": shine, "ReflectionFactor": metal,
                   "TransparencyFactor": 1.0 - alpha, "Opacity": alpha}  # fmt: skip
        facts = [prop(n, "Color", *value.tolist(), flags="A") for n, value in colors.items()]
        facts += [prop(n, "Number", value, flags="A") for n, value in numbers.items()]
        head = leaves(Version=102, ShadingModel="phong", MultiLayer=0)
        material = self.document.add("Material", name, "", [*head, properties(*facts)])
        textures = {"DiffuseColor": surface.baseColorTexture, "NormalMap": entry.normalTexture,
                    "EmissiveColor": entry.emissiveTexture}  # fmt: skip
        for what, info in textures.items():
            if info is not None:
                self.document.connect(self._texture(info), material, what)
        return material

    def _texture(self, info: Entry) -> np.int64:
        """Return the id of a texture, adding it if needed."""
        if info.index not in self._textures:
            texture = self.file.gltf.textures[info.index]
            video, name, path = self._video(texture.source)
            sampler = Entry() if texture.sampler is None else self.file.gltf.samplers[texture.sampler]
            facts = [prop("UVSet", "KString", f"UV{info.texCoord or 0}"), prop("UseMaterial", "bool", 1)]
            for ours, theirs in ("US", "VT"):
                facts.append(prop(f"WrapMode{ours}", "enum", int(sampler.get(f"wrap{theirs}") == EDGE_CLAMP)))
            head = leaves(Type="TextureVideoClip", Version=202, TextureName=f"{name}\0\1Texture")
            files = leaves(Media=f"{name}\0\1Video", FileName=path, RelativeFilename=path)
            self._textures[info.index] = self.document.add(
                "Texture", name, "", [*head, properties(*facts), *files]
            )
            self.document.connect(video, self._textures[info.index])
        return self._textures[info.index]

    def _video(self, index: int) -> tuple[np.int64, str, str]:
        """Return the id of an image, its name, and its file name."""
        if index not in self._videos:
            image = self.file.gltf.images[index]
            data = bytes(self.file.view_bytes(image.bufferView, "an image"))
            stem = re.sub(r"[^\w.-]+", "_", image.name or "texture").strip("._")
            name = f"{stem}_{index}"
            path = f"{name}.{'png' if image.mimeType == 'image/png' else 'jpg'}"
            content = leaves(UseMipMap=0, Filename=path, RelativeFilename=path, Content=data)
            parts = [*leaves(Type="Clip"), properties(prop("Path", "KString", path)), *content]
            self._videos[index] = self.document.add("Video", name, "Clip", parts), name, path
        return self._videos[index]
