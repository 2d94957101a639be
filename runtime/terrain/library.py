"""Built-in terrains: walkable ground of about 40 x 40 m with a flat start around the origin."""

from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.errors import TerrainError
from runtime.terrain import courses
from runtime.terrain.height_map import Terrain

SIZE_M = 40.0
START_RADIUS_M = 2.5  # level ground around the origin
START_EASE_M = 3.5  # over which the ground rises from level to its full height
STEP_RISE_M = 0.16
STEP_RUN_M = 0.32
STEPS = 8  # of a flight of stairs
STAIRS_BEGIN_M = 3.0  # from the start
LANDING_LENGTH_M = 2.56
STEP_EDGE_M = 1e-6  # rounding error of the grid
HILLS_SLOPE_DEGREES, ROUGH_SLOPE_DEGREES = 18.0, 20.0  # exceeded by the steepest hundredth of the ground
HILLS_WAVELENGTH_M, KNOLLS_WAVELENGTH_M, KNOLLS_FRACTION = 14.0, 4.0, 0.12
BUMPS_WAVELENGTH_M, BUMPS_CHANGE_M, SWELLS_WAVELENGTH_M = 0.9, 6.0, 5.0
MIN_BUMPS_M, BUMPS_RANGE_M = 0.05, 0.10  # heights of bumps: 5 to 15 cm
BUMPS_FRACTION, SWELLS_FRACTION = 0.4, 0.1
PLATFORM_HEIGHTS_M = (0.3, 0.45, 0.6)
PLATFORM_SPACING_M = 6.0
PLATFORM_HALF_WIDTH_M = (0.8, 1.1)  # smallest and largest
PLATFORM_STEP_RISE_M, PLATFORM_STEP_RUN_M, PLATFORM_RAMP_SLOPE = 0.15, 0.4, 0.33
STEEPEST_FRACTION = 0.99  # of the ground, which is less steep than the slope that a terrain is scaled to
KEPT_TERRAINS = 9  # cached generated grounds: one of each
HILLS_CELL_M = 0.1
STAIRS_CELL_M = 0.04  # the run is a whole number of cells, a riser is one cell wide
BAND_WIDTH, LOW_BAND_WIDTH = 0.35, 0.4  # of the noise's spectrum, relative to the frequency of its bumps


def make_terrain(name: str, seed: int = 0) -> Terrain:
    """Return the generated terrain `name`; equal names and seeds give equal heights. TerrainError lists the names."""
    if name not in TERRAIN_NAMES:
        raise TerrainError(
            f"terrain '{name[:80]}': there is no such terrain.",
            f"Choose one of {', '.join(TERRAIN_NAMES)}, or give a PNG, NPY or mesh file.",
        )
    return _made(_MAKERS[name], name, seed)


def load_terrain(spec: str | Path, cell_m: float = 0.1, height_m: float = 2.0) -> Terrain:
    """Return a terrain by a name of `TERRAIN_NAMES`, or from a height map (16-bit PNG, NPY) or mesh file.

    `cell_m` is the distance between samples, `height_m` the height of a white pixel (see `terrain_files`). TerrainError
    or FileError name the file, what was expected and the remedy.
    """
    from runtime.terrain import files as terrain_files

    text = str(spec)
    if text in TERRAIN_NAMES:
        return make_terrain(text)
    if Path(text).suffix.lower() in terrain_files.SUFFIXES:
        return terrain_files.read_terrain(text, cell_m, height_m)
    return make_terrain(text)  # raises with the list of names


_kept: OrderedDict[tuple[str, int], Terrain] = OrderedDict()


def _made(maker: Callable[[int], Terrain], name: str, seed: int) -> Terrain:
    """Return the same object for the same ground while it is cached: takes hold the ground that they were made on."""
    found = _kept.pop((name, seed), None)
    if found is None:
        found = maker(seed)
        found.heights.flags.writeable = False
    _kept[name, seed] = found
    while len(_kept) > KEPT_TERRAINS:
        _kept.popitem(last=False)
    return found


def _hills(seed: int) -> Terrain:
    cell = HILLS_CELL_M
    x, z = _grid(cell)
    knolls = KNOLLS_FRACTION * _noise(len(x), cell, KNOLLS_WAVELENGTH_M, seed + 1)
    heights = _level_start(_noise(len(x), cell, HILLS_WAVELENGTH_M, seed) + knolls, x, z)
    return _terrain("hills", _scale_to_slope(heights, cell, HILLS_SLOPE_DEGREES), cell)


def _rough(seed: int) -> Terrain:
    cell = HILLS_CELL_M
    x, z = _grid(cell)
    bumps = _noise(len(x), cell, BUMPS_WAVELENGTH_M, seed)
    change = smoothstep((_noise(len(x), cell, BUMPS_CHANGE_M, seed + 1) + 1.0) / 2.0)
    strength = BUMPS_FRACTION * (MIN_BUMPS_M + BUMPS_RANGE_M * change)
    swells = SWELLS_FRACTION * _noise(len(x), cell, SWELLS_WAVELENGTH_M, seed + 2)
    heights = _level_start(strength * bumps + swells, x, z)
    return _terrain("rough", _scale_to_slope(heights, cell, ROUGH_SLOPE_DEGREES), cell)


def _stairs(_seed: int) -> Terrain:
    """Square rings around the start: a flight of stairs up, a landing, a flight down, a floor."""
    cell = STAIRS_CELL_M
    x, z = _grid(cell)
    distance = np.maximum(np.abs(x), np.abs(z)) - STAIRS_BEGIN_M
    flight = STEPS * STEP_RUN_M
    period = 2.0 * (flight + LANDING_LENGTH_M)
    inside = np.mod(distance, period)
    up = np.clip(np.floor(inside / STEP_RUN_M + STEP_EDGE_M) + 1, 0, STEPS)
    down = np.clip(
        STEPS - 1 - np.floor((inside - flight - LANDING_LENGTH_M) / STEP_RUN_M + STEP_EDGE_M), 0, STEPS
    )
    count = np.where(distance < 0, 0, np.minimum(up, down))
    return _terrain("stairs", STEP_RISE_M * count, cell)


def _platforms(seed: int) -> Terrain:
    """A field of raised squares, each with ramps along Z and steps along X."""
    cell = courses.CELL_M
    x, z = _grid(cell)
    rng = np.random.default_rng(seed)
    pitch = PLATFORM_SPACING_M
    heights = np.zeros_like(x)
    x, z = x[:, :1], z[:1]
    for i in range(-3, 4):
        for j in range(-3, 4):
            top = rng.choice(PLATFORM_HEIGHTS_M)
            half_x, half_z = rng.uniform(*PLATFORM_HALF_WIDTH_M, 2)
            if i == 0 and j == 0:
                continue
            beyond_x = np.maximum(np.abs(x - pitch * i) - half_x, 0.0)
            beyond_z = np.maximum(np.abs(z - pitch * j) - half_z, 0.0)
            steps = PLATFORM_STEP_RISE_M * np.ceil(beyond_x / PLATFORM_STEP_RUN_M - STEP_EDGE_M)
            heights = np.maximum(heights, top - np.maximum(steps, PLATFORM_RAMP_SLOPE * beyond_z))
    return _terrain("platforms", heights, cell)


def _course(name: str, obstacles: tuple[courses.Obstacle, ...]) -> Terrain:
    return _terrain(name, courses.raise_obstacles(*_grid(courses.CELL_M), obstacles), courses.CELL_M)


_MAKERS: dict[str, Callable[[int], Terrain]] = {
    "flat": lambda _: Terrain.flat(size_m=SIZE_M),
    "hills": _hills,
    "rough": _rough,
    "stairs": _stairs,
    "platforms": _platforms,
    "gaps": lambda _: _course("gaps", courses.GAPS),
    "hurdles": lambda _: _course("hurdles", courses.HURDLES),
    "beam": lambda _: _terrain("beam", courses.raise_beam(*_grid(courses.CELL_M)), courses.CELL_M),
    "wall": lambda _: _course("wall", courses.WALLS),
}
TERRAIN_NAMES = tuple(_MAKERS)


def _grid(cell: float) -> tuple[Array, Array]:
    axis = (np.arange(round(SIZE_M / cell) + 1) - round(SIZE_M / cell) // 2) * cell
    x, z = np.meshgrid(axis, axis, indexing="ij")
    return x, z


def _terrain(name: str, heights: Array, cell: float) -> Terrain:
    start = -(len(heights) // 2) * cell
    return Terrain(name, np.ascontiguousarray(heights, np.float32), cell, (start, start))


def _level_start(heights: Array, x: Array, z: Array) -> Array:
    centre = len(heights) // 2
    fraction = smoothstep((np.hypot(x, z) - START_RADIUS_M) / START_EASE_M)
    return (heights - heights[centre, centre]) * fraction


def _noise(n: int, cell: float, wavelength_m: float, seed: int) -> Array:
    """Smooth random field `(n, n)` of unit deviation with bumps about `wavelength_m` apart."""
    white = np.random.default_rng(seed).standard_normal((n, n))
    fx, fz = np.fft.fftfreq(n, cell)[:, None], np.fft.rfftfreq(n, cell)[None, :]
    frequency = np.hypot(fx, fz) * wavelength_m
    band = np.exp(-0.5 * ((frequency - 1.0) / BAND_WIDTH) ** 2) + 0.5 * np.exp(
        -0.5 * (frequency / LOW_BAND_WIDTH) ** 2
    )
    field = np.fft.irfft2(np.fft.rfft2(white) * band, (n, n))
    return (field - field.mean()) / field.std()


def _scale_to_slope(heights: Array, cell: float, degrees: float) -> Array:
    """Scale heights so that the slope of the steepest hundredth of the ground begins at this angle."""
    gx, gz = np.gradient(heights, cell)
    # like `np.percentile`, whose first call imports a package, a twentieth of the start-up time
    slopes = np.hypot(gx, gz).ravel()
    place = STEEPEST_FRACTION * (len(slopes) - 1)
    low = int(place)
    below, above = np.partition(slopes, (low, low + 1))[low : low + 2]
    return heights * (np.tan(np.deg2rad(degrees)) / float(above - (above - below) * (1.0 - (place - low))))
