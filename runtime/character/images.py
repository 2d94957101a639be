"""Images of a character's textures: PNG, JPEG, WebP and KTX2 (Basis Universal), with bounds on their size."""

from __future__ import annotations

import importlib
import io
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.errors import FileError

if TYPE_CHECKING:
    from PIL.Image import Image

KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"
MAX_SIDE = 8192
EXTENSIONS = ("EXT_texture_webp", "KHR_texture_basisu")
REMEDY = "Export textures as PNG or JPEG."


def library(name: str, package: str, path: Path, what: str) -> Any:
    """A module that unpacks `what`; FileError says what to install where it is not there."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise FileError(
            f"{path}: {what}, which needs the library {package}.",
            f"Run pip install {package} (or '.[characters]'), or export the character without it.",
        ) from error


def texture_source(texture: Any) -> Any:
    """The number of a texture's image: its own, or that of an extension for WebP or KTX2; None without one."""
    if texture.source is not None:
        return texture.source
    named = texture.extensions or {}
    return next((named[name].get("source") for name in EXTENSIONS if isinstance(named.get(name), dict)), None)


def open_image(data: bytes, path: Path, what: str) -> Image:
    """An image of the four kinds, not yet decoded but for KTX2; FileError for others, or for one that is too large.

    What Pillow raises for a damaged one is left to the caller.
    """
    from PIL import Image

    if data.startswith(KTX2):
        return _ktx2(data, path, what)
    # Pillow guesses the format by asking all of its readers, one of which hands PostScript to Ghostscript
    if not data.startswith((b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")) and data[:4] + data[8:12] != b"RIFFWEBP":
        raise FileError(f"{path}: {what} is neither PNG, JPEG, WebP nor KTX2.", REMEDY)
    return Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "WEBP"))


def _ktx2(data: bytes, path: Path, what: str) -> Image:
    from PIL import Image

    codec = library("opengl_basisu", "opengl-basisu", path, f"{what} is a KTX2")
    if len(data) < 28 or not all(0 < side <= MAX_SIDE for side in struct.unpack("<2I", data[20:28])):
        raise FileError(f"{path}: {what} is damaged or larger than {MAX_SIDE} pixels a side.", REMEDY)
    return Image.fromarray(codec.open(data).transcode(codec.Target.RGBA8).data)
