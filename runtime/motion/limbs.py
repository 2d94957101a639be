"""Limbs of the shown pose near walls: a limb that would be in the ground hangs down, within the usual joint speeds.

Only the shown pose changes: the network is fed its own. Ground without walls needs none of this.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.scalar_math import MIN_DIVISOR, MIN_SIZE
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain

HANGING_FRACTIONS = np.linspace(0.0, 1.0, 9)  # interpolation from the incoming limb to a hanging one
# interpolation of each joint on a way around the ground
TURN_FRACTIONS = np.linspace(0.0, 1.0, 7)
SHALLOW_M = 0.25  # depth up to which a limb may stay in the ground rather than pass through it
# per frame, arms and legs: 42 rad/s, faster than a pitcher's forearm
MAX_TURN_RAD_PER_FRAME = 0.7
# of an arm that is not in a wall: returning at once, it would flicker
MAX_ARM_TURN_RAD_PER_FRAME = 0.15
ARM_TURNS_RAD_PER_FRAME = (MAX_ARM_TURN_RAD_PER_FRAME, MAX_TURN_RAD_PER_FRAME)
_ARMS, _LEGS = [18, 19, 20, 25, 26, 27], [2, 3, 4, 7, 8, 9]
_DOWN = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True)
class Limb:
    """An arm or a leg that is kept out of walls."""

    upper: int  # joint indices: shoulder or hip,
    lower: int  # elbow or knee,
    rest: tuple[int, ...]  # and all below
    free_m: tuple[float, ...]  # distance kept from a wall, in order of preference
    sunk_m: float  # how deep its joints may be under the ground
    # elbow or knee angles (radians about Y) of the hanging limb; None keeps it
    bends: tuple[float | None, ...]
    steps: bool = False  # it may move around the ground to a shallower position
    # radians per frame, tried in this order until it leaves the ground
    turns: tuple[float, ...] = (MAX_TURN_RAD_PER_FRAME,)


_LEFT_ARM = Limb(18, 19, (20, 21, 22, 23), (0.2, 0.1, 0.0), 0.1, (0.0, -2.4), turns=ARM_TURNS_RAD_PER_FRAME)
_RIGHT_ARM = replace(_LEFT_ARM, upper=25, lower=26, rest=(27, 28, 29, 30), bends=(0.0, 2.4))
_LEFT_LEG = Limb(2, 3, (4, 5), (0.06, 0.0), 0.2, (0.0, None), steps=True)
LIMBS = (_LEFT_ARM, _RIGHT_ARM, _LEFT_LEG, replace(_LEFT_LEG, upper=7, lower=8, rest=(9, 10)))
# in keyframed motion hands hold on to edges, and arms may be as fast as needed
KEYFRAMED = (
    *(replace(arm, free_m=(0.0,), sunk_m=0.15, turns=(MAX_TURN_RAD_PER_FRAME,)) for arm in LIMBS[:2]),
    *LIMBS[2:],
)


def resolve_penetration(
    hips: Array, local: Array, before: Array, terrain: Terrain, limbs: tuple[Limb, ...] = LIMBS
) -> Array:
    """Return local rotations `(31, 4)` whose `limbs` hang down as far as needed to leave the ground.

    `before` is the last frame: arms turn by at most `MAX_ARM_TURN_RAD_PER_FRAME`, any limb by at most
    `MAX_TURN_RAD_PER_FRAME`.
    """
    result = _slowed(no_faster(local, before), before, _ARMS, limbs[0].turns[0])
    positions, world = SPORT_SKELETON.forward_kinematics(hips, result)
    for limb in limbs:
        if _depths(terrain, limb, positions[None], positions[0]).max() <= limb.sunk_m:
            continue
        tries, depths = _tried(terrain, hips, (result, before), world, limb)
        result, moved = result.copy(), [limb.upper, limb.lower]
        round_it = (
            _stepped(terrain, hips, (result, before), local, limb, depths[-1].min()) if limb.steps else None
        )
        if round_it is not None:
            result[moved] = round_it
            continue
        turned = rotations.angle_between(before[moved], tries[:, moved]).sum(-1)
        best = _best(depths, turned, limb)
        if best is None:
            best = -len(HANGING_FRACTIONS) * (1 + _bend_to_hang_with(terrain, hips, result, world, limb))
        result[moved] = tries[best][moved]
    return result


def _tried(
    terrain: Terrain, hips: Array, poses: tuple[Array, Array], world: Array, limb: Limb
) -> tuple[Array, Array]:
    """Return `_tries` and `_depths` at the first turn limit that frees the limb from the ground; else a leg also steps aside."""
    for most in limb.turns:
        tries = _tries(*poses, world, limb, most)
        depths = _pose_depths(terrain, limb, hips, tries)
        if depths[-1].min() <= limb.sunk_m:
            return tries, depths
    if limb.steps:
        tries = np.concatenate([tries, _aside(*poses, limb)])
        depths = _pose_depths(terrain, limb, hips, tries)
    return tries, depths


def _stepped(
    terrain: Terrain, hips: Array, poses: tuple[Array, Array], wanted: Array, limb: Limb, least: float
) -> Array | None:
    """Return a leg's two rotations `(2, 4)` towards the `wanted` ones if its foot gets less deep than `least`, else None."""
    (now, before), moved = poses, [limb.upper, limb.lower]
    goal = now.copy()  # the pose that the foot could reach
    goal[moved] = wanted[moved]
    if _pose_depths(terrain, limb, hips, goal[None])[-1, 0] >= max(least, limb.sunk_m):
        return None
    round_it, deepest = _way_round(terrain, hips, before, goal, limb)
    return round_it if least > limb.sunk_m or deepest <= SHALLOW_M else None


def _pose_depths(terrain: Terrain, limb: Limb, hips: Array, local: Array) -> Array:
    """`_depths` of the local rotations `(N, 31, 4)`."""
    placed, _ = SPORT_SKELETON.forward_kinematics(np.broadcast_to(hips, (len(local), 3)), local)
    return _depths(terrain, limb, placed, placed[0, 0])


def _depths(terrain: Terrain, limb: Limb, poses: Array, hips: Array) -> Array:
    """Return the depth `(M, N)` (m) of a limb's deepest joint in `poses` `(N, 31, 3)` under ground up to `free_m` `(M,)` outwards."""
    joints = poses[:, [limb.lower, *limb.rest]]
    out = (joints - hips)[..., [0, 2]]
    out = out / np.maximum(np.sqrt((out * out).sum(-1, keepdims=True)), MIN_SIZE)
    points = joints[..., [0, 2]] + np.array(limb.free_m)[:, None, None, None] * out
    depths = (terrain.height(points[..., 0], points[..., 1]) - joints[..., 1]).max(-1)
    return np.asarray(np.maximum.accumulate(depths[::-1])[::-1])


def _best(depths: Array, turned: Array, limb: Limb) -> int | None:
    """Return which of N tries is free of walls at the greatest possible distance (of depths `(M, N)`) and `turned` least.

    If none is free, the least deep one; None for an arm deep in a wall, which may pass through it to the other side. A leg
    doing so would stand in the ground.
    """
    for at_distance in depths:
        free = at_distance <= limb.sunk_m
        if free.any():
            return int(np.argmin(np.where(free, turned, np.inf)))
    least = int(np.argmin(depths[-1]))
    stays = limb.steps or depths[-1, least] < SHALLOW_M
    return least if stays else None


def _bend_to_hang_with(terrain: Terrain, hips: Array, local: Array, world: Array, limb: Limb) -> int:
    """Return the index of the bend with which a limb hangs in a wall: straight, or the least deep one if that is deep."""
    goals = _tries(local, local, world, limb, np.inf)[len(HANGING_FRACTIONS) - 1 :: len(HANGING_FRACTIONS)][
        : len(limb.bends)
    ]
    depths = _pose_depths(terrain, limb, hips, goals)[-1]
    return 0 if depths[0] <= SHALLOW_M else int(np.argmin(depths))


def _tries(local: Array, before: Array, world: Array, limb: Limb, most: float) -> Array:
    """Return local rotations `(N, 31, 4)` with a limb hanging more and more, straight or bent, from its incoming and last pose."""
    bone = SPORT_SKELETON.offsets[limb.lower].astype(np.float64)
    along = rotations.normalize(rotations.rotate(world[limb.upper].astype(np.float64), bone))
    down = rotations.multiply(rotations.between(along, _DOWN), world[limb.upper])
    parent = world[SPORT_SKELETON.parents[limb.upper]].astype(np.float64)
    hangs = rotations.multiply(rotations.inverse(parent), down)
    # if neither is free, it moves from its last pose as far as it can, so as not to be trapped; the last try hangs straight
    ways = [(local, bend, HANGING_FRACTIONS) for bend in limb.bends]
    ways += [(before, bend, HANGING_FRACTIONS[::-1]) for bend in limb.bends[::-1]]
    tries = np.tile(np.asarray(local, np.float64), (len(ways) * len(HANGING_FRACTIONS), 1, 1))
    for k, (start, bend, fractions) in enumerate(ways):
        part = slice(k * len(fractions), (k + 1) * len(fractions))
        bent = start[limb.lower] if bend is None else rotations.from_yaw(bend)
        for joint, goal in ((limb.upper, hangs), (limb.lower, bent)):
            tries[part, joint] = _turned(before[joint], rotations.slerp(start[joint], goal, fractions), most)
    return tries


def _aside(local: Array, before: Array, limb: Limb) -> Array:
    """Return local rotations `(18, 4)` with one limb turned from its last pose in six directions, each with three bends."""
    turns = rotations.from_rotation_vector(MAX_TURN_RAD_PER_FRAME * np.concatenate([np.eye(3), -np.eye(3)]))
    tries = np.tile(np.asarray(local, np.float64), (18, 1, 1))
    tries[:, limb.upper] = np.repeat(rotations.multiply(turns, before[limb.upper]), 3, axis=0)
    bends = rotations.from_rotation_vector(
        np.array([[-MAX_TURN_RAD_PER_FRAME, 0, 0], [0, 0, 0], [MAX_TURN_RAD_PER_FRAME, 0, 0]])
    )
    tries[:, limb.lower] = np.tile(rotations.multiply(before[limb.lower], bends), (6, 1))
    return tries


def _way_round(
    terrain: Terrain, hips: Array, before: Array, wanted: Array, limb: Limb
) -> tuple[Array, float]:
    """Return a limb's rotations `(2, 4)` in this frame on the shallowest way from `before` to its goal, and that depth (m).

    Either joint may move first: the knee folds before the thigh rises, or after.
    """
    moved, count = [limb.upper, limb.lower], len(TURN_FRACTIONS)
    grid = np.tile(np.asarray(wanted, np.float64), (count * count, 1, 1))
    upper, lower = (rotations.slerp(before[j], wanted[j], TURN_FRACTIONS) for j in moved)
    grid[:, limb.upper], grid[:, limb.lower] = np.repeat(upper, count, axis=0), np.tile(lower, (count, 1))
    depths = _pose_depths(terrain, limb, hips, grid)[-1].reshape(count, count)
    deepest = _deepest_on(depths)
    turns = np.maximum(rotations.angle_between(before[moved], wanted[moved]), MIN_DIVISOR)
    at, fraction = (0, 0), np.zeros(2)
    while at != (count - 1, count - 1):
        steps = [
            (i, j)
            for i, j in ((at[0] + 1, at[1] + 1), (at[0] + 1, at[1]), (at[0], at[1] + 1))
            if max(i, j) < count
        ]
        goal = min(steps, key=lambda cell: deepest[cell])
        there = TURN_FRACTIONS[list(goal)]
        room = (MAX_TURN_RAD_PER_FRAME / turns - fraction) / np.maximum(there - fraction, MIN_DIVISOR)
        part = float(np.where(there > fraction, room, 1.0).min())
        fraction = fraction + min(max(part, 0.0), 1.0) * (there - fraction)
        if part < 1.0:
            break
        at = goal
    return rotations.slerp(before[moved], wanted[moved], fraction), float(deepest[0, 0])


def _deepest_on(depths: Array) -> Array:
    """Return, for every cell of a grid of depths, the maximum depth on the shallowest way from it to the last cell."""
    deepest = np.full(np.add(depths.shape, 1), np.inf)
    for i in reversed(range(len(depths))):
        for j in reversed(range(len(depths))):
            ahead = min(deepest[i + 1, j], deepest[i, j + 1], deepest[i + 1, j + 1])
            deepest[i, j] = max(depths[i, j], ahead if ahead < np.inf else depths[i, j])
    return deepest[:-1, :-1]


def _turned(before: Array, after: Array, most: float | Array) -> Array:
    """Return rotations `(..., 4)` from `before` towards `after`, turned by at most `most` radians."""
    angle = rotations.angle_between(before, after)
    return rotations.slerp(before, after, np.minimum(1.0, most / np.maximum(angle, MIN_DIVISOR)))


def no_faster(local: Array, before: Array) -> Array:
    """Return local rotations `(31, 4)` with limbs turned by at most `MAX_TURN_RAD_PER_FRAME` since the frame `before`."""
    return _slowed(local, before, _ARMS + _LEGS, MAX_TURN_RAD_PER_FRAME)


def _slowed(local: Array, before: Array, joints: list[int], most: float) -> Array:
    """Return local rotations whose `joints` have turned by at most `most` radians."""
    if rotations.angle_between(before[joints], local[joints]).max() <= most:
        return local
    result = local.copy()
    result[joints] = _turned(before[joints], local[joints], most)
    return result
