"""Reads terrain from untrusted files: grey PNG height maps, NPY arrays and meshes, all bounded and checked."""

import io
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.errors import FileError, TerrainError
from runtime.safe_read import read_bounded, reason
from runtime.terrain.height_map import Terrain
from runtime.terrain.mesh import MAX_SIDE, MESH_SUFFIXES, read_mesh

MAX_FILE_BYTES = 16 * MAX_SIDE * MAX_SIDE + (1 << 20)
MAX_HEADER_BYTES = 4096  # of an NPY file; numpy writes 128
MAX_HEIGHT_M = 1000.0
_COLOUR_MODES = ("RGB", "RGBA", "P", "LA", "PA")
_BRIGHTNESS = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, as Pillow's own
_ROWS = 256  # of a height map, converted at once
SUFFIXES = (".png", ".npy", *MESH_SUFFIXES)
WHITE_16_BIT_SCALE, WHITE_8_BIT_SCALE = 65535.0, 255.0  # of grey images with that bit depth
CELL_RANGE_M = 0.005, 10.0


def read_terrain(path: str | Path, cell_m: float = 0.1, height_m: float = 2.0) -> Terrain:
    """Read a terrain from a PNG, NPY or mesh file, centred on the origin.

    PNG: grey, 16 or 8 bits, black is 0 and white is `height_m`; colours are converted to brightness, with a
    note; columns go along +X, rows along +Z, `cell_m` apart.
    NPY: `(nx, nz)` heights; floats are metres, unsigned integers are scaled like a PNG.
    Mesh: metres, Y up; its highest surface is sampled every `cell_m`, gaps take its lowest height.
    """
    path = Path(path)
    if not CELL_RANGE_M[0] <= cell_m <= CELL_RANGE_M[1]:
        raise TerrainError(f"terrain cell size {cell_m} m: expected 0.005 to 10 m.", "Change the cell size.")
    if not 0.0 < abs(height_m) <= MAX_HEIGHT_M:
        raise TerrainError(
            f"terrain height {height_m} m: expected up to {MAX_HEIGHT_M:.0f} m.", "Change the height."
        )
    suffix = path.suffix.lower()
    if suffix in MESH_SUFFIXES:
        heights, origin = read_mesh(path, cell_m)
        return _checked(path, heights, origin, cell_m)
    if suffix not in SUFFIXES:
        raise FileError(f"{path}: expected one of {' '.join(SUFFIXES)}.", "Convert the height map to PNG.")
    data = read_bounded(
        path, MAX_FILE_BYTES, "Use a smaller height map.", missing="Check the path of the terrain."
    )
    note = ""
    if suffix == ".png":
        heights, note = _read_png(path, data, height_m)
    else:
        heights = _read_npy(path, data, height_m)
    nx, nz = heights.shape
    return _checked(path, heights, (-(nx // 2) * cell_m, -(nz // 2) * cell_m), cell_m, note)


def _read_png(path: Path, data: bytes, height_m: float) -> tuple[Array, str]:
    """Heights `(columns, rows)` of a PNG, whose white is `height_m`, and a note where colours were read as grey."""
    from PIL import Image

    remedy = "Save it again as a grey PNG with 16 or 8 bits."
    if not data.startswith(b"\x89PNG\r\n\x1a\n"):
        raise FileError(f"{path}: not a readable PNG (its signature is wrong).", remedy)
    try:
        with Image.open(io.BytesIO(data), formats=("PNG",)) as image:
            if max(image.size) > MAX_SIDE or min(image.size) < 2:
                raise FileError(
                    f"{path}: {image.size[0]} x {image.size[1]} pixels; expected 2 to {MAX_SIDE} a side.",
                    "Scale the image.",
                )
            full_scale = {
                "I;16": WHITE_16_BIT_SCALE,
                "I;16B": WHITE_16_BIT_SCALE,
                "I": WHITE_16_BIT_SCALE,
                "L": WHITE_8_BIT_SCALE,
                "1": 1.0,
            }
            if image.mode in full_scale:
                return _scaled(np.asarray(image).T, height_m, full_scale[image.mode]), ""
            if image.mode not in _COLOUR_MODES:
                raise FileError(f"{path}: expected a grey PNG, got mode {image.mode}.", remedy)
            note = (
                f"{path.name}: colours ({image.mode}, 8 bits) were read as grey; a 16-bit grey PNG is finer."
            )
            return _scaled(_brightness(np.asarray(image.convert("RGB"))).T, height_m, WHITE_8_BIT_SCALE), note
    except (
        OSError, ValueError, SyntaxError, EOFError, IndexError, KeyError, TypeError, AttributeError,
        OverflowError, struct.error, Image.DecompressionBombError,
    ) as error:  # fmt: skip
        # exceptions of Pillow's PNG reader for damaged chunks
        raise FileError(f"{path}: not a readable PNG ({reason(error)}).", remedy) from error


def _brightness(colors: NDArray[np.uint8]) -> Array:
    """Grey float32 `(rows, columns)` of colours `(rows, columns, 3)`, a few rows at a time."""
    grey = np.empty(colors.shape[:2], np.float32)
    for first in range(0, len(colors), _ROWS):
        rows = slice(first, first + _ROWS)
        grey[rows] = colors[rows] @ _BRIGHTNESS
    return grey


def _scaled(values: NDArray[np.generic], height_m: float, full_scale: float) -> Array:
    """Heights float32 of samples, computed in float64 a few rows at a time."""
    heights = np.empty(values.shape, np.float32)
    for first in range(0, len(values), _ROWS):
        rows = slice(first, first + _ROWS)
        with np.errstate(over="ignore"):  # infinite values are refused below
            heights[rows] = values[rows].astype(np.float64) / full_scale * height_m
    return heights


def _read_npy(path: Path, data: bytes, height_m: float) -> Array:
    """Heights `(nx, nz)` of an NPY file; the header is read with a limit, and nothing in it is run."""
    remedy = "Save a two-dimensional float array of metres with numpy.save."
    try:
        shape, fortran, dtype, at = _npy_header(data)
    except (ValueError, TypeError) as error:  # TypeError: floats of one byte
        raise FileError(f"{path}: not a readable NPY array ({reason(error)}).", remedy) from error
    if max(shape) > MAX_SIDE or min(shape) < 2:
        raise FileError(
            f"{path}: {shape[0]} x {shape[1]} samples; expected 2 to {MAX_SIDE} a side.", "Downsample it."
        )
    wanted = shape[0] * shape[1] * dtype.itemsize
    if len(data) - at < wanted:
        raise FileError(f"{path}: cut off, {len(data) - at} of {wanted} bytes are there.", remedy)
    values = np.frombuffer(data, dtype, shape[0] * shape[1], at)
    values = values.reshape(shape, order="F" if fortran else "C")
    unsigned = dtype.kind == "u"
    return _scaled(values, height_m if unsigned else 1.0, np.iinfo(dtype).max if unsigned else 1.0)


def _npy_header(data: bytes) -> tuple[tuple[int, int], bool, np.dtype[Any], int]:
    """Return shape, Fortran order and dtype of an array, and the offset of its values; ValueError for another header.

    The header is a line of text in the form of a Python dictionary, of which only known keys are parsed: numpy evaluates
    it, and raises a dozen kinds of errors and warnings for damaged or hostile ones.
    """
    if not data.startswith(b"\x93NUMPY") or len(data) < 12:
        raise ValueError("no numbers in it")
    wide = data[6] > 1  # the header's length has four bytes from version 2 on
    at = 12 if wide else 10
    length = int.from_bytes(data[8:at], "little")
    if length > MAX_HEADER_BYTES:
        raise ValueError(f"a header of {length} bytes")
    head = data[at : at + length].decode("latin-1")
    kind = re.search(r"""['"]descr['"]\s*:\s*['"]([<>|=]?[fiu](?:1|2|4|8|16))['"]""", head)
    order = re.search(r"""['"]fortran_order['"]\s*:\s*(True|False)""", head)
    shape = re.search(r"""['"]shape['"]\s*:\s*\(\s*(\d{1,9})\s*,\s*(\d{1,9})\s*,?\s*\)""", head)
    if not kind or not order or not shape:
        raise ValueError("not a two-dimensional array of numbers")
    return (int(shape[1]), int(shape[2])), order[1] == "True", np.dtype(kind[1]), at + length


def _checked(
    path: Path, heights: Array, origin: tuple[float, float], cell_m: float, note: str = ""
) -> Terrain:
    if heights.ndim != 2 or min(heights.shape) < 2 or max(heights.shape) > MAX_SIDE:
        raise FileError(
            f"{path}: {heights.shape} samples; expected two dimensions of 2 to {MAX_SIDE}.",
            "Use another height map.",
        )
    if (
        not max(-float(heights.min()), float(heights.max())) <= MAX_HEIGHT_M
    ):  # also rejects NaN, which min and max propagate
        raise FileError(
            f"{path}: expected finite heights within {MAX_HEIGHT_M:.0f} m.",
            "Replace NaN and infinite values, and check the unit.",
        )
    return Terrain(path.stem, np.ascontiguousarray(heights, np.float32), cell_m, origin, note)
