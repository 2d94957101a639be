"""Climbing up a wall with hands and feet, and down a drop: the key poses of assets/traversal/climb.toml for 0.55 to 1.5 m."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import lru_cache
from math import sqrt
from typing import Any

from runtime.arrays import Array
from runtime.assets import asset_path
from runtime.skeleton import TOE_HEIGHT
from runtime.traversal.keyframes import (
    STANDING_HIPS_M,
    KeyframedMotion,
    Rows,
    TraversalPose,
    both_sides,
    stands,
    timed,
)

GRAVITY_M_PER_S2 = 9.81
STEP_UP_M = 0.68  # rise up to which the lead foot steps from the ground onto the top
MAX_END_M = 0.28  # behind the edge, where a climber stands up
LANDING_M = 0.52  # behind the edge, where a character stands up after getting down
DEEPEST_SQUAT_FROM_M = 1.0  # a deeper squat is impossible for a leg that still stands on the edge
SHALLOWEST_M, DEEPEST_M = 0.55, 1.5  # range of heights with key poses

# Climb up, tuned by eye: heights of the pelvis over the ground, and of hands, metres.
CLIMB_S, CLIMB_S_PER_M, CLIMB_M = 1.5, 1.5, 0.6  # duration up to this height, and per further metre
TIPTOE_HIPS_M, ON_ARMS_M = 1.02, 0.34  # when leaving the ground; over the edge, when the arms carry the body
CARRIED_M, MAX_CARRIED_HIPS_M, MIN_LIFT_M = 0.39, 1.03, 0.04  # over the edge, so that the lead foot can pass
HANGING_FRACTION, PULLED_FRACTION = 0.35, 0.8  # of the way from tiptoe to resting on the arms
HANDS_OVER_EDGE_M, HANDS_REACH_M = (0.1, 0.3), (1.0, 1.25)  # until they are on the edge

# Climb down, tuned by eye. In pairs the first value is for the shallowest drop, the second for the deepest one.
SQUAT_S, STEP_OFF_S, STAND_UP_S = (0.45, 0.68), (0.22, 0.32), (0.6, 0.8)
LANDING_HIPS_M, LOWEST_HIPS_M, BENT_FRACTION = (0.84, 0.76), (0.68, 0.46), (0.35, 0.6)
SQUAT_HIPS_M, OVER_EDGE_HIPS_M, CROUCH_FRACTION = 0.74, 0.66, 0.5  # lowered by this fraction of a deeper drop
JUMP_M = 0.35  # beyond the shallowest drop: from there both feet fall; up to there the trailing one carries
LEAVE_S, LEAVE_M, LEAVE_Z_M = (0.15, -0.09), (-0.11, 0.08), (0.19, -0.07)  # added by a jump
FOLLOW_S, FOLLOW_S_PER_M, MIN_FOLLOW_S = 0.24, (0.2, 0.6), 0.04  # from the first landing foot to the other
CLEAR_FRACTION, PASSING_FRACTION = 0.22, 0.55  # of the trailing foot's way down
SOFT_FRACTION, HANGING_LAND_FRACTION, PASSING_DROP_FRACTION = 0.75, 0.6, 0.4
LOWEST_ANKLE_M = 0.06  # above the lower ground
STEPPING_LEG_M, HANGING_LEG_M, PASSING_LEG_M = 0.7, 0.84, 0.72  # from the pelvis to a foot
_TERM = re.compile(r"([+-]?[\d.]*)\*?([a-z_]*)")
_Names = Mapping[str, float]


@lru_cache(1)
def _keys() -> dict[str, Any]:
    return tomllib.loads(asset_path("traversal/climb.toml").read_text(encoding="utf-8"))


def _value(cell: float | str, names: _Names) -> float:
    """Evaluate a cell of the file: a number, or a sum of numbers, names and their products."""
    if not isinstance(cell, str):
        return float(cell)
    total = 0.0
    for factor, name in _TERM.findall(cell):
        if factor or name:
            number = float(factor) if factor.strip("+-") else float(factor + "1")
            total += number * names[name] if name else number
    return total


def _motion(kind: str, rise: float, seconds: float, whole: float, names: _Names) -> KeyframedMotion:
    """Return the key poses of a kind, stretched to `whole` seconds, with `names` substituted; seconds are at tempo 1."""
    keys = _keys()[kind]
    scale = seconds / whole

    def rows(name: str, side: float = 1.0) -> Rows:
        found = [[_value(cell, names) for cell in row] for row in keys[name]]
        if name == "hands":
            found = [[*row[:2], side * row[2], *row[3:]] for row in found]
        return [*map(tuple, found)]

    def contacts(name: str) -> Rows:
        spans = ({k: _value(cell, names) for k, cell in span.items()} for span in keys[name])
        return [row for span in spans for row in stands(**span, whole=whole)]

    out, up, ahead = keys["elbows"]
    return KeyframedMotion(
        seconds,
        names["start"],
        names["end"],
        rise,
        root=timed(rows("root"), scale),
        body=timed(rows("body"), scale),
        level=timed(rows("level"), scale),
        feet=both_sides(rows("lead"), rows("trail"), scale),
        arms=timed(rows("arms"), scale),
        stands=both_sides(contacts("lead_stands"), contacts("trail_stands"), scale),
        hands=(timed(rows("hands"), scale), timed(rows("hands", -1.0), scale)),
        elbows=((out, up, ahead), (-out, up, ahead)),
    )


def _climb(rise: float, start: float, end: float) -> KeyframedMotion:
    """Climb up a wall; pelvis heights are relative to standing, hand heights apply until the hands are on the edge."""
    support = rise + ON_ARMS_M

    def height(fraction: float) -> float:
        return TIPTOE_HIPS_M + (support - TIPTOE_HIPS_M) * fraction - STANDING_HIPS_M

    # on tiptoe and on the arms, so that the lead foot can pass
    carried = min(CARRIED_M + rise, MAX_CARRIED_HIPS_M) - STANDING_HIPS_M
    over = max(rise + HANDS_OVER_EDGE_M[0], min(HANDS_REACH_M[0], rise + HANDS_OVER_EDGE_M[1]))
    names = {
        "rise": rise, "start": start, "end": end, "carried": carried, "lifted": max(MIN_LIFT_M, carried),
        "tiptoe": height(0.0), "hanging": height(HANGING_FRACTION), "pulled": height(PULLED_FRACTION), "supported": height(1.0),
        # near the second hand position: an arm that swings there at low weight could flip
        "over": over, "before": min(over, HANDS_REACH_M[1]),
    }  # fmt: skip
    kind = "step_up" if rise < STEP_UP_M else "pull_up"
    return _motion(kind, rise, CLIMB_S + CLIMB_S_PER_M * (rise - CLIMB_M), 1.0, names)


def _let_down(drop: float, start: float, end: float) -> KeyframedMotion:
    """Squat, step off, free fall to the ground, and bend the legs for an even deceleration.

    Heights are those of the pelvis over the upper ground, `t_` their times in seconds.
    """
    deeper = drop - SHALLOWEST_M
    k = deeper / (DEEPEST_M - SHALLOWEST_M)

    def mix(ends: tuple[float, float]) -> float:
        return ends[0] + (ends[1] - ends[0]) * k

    crouch = CROUCH_FRACTION * (min(drop, DEEPEST_SQUAT_FROM_M) - SHALLOWEST_M)
    # over: in front of the edge, on the trailing foot
    squat, over = SQUAT_HIPS_M - crouch, OVER_EDGE_HIPS_M - crouch
    jump = min(1.0, deeper / JUMP_M)  # 0: the trailing foot carries until the other lands, 1: both fall
    leave = over + LEAVE_M[0] + LEAVE_M[1] * jump
    land, low = mix(LANDING_HIPS_M) - drop, mix(LOWEST_HIPS_M) - drop
    t_squat = mix(SQUAT_S)
    t_over = t_squat + mix(STEP_OFF_S)
    t_leave = t_over + LEAVE_S[0] + LEAVE_S[1] * jump
    speed = (over - leave) / (t_leave - t_over)  # m/s downwards when the trailing foot leaves the edge
    landing = sqrt(speed * speed + 2.0 * GRAVITY_M_PER_S2 * max(leave - land, 0.0))
    t_land = t_leave + (landing - speed) / GRAVITY_M_PER_S2
    t_low = t_land + 2.0 * (land - low) / landing
    seconds = t_low + mix(STAND_UP_S)
    # when the trailing foot lands
    t_follow = t_land + max(MIN_FOLLOW_S, FOLLOW_S - FOLLOW_S_PER_M[0] * deeper / FOLLOW_S_PER_M[1])
    t_clear, t_passing = (
        t_leave + fraction * (t_follow - t_leave) for fraction in (CLEAR_FRACTION, PASSING_FRACTION)
    )
    t_middle = 0.5 * (t_leave + t_land)

    def fallen(t: float) -> float:
        return leave - (t - t_leave) * (speed + 0.5 * GRAVITY_M_PER_S2 * (t - t_leave))

    lowest = LOWEST_ANKLE_M - drop
    hanging = (1.0 - HANGING_LAND_FRACTION) * leave + HANGING_LAND_FRACTION * land - HANGING_LEG_M
    names = {
        "drop": drop, "start": start, "end": end, "seconds": seconds, "hips": STANDING_HIPS_M, "toe": TOE_HEIGHT,
        "squat": squat, "over": over, "leave": leave, "middle": fallen(t_middle), "land": land, "low": low,
        "soft": land + SOFT_FRACTION * (low - land), "bent": mix(BENT_FRACTION), "leave_z": LEAVE_Z_M[0] + LEAVE_Z_M[1] * jump,
        "t_squat": t_squat, "t_over": t_over, "t_leave": t_leave, "t_middle": t_middle, "t_land": t_land, "t_low": t_low,
        "t_clear": t_clear, "t_passing": t_passing, "t_follow": t_follow,
        # feet: the lead foot beside the edge, and both on bent legs in the fall
        "stepping": max(lowest, over - STEPPING_LEG_M), "hanging": max(lowest, hanging),
        "passing": max(fallen(t_passing) - PASSING_LEG_M, lowest) + PASSING_DROP_FRACTION * drop,
    }  # fmt: skip
    return _motion("let_down", -drop, seconds, seconds, names)


class Climb:
    """A keyframed climb onto a wall (hands on the edge, a foot on top, stand) or down a drop (squat, step off, land, stand)."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        """`rise` is in metres, negative for down; the root starts at `start_z` < 0.

        `depth` is the thickness of a wall's top, unused for a drop; `tempo` above 1 is faster.
        """
        if rise > 0.0:
            self._motion = _climb(rise, start_z, min(MAX_END_M, 0.5 * depth))
        else:
            self._motion = _let_down(-rise, start_z, LANDING_M)
        self._tempo = tempo
        self.seconds = self._motion.seconds / tempo
        self.end_z = self._motion.end_z

    def root_z(self, t: float) -> float:
        """Return the root's z (metres) at `t` seconds."""
        return self._motion.root.at(t * self._tempo)[0]

    def pose(self, t: float, hips: Array, local: Array) -> TraversalPose:
        """Return the pose at `t` seconds; `hips` `(3,)` and `local` `(31, 4)` are the incoming pose, root at `root_z(t)`."""
        return self._motion.pose(min(max(t * self._tempo, 0.0), self._motion.seconds), hips, local)
