"""Height maps as files."""

from pathlib import Path

import numpy as np
from PIL import Image

from runtime.arrays import Array
from runtime.terrain.files import WHITE_16_BIT_SCALE


def write_height_png(path: str | Path, heights: Array) -> None:
    """Write heights `(nx, nz)` in 0..1 as a 16-bit grey PNG for `read_terrain`."""
    values = np.round(np.clip(heights, 0.0, 1.0) * WHITE_16_BIT_SCALE).astype(np.uint16)
    Image.fromarray(np.ascontiguousarray(values.T)).save(path)
