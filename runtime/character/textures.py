"""Textures of a glTF file (PNG, JPEG, WebP, KTX2), and the linear RGB vertex colours from them and COLOR_0."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import AnyArray
from runtime.character.native import decode
from runtime.character.read import STRUCTURE_ERRORS, Entry, GltfFile, read_uri
from runtime.safe_read import reason

if TYPE_CHECKING:
    from PIL.Image import Image

KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"
MAX_SIDE = 8192
KTX2_PIXELS, KTX2_PIXELS_PER_BYTE = 4096 * 4096, 64  # of a KTX2 texture, from its header
MAX_PIXELS = 8192 * 8192  # of all images of a file,
PIXELS_PER_BYTE = 16  # and per byte of them: real images are hardly ever compressed further
SAMPLED_PIXELS = 512  # textures are averaged down to this, since only one colour per vertex is taken
EXTENSIONS = ("EXT_texture_webp", "KHR_texture_basisu")
REMEDY = "Export textures as PNG or JPEG."


def texture_source(texture: Any) -> Any:
    """Return the index of a texture's image, its own or that of a WebP or KTX2 extension; None without an image."""
    if texture.source is not None:
        return texture.source
    named = texture.extensions or {}
    return next((named[name].get("source") for name in EXTENSIONS if isinstance(named.get(name), dict)), None)


def image_bytes(file: GltfFile, image: Any, what: str) -> bytes:
    """Return the bytes of an image of a file; FileError if they are missing."""
    if image.uri is not None:
        return read_uri(file.path, image.uri, "image")
    return bytes(file.view_bytes(image.bufferView, what))


def open_image(data: bytes, file: GltfFile, what: str) -> Image:
    """Open a PNG, JPEG, WebP or KTX2 image; only KTX2 is decoded here. Raises FileError for other or too large images.

    Errors of Pillow for damaged images are left to the caller.
    """
    from PIL import Image

    if data.startswith(KTX2):
        return _ktx2(data, file, what)
    # without a list Pillow tries all of its readers, one of which passes PostScript to Ghostscript
    if not data.startswith((b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")) and data[:4] + data[8:12] != b"RIFFWEBP":
        raise file.error(f"{what} is neither PNG, JPEG, WebP nor KTX2.", REMEDY)
    image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "WEBP"))
    if max(image.size) > MAX_SIDE:
        raise file.error(f"{what} is larger than {MAX_SIDE} pixels a side.", REMEDY)
    return image


def _ktx2(data: bytes, file: GltfFile, what: str) -> Image:
    from PIL import Image

    width, height = struct.unpack("<2I", data[20:28].ljust(8, b"\0"))
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise file.error(f"{what} is damaged or larger than {MAX_SIDE} pixels a side.", REMEDY)
    if width * height > KTX2_PIXELS + KTX2_PIXELS_PER_BYTE * len(data):
        raise file.error(f"{what} has {width} x {height} pixels in {len(data)} bytes.", REMEDY)
    size = 4 * width * height
    pixels = decode("ktx2", file.path, {"size": len(data) + size // 8}, data, REMEDY)
    if len(pixels) != size:
        raise file.error(f"{what} is damaged.", REMEDY)
    return Image.frombytes("RGBA", (width, height), pixels)


def primitive_colors(file: GltfFile, textures: Textures, primitive: Entry, what: str, count: int) -> AnyArray:
    """Return the linear RGB colours `(count, 3)` of a primitive's vertices."""
    surface = _surface(file, primitive, what)
    color = np.ones((count, 3), np.float32)
    if surface.baseColorFactor is not None:
        color *= np.array(surface.baseColorFactor, np.float32)[:3]
    if surface.baseColorTexture is not None:
        color *= _texture_colors(file, textures, primitive, surface.baseColorTexture, what, count)
    if primitive.attributes.COLOR_0 is not None:
        values = file.values(primitive.attributes.COLOR_0, f"COLOR_0 of {what}")
        if len(values) != count or values.shape[1] not in (3, 4):
            raise file.error(f"COLOR_0 of {what} does not fit its {count} vertices.")
        color *= values[:, :3]
    if not np.all(np.isfinite(color)):
        raise file.error(f"the colours of {what} are not finite.")
    return np.clip(color, 0.0, 1.0).astype(np.float32)


def _surface(file: GltfFile, primitive: Entry, what: str) -> Entry:
    materials = file.gltf.materials or []
    if primitive.material is None:
        return Entry()
    if not 0 <= primitive.material < len(materials):
        raise file.error(f"the material of {what} is missing.")
    return materials[primitive.material].pbrMetallicRoughness or Entry()


def _texture_colors(
    file: GltfFile, textures: Textures, primitive: Entry, info: Entry, what: str, count: int
) -> AnyArray:
    channel = getattr(primitive.attributes, f"TEXCOORD_{info.texCoord or 0}", None)
    if channel is None:
        return np.ones((count, 3), np.float32)
    uv = file.values(channel, f"texture coordinates of {what}").astype(np.float64)
    if uv.shape != (count, 2):
        raise file.error(f"the texture coordinates of {what} do not fit its {count} vertices.")
    pixels = textures.pixels(info.index)
    height, width = pixels.shape[:2]
    at = np.floor((uv % 1.0) * (width, height)).astype(np.int64)
    return linear(pixels[np.minimum(at[:, 1], height - 1), np.minimum(at[:, 0], width - 1)] / 255.0)


def linear(srgb: AnyArray) -> AnyArray:
    """Convert sRGB colours of any shape to linear ones, float32."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).astype(np.float32)


def srgb(linear: AnyArray) -> AnyArray:
    """Convert linear colours of any shape to sRGB."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


class Textures:
    """The images of a file, each decoded once, with a limit on their pixels."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._pixels: dict[int, NDArray[np.uint8]] = {}
        self._left = MAX_PIXELS

    def pixels(self, texture: Any) -> NDArray[np.uint8]:
        """Return sRGB pixels `(H, W, 3)` of a texture's image."""
        textures, images = self._file.gltf.textures or [], self._file.gltf.images or []
        if not isinstance(texture, int) or not 0 <= texture < len(textures):
            raise self._file.error(f"texture {str(texture)[:40]} is missing.", REMEDY)
        source = texture_source(textures[texture])
        if not isinstance(source, int) or not 0 <= source < len(images):
            raise self._file.error(f"the image of texture {texture} is missing.", REMEDY)
        if source not in self._pixels:
            what = f"image {source}"
            self._pixels[source] = self._decode(image_bytes(self._file, images[source], what), what)
        return self._pixels[source]

    def _decode(self, data: bytes, what: str) -> NDArray[np.uint8]:
        from PIL import Image

        try:
            with open_image(data, self._file, what) as image:
                # each scan of a JPEG is another pass over the whole image
                passes = 1 + data.count(b"\xff\xda") // 16 if image.format == "JPEG" else 1
                self._left += len(data) * PIXELS_PER_BYTE - image.width * image.height * passes
                if self._left < 0:
                    problem = f"up to {what} its textures are larger than {MAX_PIXELS >> 20} million pixels."
                    raise self._file.error(problem, "Reduce its textures.")
                return _reduced(image)
        except (Image.DecompressionBombError, *STRUCTURE_ERRORS, OSError, SyntaxError, EOFError) as error:
            raise self._file.error(f"{what} is damaged ({reason(error)}).", REMEDY) from error


def _reduced(image: Any) -> NDArray[np.uint8]:
    """Return RGB with at most `SAMPLED_PIXELS` per side: large images are averaged before conversion."""
    image.draft("RGB", (SAMPLED_PIXELS, SAMPLED_PIXELS))
    if image.mode in ("L", "RGB", "RGBA"):
        factor = max(1, max(image.size) // (2 * SAMPLED_PIXELS))
        image = image.reduce(factor)
    small = image.convert("RGB")
    small.thumbnail((SAMPLED_PIXELS, SAMPLED_PIXELS))
    return np.asarray(small)
