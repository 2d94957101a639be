"""The materials of an FBX: the surfaces of a glTF as Phong, with their images inside the file."""

from __future__ import annotations

import re

import numpy as np

from runtime.arrays import Array
from runtime.character.read import Entry, GltfFile, buffer_view_bytes
from runtime.formats.fbx_nodes import Document, leaves, prop, properties

CLAMP = 33071  # of a sampler: an image is not repeated


class Materials:
    """Adds materials of a file to a document, each once."""

    def __init__(self, file: GltfFile, document: Document) -> None:
        self.file, self.document = file, document
        self._materials: dict[tuple[object, ...], np.int64] = {}
        self._textures: dict[int, np.int64] = {}
        self._videos: dict[int, tuple[np.int64, str, str]] = {}

    def add(self, index: int | None, color: Array | None = None) -> np.int64:
        """The id of a material (None: one that is white), in a colour of vertices where there is one."""
        key = (index, None if color is None else tuple(color.tolist()))
        if key not in self._materials:
            entry = Entry() if index is None else self.file.gltf.materials[index]
            name = entry.name or "material"
            name = name if color is None else f"{name} {len(self._materials) + 1}"
            self._materials[key] = self._material(entry, name, np.ones(3) if color is None else color)
        return self._materials[key]

    def _material(self, entry: Entry, name: str, color: Array) -> np.int64:
        surface = entry.pbrMetallicRoughness or Entry()
        factor = np.array(surface.baseColorFactor or (1.0, 1.0, 1.0, 1.0), np.float64)
        alpha = 1.0 if entry.alphaMode in (None, "OPAQUE") else float(factor[3])
        unlit = "KHR_materials_unlit" in (entry.extensions or {})
        textured = unlit or surface.metallicRoughnessTexture  # then the factor is none
        metal = 0.0 if textured else float(surface.get("metallicFactor", 1.0))
        shine = (10.0 * (1.0 - float(surface.get("roughnessFactor", 1.0)))) ** 2  # as Blender reads it
        colors = {"AmbientColor": np.zeros(3), "DiffuseColor": factor[:3] * color, "SpecularColor": np.ones(3),
                  "EmissiveColor": np.array(entry.emissiveFactor or (0.0, 0.0, 0.0)),
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
        """The id of a texture."""
        if info.index not in self._textures:
            texture = self.file.gltf.textures[info.index]
            video, name, path = self._video(texture.source)
            sampler = Entry() if texture.sampler is None else self.file.gltf.samplers[texture.sampler]
            facts = [prop("UVSet", "KString", f"UV{info.texCoord or 0}"), prop("UseMaterial", "bool", 1)]
            for ours, theirs in ("US", "VT"):
                facts.append(prop(f"WrapMode{ours}", "enum", int(sampler.get(f"wrap{theirs}") == CLAMP)))
            head = leaves(Type="TextureVideoClip", Version=202, TextureName=f"{name}\0\1Texture")
            files = leaves(Media=f"{name}\0\1Video", FileName=path, RelativeFilename=path)
            self._textures[info.index] = self.document.add(
                "Texture", name, "", [*head, properties(*facts), *files]
            )
            self.document.connect(video, self._textures[info.index])
        return self._textures[info.index]

    def _video(self, index: int) -> tuple[np.int64, str, str]:
        """The id of an image, its name, and that of its file."""
        if index not in self._videos:
            image = self.file.gltf.images[index]
            data = bytes(buffer_view_bytes(self.file, image.bufferView, "an image"))
            stem = re.sub(r"[^\w.-]+", "_", image.name or "texture").strip("._")
            name = f"{stem}_{index}"
            path = f"{name}.{'png' if image.mimeType == 'image/png' else 'jpg'}"
            content = leaves(UseMipMap=0, Filename=path, RelativeFilename=path, Content=data)
            parts = [*leaves(Type="Clip"), properties(prop("Path", "KString", path)), *content]
            self._videos[index] = self.document.add("Video", name, "Clip", parts), name, path
        return self._videos[index]
