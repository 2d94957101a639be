"""Vertex colours of a glTF primitive: COLOR_0, base colour factor and base colour texture, as linear RGB."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from sport.runtime.character.read import REMEDY, GltfFile, buffer_view_bytes, read_accessor, read_sibling
from sport.runtime.errors import FileError

if TYPE_CHECKING:
    from pygltflib import Primitive, TextureInfo

Array = NDArray[Any]

MAX_TEXTURE_PIXELS = 8192 * 8192
SAMPLED_PIXELS = 512  # textures are averaged down to this, since only one colour per vertex is taken


def primitive_colors(file: GltfFile, primitive: Primitive, what: str, count: int) -> Array:
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
            color *= _texture_colors(file, primitive, surface.baseColorTexture, what, count)
    if primitive.attributes.COLOR_0 is not None:
        values = read_accessor(file, primitive.attributes.COLOR_0, f"COLOR_0 of {what}")
        if len(values) != count or values.shape[1] not in (3, 4):
            raise FileError(f"{file.name}: COLOR_0 of {what} does not fit its {count} vertices.", REMEDY)
        color *= values[:, :3]
    if not np.all(np.isfinite(color)):
        raise FileError(f"{file.name}: the colours of {what} are not finite.", REMEDY)
    return np.clip(color, 0.0, 1.0).astype(np.float32)


def _texture_colors(file: GltfFile, primitive: Primitive, info: TextureInfo, what: str, count: int) -> Array:
    channel = getattr(primitive.attributes, f"TEXCOORD_{info.texCoord or 0}", None)
    if channel is None:
        return np.ones((count, 3), np.float32)
    uv = read_accessor(file, channel, f"texture coordinates of {what}").astype(np.float64)
    if uv.shape != (count, 2):
        raise FileError(
            f"{file.name}: the texture coordinates of {what} do not fit its {count} vertices.", REMEDY
        )
    pixels = _texture_pixels(file, info.index)
    height, width = pixels.shape[:2]
    at = np.floor((uv % 1.0) * (width, height)).astype(np.int64)
    srgb = pixels[np.minimum(at[:, 1], height - 1), np.minimum(at[:, 0], width - 1)] / 255.0
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).astype(np.float32)


def _texture_pixels(file: GltfFile, index: int) -> NDArray[np.uint8]:
    """sRGB pixels `(H, W, 3)` of a texture's image."""
    from PIL import Image, UnidentifiedImageError

    textures, images = file.gltf.textures or [], file.gltf.images or []
    if not 0 <= index < len(textures):
        raise FileError(f"{file.name}: texture {index} is missing.", REMEDY)
    source = textures[index].source
    if source is None or not 0 <= source < len(images):
        raise FileError(
            f"{file.name}: the image of texture {index} is missing.", "Export textures as PNG or JPEG."
        )
    image = images[source]
    if image.bufferView is not None:
        data = buffer_view_bytes(file, image.bufferView, f"image {source}")
    elif (image.uri or "").startswith("data:"):
        data = file.gltf.decode_data_uri(image.uri)
    else:
        data = read_sibling(file.path, unquote(image.uri or ""), "image")
    try:
        with Image.open(io.BytesIO(data)) as picture:
            if picture.width * picture.height > MAX_TEXTURE_PIXELS:
                raise FileError(
                    f"{file.name}: image {source} is larger than 8192 x 8192.", "Reduce its textures."
                )
            picture.draft("RGB", (SAMPLED_PIXELS, SAMPLED_PIXELS))
            small = picture.convert("RGB")
            small.thumbnail((SAMPLED_PIXELS, SAMPLED_PIXELS))
            return np.asarray(small)
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError, SyntaxError) as error:
        raise FileError(
            f"{file.name}: image {source} is damaged ({error}).", "Export textures as PNG or JPEG."
        ) from error
