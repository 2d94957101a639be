"""Loops: the best cycle of a steady walk, with its two ends blended into one pose."""

from dataclasses import replace

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.easing import smoothstep
from runtime.errors import UsageError
from runtime.feet.ik import LEG_FEET, LEG_SHINS, LEG_THIGHS, LEG_TOES, solve_legs
from runtime.feet.skating import SOLE_POINTS
from runtime.motion import features
from runtime.takes.clip import Clip
from runtime.takes.footplants import stretches
from runtime.takes.metadata import LoopReport
from runtime.takes.root import RootTrack

MIN_CYCLE_S, MAX_CYCLE_S = 0.5, 3.0
MIN_SPEED_M_PER_S = 0.15  # of the root in a cycle
VELOCITY_S = 0.1  # weight of velocity: a difference of 1 m/s counts as this many metres
SOLE_WEIGHT = 4.0  # of ankle and toe heights, so that standing feet match at both ends
NEAR_CYCLE_FACTOR = 1.15  # cycles whose lengths differ by less have the same number of strides
# the shortest cycle whose cost is within this factor of the best: one cycle, not two
NEARLY_BEST_FACTOR = 1.25
MAX_ENDS_M, MAX_ENDS_RAD = 0.15, np.deg2rad(40.0)  # limits of two ends that can be blended
MAX_STARTS = 1800  # limit of first frames that are compared
SWING_FRACTION = 0.35  # of a foot's highest speed, above which it is in swing
_LEGS = np.concatenate([LEG_THIGHS, LEG_SHINS, LEG_FEET])
_REMEDY = "Record, or choose as the range, at least two full cycles of a steady walk in one style."


def make_loop(clip: Clip, root: RootTrack, strides: int = 1) -> tuple[Clip, RootTrack]:
    """Return the best cycle of `strides` strides as a clip that loops, and its root; the last frame continues into the first.

    Raises UsageError if there is no steady walk, or too little of it.
    """
    first, last = find_cycle(clip, root, strides)
    cycle, track = clip.trim(first, last), root.cut(first, last)
    ends_m, ends_radians = seam_error(cycle, track)
    if ends_m > MAX_ENDS_M or ends_radians > MAX_ENDS_RAD:
        gap = f"{ends_m * 100:.0f} cm and {np.rad2deg(ends_radians):.0f} degrees"
        raise UsageError(f": no steady walk; the most similar frames are {gap} apart.", _REMEDY, "loop")
    closed = close_seam(cycle, track)
    seam_m, seam_radians = seam_error(closed, track)
    degrees, seam_degrees = float(np.rad2deg(ends_radians)), float(np.rad2deg(seam_radians))
    apart, seam, step, usual = (metres * 100.0 for metres in (ends_m, seam_m, *seam_steps(closed, track)))
    report = LoopReport(first, last, closed.seconds, apart, degrees, seam, seam_degrees, step, usual)
    return replace(closed, loop=report), track


def find_cycle(clip: Clip, root: RootTrack, strides: int = 1) -> tuple[int, int]:
    """Return the first and last frame of the cycle with the most similar ends; UsageError if the clip is too short or stands.

    A cycle of several `strides` is that many times as long as the best single one, within `NEAR_CYCLE_FACTOR`.
    """
    least, most = (round(seconds * clip.fps) for seconds in (MIN_CYCLE_S, MAX_CYCLE_S))
    cycle = _best_cycle(clip, root, least, most, NEARLY_BEST_FACTOR)
    if strides == 1:
        return cycle
    lag = strides * (cycle[1] - cycle[0])
    spare = round(lag * (NEAR_CYCLE_FACTOR - 1.0) / strides)
    return _best_cycle(clip, root, lag - spare, lag + spare, 1.0)


def _best_cycle(clip: Clip, root: RootTrack, least: int, most: int, nearly: float) -> tuple[int, int]:
    """Return the shortest cycle of `least` to `most` frames whose cost is at most `nearly` times the best one's."""
    lags = np.arange(least, min(most, len(clip) - 3) + 1)
    if len(lags) == 0:
        problem = f": the range lasts {clip.seconds:.1f} s, and {least / clip.fps:.1f} s are needed."
        raise UsageError(problem, _REMEDY, "loop")
    shape = _shape(clip, root)
    path = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(root.positions, axis=0), axis=1))])
    costs, starts = np.full(len(lags), np.inf), np.zeros(len(lags), np.int64)
    for k, lag in enumerate(lags.tolist()):
        stride = max(1, (len(clip) - lag) // MAX_STARTS)
        a = np.arange(1, len(clip) - lag - 1, stride)
        cost = np.sqrt(np.mean((shape[a + lag] - shape[a]) ** 2, axis=(1, 2)))
        cost += np.abs(root.yaw[a + lag] - root.yaw[a]) * 0.05
        cost[path[a + lag] - path[a] < MIN_SPEED_M_PER_S * lag / clip.fps] = np.inf
        if len(a) and np.isfinite(cost).any():
            costs[k], starts[k] = cost.min(), a[np.argmin(cost)]
    if not np.isfinite(costs).any():
        raise UsageError(": the character does not walk in this range.", _REMEDY, "loop")
    good = costs <= costs.min() * nearly + 1e-4
    shortest = np.flatnonzero(good)[0]
    # the best neighbour of that cycle
    near = np.flatnonzero(good & (lags <= lags[shortest] * NEAR_CYCLE_FACTOR))
    best = near[np.argmin(costs[near])]
    return int(starts[best]), int(starts[best] + lags[best])


def _shape(clip: Clip, root: RootTrack) -> Array:
    """Return joints relative to the root and their weighted velocities `(T, 31, 6)`."""
    positions, _ = clip.world()
    positions = positions.astype(np.float64)
    velocities = np.gradient(positions, axis=0) * clip.fps * VELOCITY_S
    seen = features.to_root(positions - root.positions[:, None], root.yaw[:, None])
    seen[:, list(SOLE_POINTS), 1] *= SOLE_WEIGHT
    return np.concatenate([seen, features.to_root(velocities, root.yaw[:, None])], axis=-1)


def seam_error(cycle: Clip, root: RootTrack) -> tuple[float, float]:
    """Return the largest joint distance (metres) and angle (radians) between last and first frame, relative to the root."""
    positions, world = cycle.world()
    ends = [0, -1]
    seen = features.to_root(positions[ends] - root.positions[ends][:, None], root.yaw[ends][:, None])
    turned = rotations.multiply(rotations.from_yaw(-root.yaw[ends])[:, None], world[ends])
    distance = np.linalg.norm(seen[1] - seen[0], axis=-1).max()
    return float(distance), float(rotations.angle_between(turned[0], turned[1]).max())


def seam_steps(cycle: Clip, root: RootTrack) -> tuple[float, float]:
    """Return the largest jump of a joint's motion between frames (metres), at the seam and elsewhere in the cycle."""
    positions, _ = cycle.world()
    steps = np.diff(positions.astype(np.float64), axis=0)
    seen = features.to_root(steps, root.yaw[:-1, None])
    first = features.to_root(steps[0], root.yaw[0])
    last = features.to_root(steps[-1], root.yaw[-1])
    inside = np.linalg.norm(np.diff(seen, axis=0), axis=-1).max() if len(seen) > 1 else 0.0
    return float(np.linalg.norm(first - last, axis=-1).max()), float(inside)


def close_seam(cycle: Clip, root: RootTrack) -> Clip:
    """Return the cycle with its last frame made equal to its first.

    The difference is spread over the cycle: for the body over all frames, for each foot only while it swings, so that a
    foot on the ground keeps its place. The legs reach their feet by inverse kinematics.
    """
    hips, local = np.array(cycle.hips_positions, np.float64), np.array(cycle.local_rotations, np.float64)
    positions, world = cycle.world()
    n = len(cycle) - 1
    body = smoothstep(np.arange(n + 1) / n)
    turn = rotations.from_yaw(root.yaw[-1] - root.yaw[0])  # from the first frame to the last

    def goal(points: Array) -> Array:
        return root.positions[-1] + rotations.rotate(turn, points - root.positions[0])

    wanted = local[0].copy()
    wanted[0] = rotations.multiply(turn, local[0, 0])
    new_hips = hips + body[:, None] * (goal(hips[0]) - hips[-1])
    new_local = _toward(local, wanted, np.tile(body[:, None], (1, local.shape[1])))
    ankles, feet = positions[:, LEG_FEET].astype(np.float64), world[:, LEG_FEET].astype(np.float64)
    swing = np.stack(
        [_swing_ease(positions, ankle, toe) for ankle, toe in zip(LEG_FEET, LEG_TOES, strict=True)], 1
    )
    targets = ankles + swing[..., None] * (goal(ankles[0]) - ankles[-1])
    feet_goal = _world_toward(feet, rotations.multiply(turn, feet[0]), swing)
    new_local[:, LEG_TOES] = _toward(local[:, LEG_TOES], wanted[LEG_TOES], swing)
    solved = led_legs((new_hips, new_local), (targets, feet_goal), (hips, local), (ankles, feet))
    solved[-1], new_hips[-1] = wanted, goal(hips[0])
    contacts = cycle.contacts.copy()
    contacts[-1] = contacts[0]
    return cycle.posed(new_hips, rotations.normalize(solved), contacts)


Pair = tuple[Array, Array]


def led_legs(body: Pair, feet: Pair, old_body: Pair, old_feet: Pair) -> Array:
    """Return local rotations with legs that reach `feet`: hips `(T, 3)` with rotations, ankles `(T, 2, 3)` with rotations.

    Changes that the solver makes even to the old pose are undone, since it bends almost straight legs.
    """
    solved, eased = solve_legs(*body, *feet), solve_legs(*old_body, *old_feet)
    change = rotations.multiply(rotations.inverse(eased[:, _LEGS]), old_body[1][:, _LEGS])
    solved[:, _LEGS] = rotations.multiply(solved[:, _LEGS], change)
    return solved


def _toward(q: Array, wanted: Array, fraction: Array) -> Array:
    """Return rotations `(T, n, 4)` with a `fraction` `(T, n)` of the last frame's error to `wanted` `(n, 4)` added from the right."""
    lacks = rotations.to_rotation_vector(rotations.multiply(rotations.inverse(q[-1]), wanted))
    return rotations.multiply(q, rotations.from_rotation_vector(fraction[..., None] * lacks))


def _world_toward(q: Array, wanted: Array, fraction: Array) -> Array:
    """Return the same with the difference applied from the left, about world axes."""
    lacks = rotations.to_rotation_vector(rotations.multiply(wanted, rotations.inverse(q[-1])))
    return rotations.multiply(rotations.from_rotation_vector(fraction[..., None] * lacks), q)


def _swing_ease(positions: Array, ankle: int, toe: int) -> Array:
    """Return an ease from 0 to 1 `(T,)` over the longest stretch in which neither ankle nor toe of a foot rests."""
    way = np.linalg.norm(np.diff(positions[:, [ankle, toe]][..., [0, 2]].astype(np.float64), axis=0), axis=-1)
    speed = way.min(axis=1)
    swings = stretches(speed > SWING_FRACTION * max(float(speed.max()), 1e-6))
    first, last = max(swings, key=lambda swing: swing[1] - swing[0], default=(0, len(speed)))
    return smoothstep((np.arange(len(positions)) - first) / max(last - first, 1))
