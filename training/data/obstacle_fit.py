"""Obstacles that fit captured motion: a hurdle under a leap, a gap under a flight, a platform under a jump up, a beam.

Nothing of the motion is changed: the ground is, where no foot stands. What is raised stays under all that passes over
it, what is lowered is stood on by nobody.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.skeleton import ANKLE_HEIGHT, TOE_HEIGHT
from runtime.terrain.height_map import Terrain
from training.data.height_patches import Patches, grid_under
from training.data.labels import FOOT_JOINTS, smooth
from training.data.retarget import FPS

Mask = NDArray[np.bool_]

CELL_M = 0.05
HALF_WIDTH_M = 0.6  # of a hurdle or gap to each side of the way
BAR_HALF_M = 0.05
PASSING_M = 0.06  # before and behind a bar in which feet must already be over it: they move so far in a frame
UNDER_M = 0.03  # that a bar stays under what passes over it
LOWEST_BAR_M, HIGHEST_BAR_M = 0.10, 0.8
SHORTEST_GAP_M, GAP_EDGE_M = 0.45, 0.05
FLIGHT_FRAMES = 5
LEVELS_APART_M = 0.12  # heights of footholds that belong to two platforms
BEAM_HALF_M, BEAM_LENGTH_M, BEAM_EDGE_M = 0.16, 2.0, 0.04
APART_M = 1.0  # between two obstacles
_REST = np.array([ANKLE_HEIGHT, TOE_HEIGHT, ANKLE_HEIGHT, TOE_HEIGHT])
_KNEES, _KNEE_RADIUS_M = (3, 8), 0.06


@dataclass(frozen=True)
class Fitted:
    """One obstacle across the way at `place` (x, z): `size` is its height, a gap's length, or a beam's width; metres."""

    kind: str  # "hurdle", "gap", "platform" or "beam"
    place: tuple[float, float]
    ahead: tuple[float, float]  # unit vector of the way
    half_length: float  # along the way
    half_width: float
    rise: float  # of the ground: below 0 where it is lowered
    size: float
    frame: int  # in which the hips are over it

    def local(self, xz: Array) -> tuple[Array, Array]:
        """Points `(..., 2)` along the way and to its left, from the middle."""
        away = xz - np.array(self.place)
        along = away @ np.array(self.ahead)
        return along, away @ np.array([self.ahead[1], -self.ahead[0]])

    def words(self) -> str:
        """What it is, for captions."""
        size = f"{100.0 * self.size:.0f} cm"
        return {
            "hurdle": f"over a hurdle of {size}",
            "gap": f"over a gap of {size}",
            "platform": f"{'onto' if self.rise > 0 else 'down from'} a platform of {size}",
            "beam": f"along a beam of {size}",
        }[self.kind]


def fit_obstacles(
    positions: Array, contacts: NDArray[np.uint8], ground: Terrain, generator: np.random.Generator
) -> list[Fitted]:
    """Obstacles under world joints `(T, 31, 3)`, best first by kind: hurdles, gaps, then a beam where there is neither."""
    xz = smooth(positions[:, 0][:, [0, 2]], 0.3)
    found = _apart(_hurdles(positions, contacts, ground, xz), [])
    found += _apart(_gaps(positions, contacts, xz, generator), found)
    return found or _beams(positions, contacts, xz, generator)


def raised(fits: Sequence[Fitted], positions: Array, ground: Terrain, margin: float = 2.0) -> Patches:
    """The ground under a clip with obstacles on it, as one patch."""
    origin, shape = grid_under(positions, margin, CELL_M)
    x = origin[0] + np.arange(shape[0])[:, None] * CELL_M
    z = origin[1] + np.arange(shape[1])[None, :] * CELL_M
    x, z = np.broadcast_arrays(x, z)
    heights = ground.height(x, z).astype(np.float64)
    points = np.stack([x, z], -1)
    for fit in fits:
        along, aside = fit.local(points)
        within = np.abs(along) <= fit.half_length + 1e-6
        if fit.kind == "beam":  # the ground beside it is lowered
            within &= (np.abs(aside) > fit.half_width) & (np.abs(aside) < fit.half_width + 1.0)
        else:
            within &= np.abs(aside) <= fit.half_width
        heights = np.where(within, heights + fit.rise, heights)
    return Patches(heights[None], origin, CELL_M)


def platform_ground(positions: Array, contacts: NDArray[np.uint8]) -> tuple[Patches, list[Fitted]]:
    """Ground with upright edges where the footholds of a clip lie on several levels, and the steps between them."""
    from scipy.ndimage import distance_transform_edt

    frame, joint = np.nonzero(contacts)
    origin, shape = grid_under(positions, 2.0, CELL_M)
    if not len(frame):
        return Patches(np.zeros((1, *shape)), origin, CELL_M), []
    feet = positions[:, FOOT_JOINTS]
    level = _levels(feet[frame, joint, 1] - _REST[joint])
    owner = np.full(shape, -1, np.int64)
    i, j = np.round((feet[frame, joint][:, [0, 2]] - np.array(origin)) / CELL_M).astype(np.int64).T
    owner[i, j] = np.arange(len(frame))
    nearest = distance_transform_edt(owner < 0, return_distances=False, return_indices=True)
    heights = level[owner[tuple(nearest)]]
    _under_swing(heights, origin, feet)
    by_frame = np.full(len(positions), np.nan)
    by_frame[frame] = level
    return Patches(heights[None], origin, CELL_M), _steps(positions, by_frame)


def _levels(heights: Array) -> Array:
    """Every height as the mean of its cluster; clusters lie `LEVELS_APART_M` apart."""
    order = np.argsort(heights)
    cluster = np.zeros(len(heights), np.int64)
    cluster[order[1:]] = np.cumsum(np.diff(heights[order]) > LEVELS_APART_M)
    means = np.bincount(cluster, heights) / np.bincount(cluster)
    return means[cluster]


def _under_swing(heights: Array, origin: tuple[float, float], feet: Array) -> None:
    """Lower cells that a passing foot would hit to the next level that it does not."""
    levels = np.unique(heights)
    points = feet.reshape(-1, 3)
    sole = points[:, 1] - np.tile(_REST, len(feet)) + 0.03
    i, j = np.round((points[:, [0, 2]] - np.array(origin)) / CELL_M).astype(np.int64).T
    free = np.searchsorted(levels, sole, side="right") - 1
    lowest = np.full(heights.shape, np.inf)
    np.minimum.at(lowest, (i, j), levels[np.maximum(free, 0)])
    np.minimum(heights, lowest, out=heights)


def _steps(positions: Array, by_frame: Array) -> list[Fitted]:
    """Changes of level between footholds, where they happen; `by_frame` is NaN in the air."""
    known = np.flatnonzero(~np.isnan(by_frame))
    result = []
    for a, b in pairwise(known):
        rise = float(by_frame[b] - by_frame[a])
        if abs(rise) > LEVELS_APART_M and b - a >= FLIGHT_FRAMES:
            middle = int(a + b) // 2
            place, ahead = _way(positions[:, 0][:, [0, 2]], int(a), int(b))
            result.append(Fitted("platform", place, ahead, 0.0, 0.0, rise, abs(rise), middle))
    return result


def _way(xz: Array, first: int, last: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Middle and direction of the way from one frame to another."""
    step = xz[last] - xz[first]
    ahead = step / max(float(np.linalg.norm(step)), 1e-6)
    middle = 0.5 * (xz[last] + xz[first])
    return (float(middle[0]), float(middle[1])), (float(ahead[0]), float(ahead[1]))


def _passing(positions: Array, ground: Terrain) -> tuple[Array, Array]:
    """XZ `(N, 2)` and height over the ground `(N,)` of soles and knees in all frames, between frames as well."""
    feet = positions[:, FOOT_JOINTS].astype(np.float64) - np.stack([0 * _REST, _REST, 0 * _REST], -1)
    middle = 0.5 * (feet[:, [0, 2]] + feet[:, [1, 3]])
    knees = positions[:, _KNEES].astype(np.float64) - np.array([0.0, _KNEE_RADIUS_M, 0.0])
    points = np.concatenate([feet, middle, knees], axis=1)
    points = np.concatenate([points[:-1], 0.5 * (points[:-1] + points[1:])]).reshape(-1, 3)
    return points[:, [0, 2]], points[:, 1] - ground.height(points[:, 0], points[:, 2])


def _hurdles(positions: Array, contacts: NDArray[np.uint8], ground: Terrain, xz: Array) -> list[Fitted]:
    """Bars under everything that passes, at every third frame's place, the highest first."""
    points, heights = _passing(positions, ground)
    result = []
    reach = FPS // 6
    for frame in range(reach, len(xz) - reach, 3):
        place, ahead = _way(xz, frame - reach, frame + reach)
        if np.linalg.norm(xz[frame + reach] - xz[frame - reach]) < 0.4 * 2 * reach / FPS:
            continue  # hardly moves: nothing is crossed
        bar = Fitted("hurdle", place, ahead, BAR_HALF_M, HALF_WIDTH_M, 0.0, 0.0, frame)
        along, aside = bar.local(points)
        over = (np.abs(along) < BAR_HALF_M + PASSING_M) & (np.abs(aside) < HALF_WIDTH_M)
        size = float(heights[over].min()) - UNDER_M if over.any() else 0.0
        if LOWEST_BAR_M <= size <= HIGHEST_BAR_M:
            size = float(np.floor(100.0 * size)) / 100.0
            result.append(Fitted("hurdle", place, ahead, BAR_HALF_M, HALF_WIDTH_M, size, size, frame))
    return sorted(result, key=lambda f: (-f.size, f.frame))


def _gaps(
    positions: Array, contacts: NDArray[np.uint8], xz: Array, generator: np.random.Generator
) -> list[Fitted]:
    """Gaps under flights, from behind the last foothold to before the next, the longest first."""
    air = np.concatenate([[False], contacts.sum(1) == 0, [False]]).astype(int)
    starts, ends = np.flatnonzero(np.diff(air) == 1), np.flatnonzero(np.diff(air) == -1)
    feet = positions[:, FOOT_JOINTS][..., [0, 2]].astype(np.float64)
    held = contacts.astype(bool)
    result = []
    for start, end in zip(starts, ends, strict=True):
        if end - start < FLIGHT_FRAMES or start == 0 or end == len(contacts):
            continue
        place, ahead = _way(xz, int(start) - 1, int(end))
        flight = Fitted("gap", place, ahead, 0.0, HALF_WIDTH_M, 0.0, 0.0, int(start + end) // 2)
        along, aside = flight.local(feet)
        near = held & (np.abs(aside) < HALF_WIDTH_M + 0.1)
        behind, before = along[near & (along < 0.0)], along[near & (along >= 0.0)]
        if not len(behind) or not len(before):
            continue
        first, last = float(behind.max()) + GAP_EDGE_M, float(before.min()) - GAP_EDGE_M
        if last - first >= SHORTEST_GAP_M:
            middle = np.array(place) + 0.5 * (first + last) * np.array(ahead)
            depth = float(generator.uniform(0.4, 1.2))
            at = (float(middle[0]), float(middle[1]))
            half = 0.5 * (last - first)
            result.append(Fitted("gap", at, ahead, half, HALF_WIDTH_M, -depth, 2.0 * half, flight.frame))
    return sorted(result, key=lambda f: (-f.size, f.frame))


def _beams(
    positions: Array, contacts: NDArray[np.uint8], xz: Array, generator: np.random.Generator
) -> list[Fitted]:
    """A beam under the longest straight stretch on which all footholds lie in a narrow line; at most one."""
    feet = positions[:, FOOT_JOINTS][..., [0, 2]].astype(np.float64)
    held = contacts.astype(bool)
    best: list[Fitted] = []
    for seconds in (6, 4, 2):
        length = seconds * FPS
        for first in range(0, len(xz) - length, FPS // 2):
            place, ahead = _way(xz, first, first + length)
            way = float(np.linalg.norm(xz[first + length] - xz[first]))
            if way < BEAM_LENGTH_M:
                continue
            line = Fitted("beam", place, ahead, 0.5 * way, 0.0, 0.0, 0.0, first + length // 2)
            along, aside = line.local(feet)
            on = held & (np.abs(along) <= 0.5 * way + 0.1) & (np.abs(aside) < 1.3)
            half = float(np.abs(aside[on]).max()) + BEAM_EDGE_M if on.any() else 1.0
            if half <= BEAM_HALF_M:
                drop = -float(generator.uniform(0.2, 0.6))
                best.append(Fitted("beam", place, ahead, 0.5 * way, half, drop, 2.0 * half, line.frame))
        if best:
            return sorted(best, key=lambda f: f.half_width)[:1]
    return []


def _apart(candidates: Sequence[Fitted], kept: Sequence[Fitted]) -> list[Fitted]:
    """The first of `candidates` that lie `APART_M` from each other and from `kept`."""
    chosen: list[Fitted] = []
    for fit in candidates:
        others = [*kept, *chosen]
        if all(
            np.hypot(*np.subtract(fit.place, o.place)) > APART_M + fit.half_length + o.half_length
            for o in others
        ):
            chosen.append(fit)
    return chosen
