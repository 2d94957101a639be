"""The ground of a take: the one it was made on, written as a node of a GLB, or as an OBJ or GLB next to it."""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.atomic import write_atomic
from runtime.character.glb_buffer import ARRAY_BUFFER, ELEMENT_BUFFER, GlbBuffer
from runtime.errors import FileError, UsageError
from runtime.formats.options import UNITS_PER_METRE, ExportOptions
from runtime.formats.prepare import Check, PreparedTake, go_on
from runtime.takes.clip import Clip
from runtime.takes.metadata import UNKNOWN
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import TERRAIN_NAMES, load_terrain

MAX_VERTICES = 500_000  # of a larger ground only the part around the take is written
MARGIN_M = 10.0  # around the take, in that case
LEVEL_M = 1e-5  # ground with smaller height differences is one quad
COLOR = (0.42, 0.44, 0.40)  # linear RGB


def names_ground(clip: Clip) -> bool:
    """Return whether a clip's metadata says which ground it was made on."""
    return clip.terrain != "flat" or bool(clip.prompts) or clip.origin != UNKNOWN


def ground_spec(clip: Clip, clip_path: Path | None = None, chosen: str | None = None) -> str:
    """Return the name or file of the ground under `clip`: `chosen`, or the one in its metadata.

    Metadata only has the file name of a ground: it is looked up as it is and next to the clip. Raises FileError if it
    is in neither place.
    """
    if chosen is not None or clip.placed is None:
        return "flat" if chosen is None else chosen
    if clip.terrain in TERRAIN_NAMES:
        return clip.terrain
    for folder in (None, clip_path and clip_path.parent):
        place = Path(clip.terrain) if folder is None else folder / Path(clip.terrain).name
        if os.path.isfile(place):  # unlike `Path.is_file`, also where the name is too long
            return str(place)
    raise FileError(
        f"{clip_path or clip.name}: made on the ground {Path(clip.terrain).name}, which is not next to it.",
        "Put that file next to the clip, or choose a ground (--terrain).",
    )


def ground_of(clip: Clip, clip_path: Path | None = None, chosen: str | None = None) -> Terrain:
    """Return the terrain of `ground_spec`, scaled for the body that the clip was made for."""
    return load_terrain(ground_spec(clip, clip_path, chosen)).seen_by(clip.size)


def ground_mesh(
    terrain: Terrain, take: PreparedTake, most: int | None = None, margin_m: float = MARGIN_M
) -> tuple[Array, NDArray[np.uint32]]:
    """Return vertices `(V, 3)` in the take's units and triangles `(F, 3)`, counter-clockwise from above, of the ground under a take.

    Every sample of the height map is a vertex, so heights are exact there; level ground is two triangles.
    """
    terrain = terrain.seen_by(take.clip.size)
    x, z = (
        o + terrain.cell_m * np.arange(n) for o, n in zip(terrain.origin, terrain.heights.shape, strict=True)
    )
    heights = terrain.heights.astype(np.float64)
    if np.ptp(heights) < LEVEL_M:
        x, z, heights = x[[0, -1]], z[[0, -1]], heights[np.ix_([0, -1], [0, -1])]
    most = MAX_VERTICES if most is None else most
    if heights.size > most:
        i, j = _near(x, take, 0, margin_m), _near(z, take, 2, margin_m)
        x, z, heights = x[i], z[j], heights[i, j]
        step = int(np.ceil(np.sqrt(heights.size / most)))
        x, z, heights = x[::step], z[::step], heights[::step, ::step]
    nx, nz = heights.shape
    points = np.stack([np.broadcast_to(x[:, None], (nx, nz)), heights, np.broadcast_to(z, (nx, nz))], -1)
    corner = (np.arange(nx - 1)[:, None] * nz + np.arange(nz - 1)).ravel()
    quads = corner[:, None] + np.array([0, 1, nz, nz, 1, nz + 1])
    return take.placement.points(points.reshape(-1, 3)), quads.reshape(-1, 3).astype(np.uint32)


def _near(axis: Array, take: PreparedTake, component: int, margin_m: float) -> slice:
    """Return the part of a grid's axis around the take before its placement."""
    turn = take.placement
    back = np.linalg.inv(turn.matrix())
    path = take.root.positions @ back[:3, :3].T + back[:3, 3]
    low, high = path[:, component].min() - margin_m, path[:, component].max() + margin_m
    first = int(np.clip(np.searchsorted(axis, low) - 1, 0, len(axis) - 2))
    last = int(np.clip(np.searchsorted(axis, high) + 1, first + 2, len(axis)))
    return slice(first, last)


def save_ground(
    take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None, check: Check = go_on
) -> str:
    """Write the ground of a take as OBJ or GLB in the unit of the options; return a sentence about it. UsageError without a ground."""
    if terrain is None:
        raise UsageError(f"{path}: the take has no ground.", "Choose one with --terrain.")
    check()
    scale = UNITS_PER_METRE[options.unit] * take.clip.size
    if path.suffix.lower() == ".obj":
        vertices, triangles = ground_mesh(terrain, take)
        lines = [f"# ground {terrain.name}, {options.unit}, Y up", f"o ground_{Path(terrain.name).stem}"]
        lines += [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in (vertices * scale).tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (triangles + 1).tolist()]
        write_atomic(path, "\n".join(lines) + "\n")
    else:
        import pygltflib as g

        buffer = GlbBuffer(g.GLTF2(asset=g.Asset(version="2.0", generator="SPORT viewer")))
        buffer.gltf.scenes, buffer.gltf.scene = [g.Scene(name="ground", nodes=[])], 0
        add_ground(buffer, terrain, take, scale)
        buffer.save(path)
    return f"{path}: ground {terrain.name} in {options.unit}"


def add_ground(
    buffer: GlbBuffer,
    terrain: Terrain,
    take: PreparedTake,
    scale: float = 1.0,
    most: int | None = None,
    margin_m: float = MARGIN_M,
) -> None:
    """Add the ground to a document's scene as a separate node."""
    import pygltflib as g

    from runtime.character.mesh import vertex_normals

    gltf = buffer.gltf
    vertices, triangles = ground_mesh(terrain, take, most, margin_m)
    normals = vertex_normals(vertices, triangles)
    attributes = g.Attributes(
        POSITION=buffer.add(vertices, ARRAY_BUFFER, bounds=True), NORMAL=buffer.add(normals, ARRAY_BUFFER)
    )
    indices = buffer.add(triangles.reshape(-1, 1), ELEMENT_BUFFER)
    surface = g.PbrMetallicRoughness(baseColorFactor=[*COLOR, 1.0], metallicFactor=0.0, roughnessFactor=1.0)
    material = buffer.append("materials", g.Material(name="Ground", pbrMetallicRoughness=surface))
    primitive = g.Primitive(attributes=attributes, indices=indices, material=material)
    mesh = buffer.append("meshes", g.Mesh(name="Ground", primitives=[primitive]))
    node = g.Node(name="Ground", mesh=mesh, scale=None if scale == 1.0 else [scale] * 3)
    gltf.scenes[gltf.scene or 0].nodes.append(buffer.append("nodes", node))
