"""Random ground: relief that does not touch footsteps, and hills and stairs for clips captured on a floor."""

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.takes.footplants import stretches
from training.data.clips import CELL_M, FLAT_MARGIN_M, Patches, grid_under
from training.data.foot_cleaning import bridge
from training.data.labels import FOOT_JOINTS
from training.data.retarget import speed

EXTRA_PATCHES = 2
_CLEAR_M = 0.22  # distance of relief from a footstep, more than a cell's diagonal
_BLEND_M = 0.5  # distance over which relief grows to full height
_MAX_SLOPE = np.tan(np.deg2rad(20.0))
_RELIEF_CELL_M = 0.1
_STAIRS_MAX_SPEED = 1.7  # m/s


def smooth_noise(
    shape: tuple[int, int], cell: float, wavelength: float, generator: np.random.Generator
) -> Array:
    """Return smooth random heights of unit deviation with features of about `wavelength` metres."""
    from scipy.ndimage import gaussian_filter

    pad = int(np.ceil(wavelength / cell))
    noise = generator.standard_normal((shape[0] + 2 * pad, shape[1] + 2 * pad))
    field = gaussian_filter(noise, 0.25 * wavelength / cell)[pad : pad + shape[0], pad : pad + shape[1]]
    return (field - field.mean()) / max(float(field.std()), 1e-6)


def fit_around_steps(
    positions: Array, contacts: NDArray[np.uint8], generator: np.random.Generator
) -> Patches:
    """Return patches for a clip on level ground: one level, the others random relief that fits every footstep."""
    origin, shape = grid_under(positions, FLAT_MARGIN_M)
    distance, _ = _nearest_step(positions, contacts, origin, shape, CELL_M)
    weight = smoothstep((distance - _CLEAR_M) / _BLEND_M)
    heights = np.zeros((1 + EXTRA_PATCHES, *shape))
    for patch in heights[1:]:
        relief = sum(
            smooth_noise(shape, CELL_M, wavelength, generator) * amount
            for wavelength, amount in ((4.0, 0.6), (1.5, 0.3), (0.7, 0.1))
        )
        if generator.random() < 0.35:
            step = generator.uniform(0.1, 0.2)
            relief = np.round(relief / step) * step
        patch[:] = relief * generator.uniform(0.1, 0.4) * weight
    return Patches(heights, origin, CELL_M)


def ground_from_contacts(positions: Array, contacts: NDArray[np.uint8]) -> Patches:
    """Reconstruct ground from contacts: the height of the nearest one, slightly smoothed."""
    from scipy.ndimage import gaussian_filter

    origin, shape = grid_under(positions, FLAT_MARGIN_M, _RELIEF_CELL_M)
    _, (frame, joint) = _nearest_step(positions, contacts, origin, shape, _RELIEF_CELL_M)
    rest = np.array([ANKLE_HEIGHT, TOE_HEIGHT, ANKLE_HEIGHT, TOE_HEIGHT])
    heights = positions[frame, np.array(FOOT_JOINTS)[joint], 1] - rest[joint]
    return Patches(gaussian_filter(heights, 0.6)[None], origin, _RELIEF_CELL_M)


def hills_or_stairs(
    positions: Array, contacts: NDArray[np.uint8], generator: np.random.Generator
) -> tuple[Patches, str]:
    """Return random ground under a clip captured on a floor, and its kind; stairs only for walks."""
    fast = float(speed(positions[:, 0] * np.array([1.0, 0.0, 1.0])).mean()) > _STAIRS_MAX_SPEED
    origin, shape = grid_under(positions, FLAT_MARGIN_M + 1.0, _RELIEF_CELL_M)
    if fast or generator.random() < 0.6:
        waves = smooth_noise(shape, _RELIEF_CELL_M, generator.uniform(3.0, 7.0), generator)
        waves = waves + generator.uniform(0.0, 0.25) * smooth_noise(shape, _RELIEF_CELL_M, 1.5, generator)
        slope = np.hypot(*np.gradient(waves, _RELIEF_CELL_M))
        steepest = _MAX_SLOPE * generator.uniform(0.4, 1.0)
        return Patches((waves * steepest / np.percentile(slope, 98))[None], origin, _RELIEF_CELL_M), "hills"
    heights = _stairs(origin, shape, positions, generator)
    return Patches(
        _level_under_feet(heights, origin, positions, contacts)[None], origin, _RELIEF_CELL_M
    ), "stairs"


def _stairs(
    origin: tuple[float, float], shape: tuple[int, int], positions: Array, generator: np.random.Generator
) -> Array:
    """Return flights of stairs up and down across the clip's main direction."""
    x = origin[0] + np.arange(shape[0])[:, None] * _RELIEF_CELL_M
    z = origin[1] + np.arange(shape[1])[None, :] * _RELIEF_CELL_M
    moves = np.diff(positions[::10, 0][:, [0, 2]], axis=0)
    # main axis of travel; angles are doubled so that opposite directions agree
    angle = 0.5 * np.angle(np.sum((moves[:, 0] + 1j * moves[:, 1]) ** 2) + 1e-9) + generator.normal(0.0, 0.2)
    along = x * np.cos(angle) + z * np.sin(angle) + generator.uniform(0.0, 3.0)
    rise, tread = generator.uniform(0.15, 0.18), generator.uniform(0.28, 0.36)
    steps = int(generator.integers(3, 9))
    period = 2 * (steps * tread + 1.2)  # a flight, a landing, and down again
    ramp = np.abs((along / period) % 1.0 - 0.5) * period - 0.6
    return np.clip(np.ceil(ramp / tread), 0, steps) * rise


def _level_under_feet(
    heights: Array, origin: tuple[float, float], positions: Array, contacts: NDArray[np.uint8]
) -> Array:
    """Widen treads so that no foot stands across an edge."""
    feet = positions[:, FOOT_JOINTS][..., [0, 2]]
    level = np.zeros((len(positions), 4))
    for side in range(2):
        planted = np.any(contacts[:, 2 * side : 2 * side + 2], axis=1)
        for start, end in stretches(planted):
            middle = feet[start:end, 2 * side : 2 * side + 2].mean((0, 1))
            i, j = np.round((middle - origin) / _RELIEF_CELL_M).astype(int)
            level[start:end, 2 * side : 2 * side + 2] = heights[i, j]
    distance, (frame, joint) = _nearest_step(positions, contacts, origin, heights.shape, _RELIEF_CELL_M)
    weight = smoothstep((distance - 0.12) / 0.12)
    return heights * weight + level[frame, joint] * (1.0 - weight)


def root_lift(positions: Array, contacts: NDArray[np.uint8], patches: Patches) -> Array:
    """Return the height `(T,)` by which the body rises on the new ground: mean of its footholds, smoothed over time."""
    from scipy.ndimage import gaussian_filter1d

    terrain = patches.terrain()
    feet = positions[:, FOOT_JOINTS]
    under = terrain.height(feet[..., 0], feet[..., 2]).astype(np.float64)
    sides = []
    for side in range(2):
        pair = slice(2 * side, 2 * side + 2)
        planted = np.any(contacts[:, pair], axis=1)
        if not planted.any():
            planted = np.ones(len(planted), bool)
        sides.append(bridge(under[:, pair].mean(1, keepdims=True), planted, hold_slope=False)[:, 0])
    return gaussian_filter1d(np.mean(sides, axis=0), 9.0)


def _nearest_step(
    positions: Array,
    contacts: NDArray[np.uint8],
    origin: tuple[float, float],
    shape: tuple[int, ...],
    cell: float,
) -> tuple[Array, tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return the distance in metres from every cell to the nearest contact, and its (frame, foot joint).

    Points between heel and toe are included, so that the whole sole is covered.
    """
    from scipy.ndimage import distance_transform_edt

    frame, joint = np.nonzero(contacts)
    if not len(frame):
        frame, joint = np.arange(len(positions)), np.zeros(len(positions), np.int64)
    feet = positions[:, FOOT_JOINTS][..., [0, 2]]
    owner = np.full(shape, -1, np.int64)
    for towards_other in (0.5, 0.0):
        point = feet[frame, joint] * (1 - towards_other) + feet[frame, joint ^ 1] * towards_other
        i, j = np.round((point - np.array(origin)) / cell).astype(np.int64).T
        owner[np.clip(i, 0, shape[0] - 1), np.clip(j, 0, shape[1] - 1)] = np.arange(len(frame))
    distance, (i, j) = distance_transform_edt(owner < 0, return_indices=True)
    nearest = owner[i, j]
    return distance * cell, (frame[nearest], joint[nearest])
