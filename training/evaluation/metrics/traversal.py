"""Measures of obstacle traversals: penetration, clearance, beam contacts, hands on edges, pace, flight."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.feet import skating as feet
from runtime.motion.features import FPS
from runtime.takes.footplants import stretches
from runtime.terrain.courses import Obstacle
from runtime.terrain.height_map import Terrain

Mask = NDArray[np.bool_]

MARGIN_M = 0.5  # before and behind an obstacle, included in its traversal
TOLERANCE_M = 0.005  # smaller depths do not count as penetration
DEEP_M = 0.03
# Limits for a path that passes every check: depth of soles, joints and limbs, and joint acceleration; captured jogs
# reach 470.
DEEPEST_SOLE_M, DEEPEST_JOINT_M, DEEPEST_LIMB_M = 0.02, 0.015, 0.035
MAX_ACCELERATION_M_PER_S2 = 600.0
# Detects figures that glide in one pose, or stand instead of walking: their feet hardly move relative to the root. In a
# walk they do so at about the speed of the root.
FROZEN_FRACTION = 0.25  # of the requested speed, mean over a second
HANDS = (22, 29)
HAND_REACH_M, HAND_M_PER_S = 0.10, 0.3  # distance and speed of a hand that holds an edge
OFF_BEAM_M = 0.1  # below the beam's top: a foot standing this low is off the beam
FLIGHT_M, FLIGHT_S = 0.03, 0.08  # height of both soles above ground or last support, and duration


def traversal_frames(xz: Array, obstacle: Obstacle) -> Mask:
    """Return frames `(T,)` in which a root `(T, 2)` is on an obstacle or within `MARGIN_M` of it."""
    along = (xz[:, 1] > obstacle.begin - MARGIN_M) & (xz[:, 1] < obstacle.end + MARGIN_M)
    return along & (np.abs(xz[:, 0]) < obstacle.half_width + MARGIN_M)


def depths(positions: Array, terrain: Terrain, traversal: Mask) -> dict[str, float]:
    """Measure penetration of soles (vertical), joints and limbs over the frames `traversal`: cm, and fractions of frames."""
    chosen = positions[traversal]
    if not len(chosen):
        return {}
    soles = feet.joint_heights(chosen, terrain, feet.SOLE_POINTS) - np.array(feet.SOLE_HEIGHTS)
    joints = depth_inside(chosen, terrain)
    result = {
        "sole_p99": 100.0 * max(0.0, float(np.percentile(-soles, 99))),
        "joint_max": 100.0 * float(joints.max()),
        "joint_inside": float((joints > TOLERANCE_M).mean(0).max()),  # the worst joint's fraction
        "joint_deep": float((joints > DEEP_M).mean(0).max()),
    }
    for name, values in limb_depths(chosen, terrain).items():
        result[f"{name}_p99"] = 100.0 * float(np.percentile(values, 99))
        result[f"{name}_deep"] = float((values > DEEP_M).mean())
    return result


def first_problem(
    positions: Array, ground: Terrain, most_acceleration: float = MAX_ACCELERATION_M_PER_S2
) -> str:
    """Return the first check that a motion of world joints `(T, 31, 3)` fails, or "".

    Checks are the depth of soles, joints and limbs (shortest way out of the ground), and joint acceleration, m/s^2.
    """
    positions = positions.astype(np.float64)
    if depth_inside(_soles(positions), ground).max() > DEEPEST_SOLE_M:
        return "soles"
    if depth_inside(positions, ground).max() > DEEPEST_JOINT_M:
        return "joints"
    if max(float(depth.max()) for depth in limb_depths(positions, ground).values()) > DEEPEST_LIMB_M:
        return "limbs"
    acceleration = np.linalg.norm(np.diff(positions, 2, axis=0), axis=-1) * FPS * FPS
    return "thrown" if acceleration.max() > most_acceleration else ""


def clearances(positions: Array, obstacles: Sequence[Obstacle]) -> list[float]:
    """Return the minimum height (cm) of each foot's sole above the top of each obstacle, while over it; 0 stands on it.

    Obstacles that a foot never passes over are omitted.
    """
    soles = _soles(positions)
    result = []
    for obstacle in obstacles:
        over = obstacle.raised(soles[..., 0], soles[..., 2])
        heights = np.where(over, soles[..., 1] - obstacle.top, np.inf).min(0)
        result += [100.0 * float(h) for h in heights.reshape(2, 2).min(1) if np.isfinite(h)]
    return result


def _soles(positions: Array) -> Array:
    """Return the four points of the soles `(T, 4, 3)`: heels and toes minus their resting heights."""
    soles = positions[:, feet.SOLE_POINTS].astype(np.float64)
    soles[..., 1] -= feet.SOLE_HEIGHTS
    return soles


def beam_contacts(positions: Array, contacts: Array, beam: Obstacle, ramp_m: float) -> tuple[int, int]:
    """Count contacts on a beam and off it, of points of the feet between its ramps."""
    soles = _soles(positions)
    between = _between(soles, beam, ramp_m) & (contacts > 0.5)
    on = between & (np.abs(soles[..., 0]) <= beam.half_width)
    return int(on.sum()), int(between.sum() - on.sum())


def falls(positions: Array, contacts: Array, beam: Obstacle, ramp_m: float) -> int:
    """Count how often all standing feet are below the top of a beam, between its ramps."""
    soles = _soles(positions)
    stands = (contacts > 0.5) & _between(soles, beam, ramp_m)
    low = soles[..., 1] < beam.top - OFF_BEAM_M
    off = stands.any(1) & (low | ~stands).all(1)
    return int((np.diff(off.astype(int), prepend=0) == 1).sum())


def _between(soles: Array, beam: Obstacle, ramp_m: float) -> Mask:
    return (soles[..., 2] > beam.begin + ramp_m) & (soles[..., 2] < beam.end - ramp_m)


def hands_on_edge(positions: Array, walls: Sequence[Obstacle]) -> list[float]:
    """Return the time in seconds for which both hands rest on the near edge of each wall."""
    hands = positions[:, list(HANDS)].astype(np.float64)
    speed = np.linalg.norm(np.gradient(hands, axis=0), axis=-1) * FPS
    result = []
    for wall in walls:
        away = np.hypot(hands[..., 2] - wall.begin, hands[..., 1] - wall.top)
        within = (np.abs(hands[..., 0]) <= wall.half_width) & (away < HAND_REACH_M) & (speed < HAND_M_PER_S)
        result.append(float(within.all(1).sum()) / FPS)
    return result


def seconds_over(xz: Array, obstacle: Obstacle) -> tuple[float, float] | None:
    """Return the time from `MARGIN_M` before an obstacle to `MARGIN_M` behind it, and the lowest speed (m/s, over half a second).

    None if the root does not get over it.
    """
    entered = np.flatnonzero(xz[:, 1] > obstacle.begin - MARGIN_M)
    left = np.flatnonzero(xz[:, 1] > obstacle.end + MARGIN_M)
    if not len(entered) or not len(left):
        return None
    begin, end = int(entered[0]), int(left[0])
    half = FPS // 2
    track = xz[max(0, begin - half) : end + 1].astype(np.float64)
    speed = np.linalg.norm(track[half:] - track[:-half], axis=-1) * FPS / half
    return (end - begin) / FPS, float(speed.min()) if len(speed) else float("nan")


def on_top_after(positions: Array, wall: Obstacle) -> float | None:
    """Return the time from `MARGIN_M` before a wall until both feet are above its top; None if they never are."""
    near = np.flatnonzero(positions[:, 0, 2] > wall.begin - MARGIN_M)
    toes = positions[:, list(feet.TOES)]
    up = np.flatnonzero(((toes[..., 2] > wall.begin) & (toes[..., 1] > wall.top - 0.02)).all(1))
    return float(up[0] - near[0]) / FPS if len(near) and len(up) and up[0] > near[0] else None


def flights(positions: Array, contacts: Array, gaps: Sequence[tuple[Obstacle, Obstacle]]) -> tuple[int, int]:
    """Count, of the gaps passed, those crossed in flight and those into which no foot stepped."""
    soles = _soles(positions)
    flown = missed = 0
    for first, second in gaps:
        in_gap = (soles[..., 2] > first.end + 0.03) & (soles[..., 2] < second.begin - 0.03)
        low = soles[..., 1] < min(first.top, second.top) - OFF_BEAM_M
        missed += int(not (in_gap & low & (contacts > 0.5)).any())
        around = (positions[:, 0, 2] > first.end - 0.5) & (positions[:, 0, 2] < second.begin + 0.5)
        under = np.where(soles[..., 2] < 0.5 * (first.end + second.begin), first.top, second.top)
        high = (soles[..., 1] - under > FLIGHT_M).all(1)
        flown += any(last - begin >= round(FLIGHT_S * FPS) for begin, last in stretches(high & around))
    return flown, missed


def frozen_seconds(positions: Array, xz: Array, requested: Array) -> int:
    """Count seconds with foot speed relative to the root below `FROZEN_FRACTION` of the requested speed (m/s)."""
    root = np.stack([xz[:, 0], np.zeros(len(xz)), xz[:, 1]], -1)
    speed = np.linalg.norm(np.diff(_soles(positions) - root[:, None], axis=0), axis=-1).mean(1) * FPS
    whole = len(speed) // FPS
    moved = speed[: whole * FPS].reshape(whole, FPS).mean(1)
    wanted = np.asarray(requested)[: whole * FPS].reshape(whole, FPS)
    return int(((wanted > 0.3).all(1) & (moved < FROZEN_FRACTION * wanted.mean(1))).sum())


def mean_of(rows: Sequence[dict[str, Any]], key: str) -> float:
    """Return the mean of a measure over the rows that have it, or NaN."""
    values = [row[key] for row in rows if row.get(key) is not None]
    return float(np.mean(values)) if values else float("nan")


# limbs as capsules: joints at both ends, and radius in metres
CAPSULES: dict[str, tuple[tuple[int, int, float], ...]] = {
    "thighs": ((2, 3, 0.06), (7, 8, 0.06)),
    "shins": ((3, 4, 0.045), (8, 9, 0.045)),
    "hands": ((20, 22, 0.03), (27, 29, 0.03)),
}
DIRECTIONS, STEP_M, FARTHEST_M = 16, 0.01, 0.8
STATIONS = (0.0, 0.25, 0.5, 0.75, 1.0)  # along a capsule
AROUND = 8  # surface points at each station


def depth_inside(points: Array, terrain: Terrain) -> Array:
    """Return the depth in metres of points `(..., 3)` below the nearest surface, 0 outside; at most `FARTHEST_M`."""
    flat = np.asarray(points, np.float64).reshape(-1, 3)
    down = terrain.height(flat[:, 0], flat[:, 2]) - flat[:, 1]
    inside = np.flatnonzero(down > 0.0)
    depth = np.zeros(len(flat))
    if len(inside):
        depth[inside] = _to_surface(flat[inside], down[inside], terrain)
    return depth.reshape(np.shape(points)[:-1])


def _to_surface(points: Array, down: Array, terrain: Terrain) -> Array:
    """Return the shortest distance out of the ground for points inside it: up, sideways, or both."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    compass = np.stack([np.cos(angle), np.sin(angle)], -1)
    nearest = np.minimum(down, FARTHEST_M).astype(np.float64)
    for radius in np.arange(STEP_M, FARTHEST_M, STEP_M):
        left = np.flatnonzero(nearest > radius)
        if not len(left):
            break
        xz = points[left, None][..., [0, 2]] + radius * compass
        up = np.maximum(terrain.height(xz[..., 0], xz[..., 1]) - points[left, 1:2], 0.0).min(1)
        nearest[left] = np.minimum(nearest[left], np.hypot(radius, up))
    return nearest


def capsule_points(positions: Array, first: int, last: int, radius: float) -> Array:
    """Return points `(T, 40, 3)` on the surface of the capsule between two joints of world positions `(T, 31, 3)`."""
    a, b = (positions[:, j].astype(np.float64) for j in (first, last))
    axis = b - a
    axis /= np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-9)
    helper = np.where(np.abs(axis[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    v = np.cross(axis, u)
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ring = np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]
    at = a[:, None] + np.array(STATIONS)[:, None] * (b - a)[:, None]
    return (at[:, :, None] + radius * ring[:, None]).reshape(len(positions), -1, 3)


def limb_depths(positions: Array, terrain: Terrain) -> dict[str, Array]:
    """Return the depth `(T,)` in metres of the deepest point of each kind of limb in `CAPSULES`."""
    return {
        name: np.max(
            [depth_inside(capsule_points(positions, *ends), terrain).max(1) for ends in pairs], axis=0
        )
        for name, pairs in CAPSULES.items()
    }
