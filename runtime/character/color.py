"""Vertex colours of a glTF primitive: COLOR_0, base colour factor and base colour texture, as linear RGB."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import AnyArray
from runtime.character.images import open_image, texture_source
from runtime.character.read import (
    REMEDY,
    STRUCTURE_ERRORS,
    Entry,
    GltfFile,
    buffer_view_bytes,
    read_accessor,
    read_uri,
)
from runtime.errors import FileError
from runtime.safe_read import reason

MAX_TEXTURE_PIXELS = 8192 * 8192  # of all images of a file, and
MAX_TEXTURE_SIDE = 8192
PIXELS_PER_BYTE = 16  # more for each of their bytes: images of something are hardly ever packed closer
_EXPORT = "Export textures as PNG or JPEG."
SAMPLED_PIXELS = 512  # textures are averaged down to this, since only one colour per vertex is taken


def primitive_colors(file: GltfFile, textures: Textures, primitive: Entry, what: str, count: int) -> AnyArray:
    """Linear RGB `(count, 3)` of a primitive's vertices."""
    materials = file.gltf.materials or []
    color = np.ones((count, 3), np.float32)
    if primitive.material is not None:
        if not 0 <= primitive.material < len(materials):
            raise FileError(f"{file.name}: the material of {what} is missing.", REMEDY)
        surface = materials[primitive.material].pbrMetallicRoughness
        if surface is not None and surface.baseColorFactor is not None:
            color *= np.array(surface.baseColorFactor, np.float32)[:3]
        if surface is not None and surface.baseColorTexture is not None:
            color *= _texture_colors(file, textures, primitive, surface.baseColorTexture, what, count)
    if primitive.attributes.COLOR_0 is not None:
        values = read_accessor(file, primitive.attributes.COLOR_0, f"COLOR_0 of {what}")
        if len(values) != count or values.shape[1] not in (3, 4):
            raise FileError(f"{file.name}: COLOR_0 of {what} does not fit its {count} vertices.", REMEDY)
        color *= values[:, :3]
    if not np.all(np.isfinite(color)):
        raise FileError(f"{file.name}: the colours of {what} are not finite.", REMEDY)
    return np.clip(color, 0.0, 1.0).astype(np.float32)


def _texture_colors(
    file: GltfFile, textures: Textures, primitive: Entry, info: Entry, what: str, count: int
) -> AnyArray:
    channel = getattr(primitive.attributes, f"TEXCOORD_{info.texCoord or 0}", None)
    if channel is None:
        return np.ones((count, 3), np.float32)
    uv = read_accessor(file, channel, f"texture coordinates of {what}").astype(np.float64)
    if uv.shape != (count, 2):
        raise FileError(
            f"{file.name}: the texture coordinates of {what} do not fit its {count} vertices.", REMEDY
        )
    pixels = textures.pixels(info.index)
    height, width = pixels.shape[:2]
    at = np.floor((uv % 1.0) * (width, height)).astype(np.int64)
    srgb = pixels[np.minimum(at[:, 1], height - 1), np.minimum(at[:, 0], width - 1)] / 255.0
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).astype(np.float32)


class Textures:
    """The images of a file, each decoded once, and no more pixels than images of their bytes have."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._pixels: dict[int, NDArray[np.uint8]] = {}
        self._left = MAX_TEXTURE_PIXELS

    def pixels(self, texture: Any) -> NDArray[np.uint8]:
        """sRGB pixels `(H, W, 3)` of a texture's image."""
        name = self._file.name
        textures, images = self._file.gltf.textures or [], self._file.gltf.images or []
        if not isinstance(texture, int) or not 0 <= texture < len(textures):
            raise FileError(f"{name}: texture {str(texture)[:40]} is missing.", REMEDY)
        source = texture_source(textures[texture])
        if not isinstance(source, int) or not 0 <= source < len(images):
            raise FileError(f"{name}: the image of texture {texture} is missing.", _EXPORT)
        if source not in self._pixels:
            self._pixels[source] = self._decode(self._bytes(images[source], source), f"image {source}")
        return self._pixels[source]

    def _bytes(self, image: Entry, source: int) -> bytes:
        if image.bufferView is not None:
            return bytes(buffer_view_bytes(self._file, image.bufferView, f"image {source}"))
        return read_uri(self._file.path, image.uri, "image")

    def _decode(self, data: bytes, what: str) -> NDArray[np.uint8]:
        from PIL import Image

        try:
            with open_image(data, self._file.path, what) as image:
                # each scan of a JPEG is another pass over the whole image
                passes = 1 + data.count(b"\xff\xda") // 16 if image.format == "JPEG" else 1
                self._left += len(data) * PIXELS_PER_BYTE - image.width * image.height * passes
                if self._left < 0 or max(image.size) > MAX_TEXTURE_SIDE:
                    raise FileError(
                        f"{self._file.name}: up to {what} its textures are larger than"
                        f" {MAX_TEXTURE_PIXELS >> 20} million pixels.",
                        "Reduce its textures.",
                    )
                return _reduced(image)
        except (Image.DecompressionBombError, *STRUCTURE_ERRORS, OSError, SyntaxError, EOFError) as error:
            raise FileError(f"{self._file.name}: {what} is damaged ({reason(error)}).", _EXPORT) from error


def _reduced(image: Any) -> NDArray[np.uint8]:
    """RGB of at most `SAMPLED_PIXELS` a side: large images are averaged before they are converted."""
    image.draft("RGB", (SAMPLED_PIXELS, SAMPLED_PIXELS))
    if image.mode in ("L", "RGB", "RGBA"):
        factor = max(1, max(image.size) // (2 * SAMPLED_PIXELS))
        image = image.reduce(factor)
    small = image.convert("RGB")
    small.thumbnail((SAMPLED_PIXELS, SAMPLED_PIXELS))
    return np.asarray(small)
