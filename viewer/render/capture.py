"""Pixels to a PNG, written atomically."""

from __future__ import annotations

import io
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path, write_new


def save_png(pixels: NDArray[np.uint8], path: Path, new: bool = False) -> Path:
    """Write `(height, width, 3)` as PNG; the path. FileError names it when it cannot be written.

    With `new` no file is replaced: a name that is taken becomes name-2, name-3, … .
    """
    from PIL import Image

    path = path.expanduser()
    if new:
        data = io.BytesIO()
        Image.fromarray(pixels).save(data, format="PNG", compress_level=3)
        return write_new(path, data.getvalue())
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=3)
    return path


def screenshot_path(folder: str) -> Path:
    """The name in the folder for a screenshot taken now; another of the same second may have it."""
    return Path(folder).expanduser() / time.strftime("sport-%Y%m%d-%H%M%S.png")
