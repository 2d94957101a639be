"""Limbs of the shown pose near walls: what would be in the ground hangs down, and none turns faster than joints do.

Only what is shown: the network goes on with its own pose. On ground without walls nothing is done here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.scalar_math import MIN_DIVISOR, MIN_SIZE
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain

HANGING_FRACTIONS = np.linspace(0.0, 1.0, 9)  # of the way from the incoming limb to one that hangs
# of the way of one joint, where a limb is looked at that goes round the ground
TURN_FRACTIONS = np.linspace(0.0, 1.0, 7)
SHALLOW_M = 0.25  # that a limb may be in the ground rather than go through it
# radians in a frame, of an arm or a leg: 42 rad/s, faster than a pitcher's forearm
MAX_TURN_RAD_PER_FRAME = 0.7
# and of an arm that is not in a wall: one that came back at once would flicker
MAX_ARM_TURN_RAD_PER_FRAME = 0.15
ARM_TURNS_RAD_PER_FRAME = (MAX_ARM_TURN_RAD_PER_FRAME, MAX_TURN_RAD_PER_FRAME)
_ARMS, _LEGS = [18, 19, 20, 25, 26, 27], [2, 3, 4, 7, 8, 9]
_DOWN = np.array([0.0, -1.0, 0.0])


@dataclass(frozen=True)
class Limb:
    """An arm or a leg that is kept out of walls."""

    upper: int  # joints: of the shoulder or hip,
    lower: int  # of the elbow or knee,
    rest: tuple[int, ...]  # and what follows
    free_m: tuple[float, ...]  # it is kept so far from a wall, or else so far,
    sunk_m: float  # and none of its joints deeper than so much under the ground
    # radians about Y of an elbow or knee that it may hang with; None as it is
    bends: tuple[float | None, ...]
    steps: bool = False  # it goes round ground on its way to where it is less deep
    # radians a frame: the first with which it comes out of the ground
    turns: tuple[float, ...] = (MAX_TURN_RAD_PER_FRAME,)


_LEFT_ARM = Limb(18, 19, (20, 21, 22, 23), (0.2, 0.1, 0.0), 0.1, (0.0, -2.4), turns=ARM_TURNS_RAD_PER_FRAME)
_RIGHT_ARM = replace(_LEFT_ARM, upper=25, lower=26, rest=(27, 28, 29, 30), bends=(0.0, 2.4))
_LEFT_LEG = Limb(2, 3, (4, 5), (0.06, 0.0), 0.2, (0.0, None), steps=True)
LIMBS = (_LEFT_ARM, _RIGHT_ARM, _LEFT_LEG, replace(_LEFT_LEG, upper=7, lower=8, rest=(9, 10)))
# while keyframed: hands hold on to edges, and arms are as fast as they must be
KEYFRAMED = (
    *(replace(arm, free_m=(0.0,), sunk_m=0.15, turns=(MAX_TURN_RAD_PER_FRAME,)) for arm in LIMBS[:2]),
    *LIMBS[2:],
)


def resolve_penetration(
    hips: Array, local: Array, before: Array, terrain: Terrain, limbs: tuple[Limb, ...] = LIMBS
) -> Array:
    """Return local rotations `(31, 4)` whose `limbs` hang down as far as needed to leave the ground.

    `before` are those of the last frame: arms turn by at most `MAX_ARM_TURN_RAD_PER_FRAME`, any limb by at most
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
    """`_tries` with the first of its turns that takes a limb out of the ground, and their `_depths`; else a leg also goes aside."""
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
    """A leg's two rotations `(2, 4)` on its way to the `wanted` ones, where its foot is less deep than the `least` it else is; None where it had better not go."""
    (now, before), moved = poses, [limb.upper, limb.lower]
    goal = now.copy()  # whose foot has come as far as it can
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
    """Metres `(M, N)` by which a limb's deepest joint in `poses` `(N, 31, 3)` is under the ground anywhere up to `free_m` `(M,)` farther from the hips."""
    joints = poses[:, [limb.lower, *limb.rest]]
    out = (joints - hips)[..., [0, 2]]
    out = out / np.maximum(np.sqrt((out * out).sum(-1, keepdims=True)), MIN_SIZE)
    points = joints[..., [0, 2]] + np.array(limb.free_m)[:, None, None, None] * out
    depths = (terrain.height(points[..., 0], points[..., 1]) - joints[..., 1]).max(-1)
    return np.asarray(np.maximum.accumulate(depths[::-1])[::-1])


def _best(depths: Array, turned: Array, limb: Limb) -> int | None:
    """Of N tries that are free of walls at the greatest distance `(M, N)` at which one is, the one `turned` least.

    Else the least deep one; None for an arm that is deep in a wall: it goes on to where it is out of it, deeper at first. A
    leg that did so would stand in the ground.
    """
    for at_distance in depths:
        free = at_distance <= limb.sunk_m
        if free.any():
            return int(np.argmin(np.where(free, turned, np.inf)))
    least = int(np.argmin(depths[-1]))
    stays = limb.steps or depths[-1, least] < SHALLOW_M
    return least if stays else None


def _bend_to_hang_with(terrain: Terrain, hips: Array, local: Array, world: Array, limb: Limb) -> int:
    """Which of its `bends` a limb hangs with in a wall: straight, or where that is deep as it is least deep."""
    goals = _tries(local, local, world, limb, np.inf)[len(HANGING_FRACTIONS) - 1 :: len(HANGING_FRACTIONS)][
        : len(limb.bends)
    ]
    depths = _pose_depths(terrain, limb, hips, goals)[-1]
    return 0 if depths[0] <= SHALLOW_M else int(np.argmin(depths))


def _tries(local: Array, before: Array, world: Array, limb: Limb, most: float) -> Array:
    """Local rotations `(N, 31, 4)` with one limb that hangs more and more, straight or folded, from where it is or was `before`."""
    bone = SPORT_SKELETON.offsets[limb.lower].astype(np.float64)
    along = rotations.normalize(rotations.rotate(world[limb.upper].astype(np.float64), bone))
    down = rotations.multiply(rotations.between(along, _DOWN), world[limb.upper])
    parent = world[SPORT_SKELETON.parents[limb.upper]].astype(np.float64)
    hangs = rotations.multiply(rotations.inverse(parent), down)
    # where neither is free, it goes from where it was as far as it can: one that only stayed would be caught; last straight down
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
    """Local rotations `(18, 4)` with one limb turned from where it was `before` to each side, its lower part both ways or not."""
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
    """The limb's two rotations `(2, 4)` of this frame on the least deep way from where it was `before` to its goal, and how deep that way leads (m).

    Either joint may go ahead of the other: a knee is folded before the thigh is raised, or after.
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
    """For every cell of a grid of depths the deepest on the least deep way onwards to the last cell."""
    deepest = np.full(np.add(depths.shape, 1), np.inf)
    for i in reversed(range(len(depths))):
        for j in reversed(range(len(depths))):
            ahead = min(deepest[i + 1, j], deepest[i, j + 1], deepest[i + 1, j + 1])
            deepest[i, j] = max(depths[i, j], ahead if ahead < np.inf else depths[i, j])
    return deepest[:-1, :-1]


def _turned(before: Array, after: Array, most: float | Array) -> Array:
    """Rotations `(..., 4)` on the way to those `after`, no farther than `most` radians."""
    angle = rotations.angle_between(before, after)
    return rotations.slerp(before, after, np.minimum(1.0, most / np.maximum(angle, MIN_DIVISOR)))


def no_faster(local: Array, before: Array) -> Array:
    """Return local rotations `(31, 4)` with limbs turned by at most `MAX_TURN_RAD_PER_FRAME` since the frame `before`."""
    return _slowed(local, before, _ARMS + _LEGS, MAX_TURN_RAD_PER_FRAME)


def _slowed(local: Array, before: Array, joints: list[int], most: float) -> Array:
    """Local rotations whose `joints` are turned by no more than `most` radians."""
    if rotations.angle_between(before[joints], local[joints]).max() <= most:
        return local
    result = local.copy()
    result[joints] = _turned(before[joints], local[joints], most)
    return result
