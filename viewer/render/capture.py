"""Pixels to a PNG, written atomically."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sport.runtime.atomic import atomic_path


def save_png(pixels: NDArray[np.uint8], path: Path) -> Path:
    """Write `(height, width, 3)` as PNG; FileError names the path when it cannot be written."""
    from PIL import Image

    path = path.expanduser()
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=3)
    return path


def screenshot_path(folder: str) -> Path:
    """A new name in the folder for a screenshot taken now."""
    return Path(folder).expanduser() / time.strftime("sport-%Y%m%d-%H%M%S.png")
