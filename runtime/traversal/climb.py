"""Up a wall with hands and feet, and down a drop: the key poses of assets/traversal/climb.toml for a rise or fall of 0.55 to 1.5 m."""

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

GRAVITY = 9.81
STEP_UP_M = 0.68  # up to which the lead foot steps from the ground onto the top
FARTHEST_END_M = 0.28  # behind the edge, where a climber stands up
LANDING_M = 0.52  # behind the edge, where one who got down stands up
DEEPEST_SQUAT_FROM_M = 1.0  # a deeper squat does not fit a leg that still stands on the edge
_TERM = re.compile(r"([+-]?[\d.]*)\*?([a-z_]*)")
_Names = Mapping[str, float]


@lru_cache(1)
def _keys() -> dict[str, Any]:
    return tomllib.loads(asset_path("traversal/climb.toml").read_text(encoding="utf-8"))


def _value(cell: float | str, names: _Names) -> float:
    """A cell of the file: a number, or a sum of numbers, names and products of both."""
    if not isinstance(cell, str):
        return float(cell)
    total = 0.0
    for factor, name in _TERM.findall(cell):
        if factor or name:
            number = float(factor) if factor.strip("+-") else float(factor + "1")
            total += number * names[name] if name else number
    return total


def _motion(kind: str, rise: float, seconds: float, whole: float, names: _Names) -> KeyframedMotion:
    """The key poses of a kind, whose times go to `whole`, with `names` in place of the file's; seconds at tempo 1."""
    keys = _keys()[kind]
    scale = seconds / whole

    def rows(name: str, side: float = 1.0) -> Rows:
        found = [[_value(cell, names) for cell in row] for row in keys[name]]
        return (
            [(*row[:2], side * row[2], *row[3:]) for row in found]
            if name == "hands"
            else [*map(tuple, found)]
        )

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
        stands=both_sides(contacts("lead_stands"), contacts("trail_stands"), scale),
        hands=(timed(rows("hands"), scale), timed(rows("hands", -1.0), scale)),
        elbows=((out, up, ahead), (-out, up, ahead)),
    )


def _climb(rise: float, start: float, end: float) -> KeyframedMotion:
    """Up a wall: heights of the pelvis over a standing one's, and of the hands before they are on the edge."""
    tiptoe, support = 1.02, rise + 0.34  # of a pelvis that leaves the ground, and of one that the arms carry

    def height(fraction: float) -> float:
        return tiptoe + (support - tiptoe) * fraction - STANDING_HIPS_M

    # on tiptoe and on the arms, so that the lead foot passes
    carried = min(0.39 + rise, 1.03) - STANDING_HIPS_M
    over = max(rise + 0.10, min(1.0, rise + 0.3))
    names = {
        "rise": rise, "start": start, "end": end, "carried": carried, "lifted": max(0.04, carried),
        "tiptoe": height(0.0), "hanging": height(0.35), "pulled": height(0.80), "supported": height(1.0),
        # near the second place of the hand: an arm that swings there while its weight is small could turn over
        "over": over, "before": min(over, 1.25),
    }  # fmt: skip
    kind = "step_up" if rise < STEP_UP_M else "pull_up"
    return _motion(kind, rise, 1.5 + 1.5 * (rise - 0.6), 1.0, names)


def _let_down(drop: float, start: float, end: float) -> KeyframedMotion:
    """Squat, step off, free fall to the ground, and as much bending as stops it evenly.

    Heights are those of the pelvis over the upper ground, `t_` the seconds at which it has them.
    """
    k = (drop - 0.55) / 0.95

    def mix(low: float, high: float) -> float:
        return low + (high - low) * k

    crouch = min(drop, DEEPEST_SQUAT_FROM_M) - 0.55
    squat, over = 0.74 - 0.5 * crouch, 0.66 - 0.5 * crouch  # over: in front of the edge, on the trailing foot
    jump = min(1.0, (drop - 0.55) / 0.35)  # 0: the trailing foot carries until the other lands, 1: both fall
    leave = over - 0.11 + 0.08 * jump
    land, low = mix(0.84, 0.76) - drop, mix(0.68, 0.46) - drop
    t_squat = mix(0.45, 0.68)
    t_over = t_squat + mix(0.22, 0.32)
    t_leave = t_over + 0.15 - 0.09 * jump
    speed = (over - leave) / (t_leave - t_over)  # downwards, m/s, where the trailing foot leaves the edge
    landing = sqrt(speed * speed + 2.0 * GRAVITY * max(leave - land, 0.0))
    t_land = t_leave + (landing - speed) / GRAVITY
    t_low = t_land + 2.0 * (land - low) / landing
    seconds = t_low + mix(0.6, 0.8)
    t_follow = t_land + max(0.04, 0.24 - 0.2 * (drop - 0.55) / 0.6)  # when the trailing foot lands
    t_clear, t_passing = (t_leave + fraction * (t_follow - t_leave) for fraction in (0.22, 0.55))
    t_middle = 0.5 * (t_leave + t_land)

    def fallen(t: float) -> float:
        return leave - (t - t_leave) * (speed + 0.5 * GRAVITY * (t - t_leave))

    lowest = 0.06 - drop
    names = {
        "drop": drop, "start": start, "end": end, "seconds": seconds, "hips": STANDING_HIPS_M, "toe": TOE_HEIGHT,
        "squat": squat, "over": over, "leave": leave, "middle": fallen(t_middle), "land": land, "low": low,
        "soft": land + 0.75 * (low - land), "bent": 0.35 + 0.25 * (drop - 0.55) / 0.95, "leave_z": 0.19 - 0.07 * jump,
        "t_squat": t_squat, "t_over": t_over, "t_leave": t_leave, "t_middle": t_middle, "t_land": t_land, "t_low": t_low,
        "t_clear": t_clear, "t_passing": t_passing, "t_follow": t_follow,
        # feet: of the lead one beside the edge, and of both on bent legs in the fall
        "stepping": max(lowest, over - 0.70), "hanging": max(lowest, 0.4 * leave + 0.6 * land - 0.84),
        "passing": max(fallen(t_passing) - 0.72, lowest) + 0.4 * drop,
    }  # fmt: skip
    return _motion("let_down", -drop, seconds, seconds, names)


class _AtTempo:
    """What climbing up and getting down have in common: a keyframed motion at a tempo."""

    def __init__(self, motion: KeyframedMotion, tempo: float) -> None:
        self._motion, self._tempo = motion, tempo
        self.seconds = motion.seconds / tempo
        self.end_z = motion.end_z

    def root_z(self, t: float) -> float:
        """Place of the root along z in metres at `t` seconds."""
        return self._motion.root.at(t * self._tempo)[0]

    def pose(self, t: float, hips: Array, local: Array) -> TraversalPose:
        """The pose at `t` seconds; `hips` `(3,)` and `local` `(31, 4)` are the incoming one, root at `root_z(t)`."""
        return self._motion.pose(min(max(t * self._tempo, 0.0), self._motion.seconds), hips, local)


class Climb(_AtTempo):
    """Up onto a wall: hands on the edge, a foot on top, stand."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        """`rise` metres up from a root at `start_z` < 0; the wall's top is `depth` thick; `tempo` over 1 is faster."""
        super().__init__(_climb(rise, start_z, min(FARTHEST_END_M, 0.5 * depth)), tempo)


class Descend(_AtTempo):
    """Down a drop: squat at the edge, step off, land on bent knees, stand."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        """`rise` < 0 is the drop in metres, from a root at `start_z` < 0; `depth` is not used; `tempo` over 1 is faster."""
        super().__init__(_let_down(-rise, start_z, LANDING_M), tempo)
