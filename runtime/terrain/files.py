"""Terrain from files of others: grey PNG height maps, NPY arrays and meshes, all bounded and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sport.runtime.errors import FileError, TerrainError
from sport.runtime.terrain.height_map import Terrain

Array = NDArray[np.floating]

MAX_SIDE = 4096  # samples along one side
MAX_FILE_BYTES = 256 * 1024 * 1024
MAX_TRIANGLES = 500_000
MAX_HEIGHT_M = 1000.0
MESH_SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
SUFFIXES = (".png", ".npy", *MESH_SUFFIXES)


def read_terrain(path: str | Path, cell_m: float = 0.1, height_m: float = 2.0) -> Terrain:
    """Terrain of a PNG, NPY or mesh file, centred on the origin.

    PNG: grey, 16 or 8 bits, black is 0 and white is `height_m`; columns go along +X, rows along +Z, `cell_m` apart.
    NPY: `(nx, nz)` heights; floats are metres, unsigned integers are scaled like a PNG.
    Mesh: metres, Y up; its highest surface is sampled every `cell_m`, gaps take its lowest height.
    """
    path = Path(path)
    if not 0.005 <= cell_m <= 10.0:
        raise TerrainError(f"terrain cell size {cell_m} m: expected 0.005 to 10 m.", "Change the cell size.")
    if not 0.0 < abs(height_m) <= MAX_HEIGHT_M:
        raise TerrainError(
            f"terrain height {height_m} m: expected up to {MAX_HEIGHT_M:.0f} m.", "Change the height."
        )
    try:
        size = path.stat().st_size
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}.", "Check the path of the terrain.") from error
    if size > MAX_FILE_BYTES:
        raise FileError(f"{path}: larger than {MAX_FILE_BYTES >> 20} MB.", "Use a smaller height map.")
    suffix = path.suffix.lower()
    if suffix == ".png":
        heights = _read_png(path) * height_m
    elif suffix == ".npy":
        heights = _read_npy(path, height_m)
    elif suffix in MESH_SUFFIXES:
        return _checked(path, *_read_mesh(path, cell_m), cell_m)
    else:
        raise FileError(f"{path}: expected one of {' '.join(SUFFIXES)}.", "Convert the height map to PNG.")
    nx, nz = heights.shape if heights.ndim == 2 else (0, 0)
    return _checked(path, heights, (-(nx // 2) * cell_m, -(nz // 2) * cell_m), cell_m)


def write_height_png(path: str | Path, heights: Array) -> None:
    """Write heights `(nx, nz)` in 0..1 as a 16-bit grey PNG that `read_terrain` reads back."""
    from PIL import Image

    values = np.round(np.clip(heights, 0.0, 1.0) * 65535.0).astype(np.uint16)
    Image.fromarray(np.ascontiguousarray(values.T)).save(path)


def _read_png(path: Path) -> Array:
    from PIL import Image

    remedy = "Save it again as a grey PNG with 16 or 8 bits."
    try:
        with Image.open(path, formats=("PNG",)) as image:
            if max(image.size) > MAX_SIDE or min(image.size) < 2:
                raise FileError(
                    f"{path}: {image.size[0]} x {image.size[1]} pixels; expected 2 to {MAX_SIDE} a side.",
                    "Scale the image.",
                )
            full_scale = {"I;16": 65535.0, "I;16B": 65535.0, "I": 65535.0, "L": 255.0, "1": 1.0}
            if image.mode not in full_scale:
                raise FileError(f"{path}: expected a grey PNG, got colour mode {image.mode}.", remedy)
            return np.asarray(image, np.float64).T / full_scale[image.mode]
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise FileError(f"{path}: not a readable PNG ({error}).", remedy) from error


def _read_npy(path: Path, height_m: float) -> Array:
    remedy = "Save a two-dimensional float array of metres with numpy.save."
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        # numpy takes whatever is no NPY for a pickle and recommends to load it unsafely
        reason = "no numbers in it" if "pickle" in str(error) else error
        raise FileError(f"{path}: not a readable NPY array ({reason}).", remedy) from error
    if not isinstance(array, np.ndarray) or array.ndim != 2 or array.dtype.kind not in "fiu":
        kind = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else "an archive"
        raise FileError(f"{path}: expected a two-dimensional array of numbers, got {kind}.", remedy)
    if max(array.shape) > MAX_SIDE:
        raise FileError(f"{path}: {array.shape} samples; expected at most {MAX_SIDE} a side.", "Thin it out.")
    scale = height_m / np.iinfo(array.dtype).max if array.dtype.kind == "u" else 1.0
    return np.asarray(array, np.float64) * scale


def _read_mesh(path: Path, cell_m: float) -> tuple[Array, tuple[float, float]]:
    """Heights and x, z of the first sample of the mesh's highest surface."""
    import trimesh

    remedy = "Export the ground as one OBJ or PLY in metres, Y up."
    try:
        mesh: Any = trimesh.load(str(path), force="mesh", process=False)
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # trimesh's readers raise whatever their parsers meet
        raise FileError(f"{path}: not a readable mesh ({error}).", remedy) from error
    if not len(faces) or len(faces) > MAX_TRIANGLES or not np.all(np.isfinite(vertices)):
        raise FileError(
            f"{path}: {len(faces)} triangles; expected 1 to {MAX_TRIANGLES} with finite vertices.", remedy
        )
    low, high = vertices[:, [0, 2]].min(0), vertices[:, [0, 2]].max(0)
    shape = np.ceil((high - low) / cell_m - 1e-6).astype(int) + 1
    if shape.max() > MAX_SIDE or shape.min() < 2:
        size = f"{high[0] - low[0]:.2f} x {high[1] - low[1]:.2f} m"
        raise FileError(
            f"{path}: {size} at {cell_m} m a cell; expected 2 to {MAX_SIDE} cells a side.",
            "Change the cell size or the units (metres) of the mesh.",
        )
    centre = (low + high) / 2
    triangles = vertices[faces]
    triangles[..., [0, 2]] = (triangles[..., [0, 2]] - low) / cell_m
    heights = rasterise(triangles, (int(shape[0]), int(shape[1])))
    origin = low - np.round(centre / cell_m) * cell_m
    return heights, (float(origin[0]), float(origin[1]))


def rasterise(triangles: Array, shape: tuple[int, int]) -> Array:
    """Highest y of triangles `(n, 3, 3)` over each grid point (x, z in cells) of `shape`; gaps take the lowest y."""
    heights = np.full(shape, -np.inf)
    xz, y = triangles[..., [0, 2]], triangles[..., 1]
    first = np.maximum(np.ceil(xz.min(1) - 1e-9).astype(int), 0)
    last = np.minimum(np.floor(xz.max(1) + 1e-9).astype(int), np.array(shape) - 1)
    edge1, edge2 = xz[:, 1] - xz[:, 0], xz[:, 2] - xz[:, 0]
    area = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    covers = np.all(last >= first, axis=1) & (np.abs(area) > 1e-12)  # small ones may lie between grid points
    for k in np.flatnonzero(covers):
        (i0, j0), (i1, j1) = first[k], last[k]
        dx = np.arange(i0, i1 + 1)[:, None] - xz[k, 0, 0]
        dz = np.arange(j0, j1 + 1)[None, :] - xz[k, 0, 1]
        u = (dx * edge2[k, 1] - dz * edge2[k, 0]) / area[k]
        v = (dz * edge1[k, 0] - dx * edge1[k, 1]) / area[k]
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
        surface = np.where(inside, y[k, 0] + u * (y[k, 1] - y[k, 0]) + v * (y[k, 2] - y[k, 0]), -np.inf)
        block = heights[i0 : i1 + 1, j0 : j1 + 1]
        np.maximum(block, surface, out=block)
    return np.where(np.isfinite(heights), heights, y.min())


def _checked(path: Path, heights: Array, origin: tuple[float, float], cell_m: float) -> Terrain:
    if heights.ndim != 2 or min(heights.shape) < 2 or max(heights.shape) > MAX_SIDE:
        raise FileError(
            f"{path}: {heights.shape} samples; expected two dimensions of 2 to {MAX_SIDE}.",
            "Use another height map.",
        )
    if not np.all(np.isfinite(heights)) or np.abs(heights).max() > MAX_HEIGHT_M:
        raise FileError(
            f"{path}: expected finite heights within {MAX_HEIGHT_M:.0f} m.",
            "Mend the values (NaN, infinity).",
        )
    return Terrain(path.stem, np.ascontiguousarray(heights, np.float32), cell_m, origin)


def main() -> None:
    """Write the shipped example height map, `assets/terrains/bowl.png`."""
    from sport.runtime.assets import PROJECT_ROOT
    from sport.runtime.terrain.library import example_heights

    target = PROJECT_ROOT / "assets" / "terrains" / "bowl.png"
    target.parent.mkdir(parents=True, exist_ok=True)
    write_height_png(target, example_heights())


if __name__ == "__main__":
    main()
