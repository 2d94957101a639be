"""The keys of getting down a drop: seconds, metres and radians in the crossing's frame."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from runtime.crossing.keyed_motion import (
    GROUND,
    STANDING_HIPS_M,
    TOP,
    KeyedMotion,
    Rows,
    both_sides,
    stands,
    timed,
)
from runtime.crossing.keyed_pose import Track
from runtime.skeleton import TOE_HEIGHT

GRAVITY = 9.81
HEEL_AFTER_S = 0.06  # the toes land first
DEEPEST_SQUAT_FROM_M = 1.0  # a deeper squat does not fit a leg that still stands on the edge
ELBOWS = ((0.6, 0.2, -0.6), (-0.6, 0.2, -0.6))


@dataclass(frozen=True)
class _Fall:
    """Heights of the pelvis (metres over the upper ground) and the seconds at which it has them."""

    squat: float
    over: float  # in front of the edge, on the trailing foot
    leave: float
    land: float
    low: float
    t_squat: float
    t_over: float
    t_leave: float
    t_land: float
    t_low: float
    seconds: float
    speed: float  # downwards, m/s, where the trailing foot leaves the edge
    leave_z: float  # metres behind the edge there

    def fallen(self, t: float) -> float:
        """Height of the pelvis at `t` seconds of the fall."""
        since = t - self.t_leave
        return self.leave - since * (self.speed + 0.5 * GRAVITY * since)


def _fall(drop: float) -> _Fall:
    """Squat, step off, free fall to the ground, and as much bending as stops it evenly."""
    k = (drop - 0.55) / 0.95

    def mix(low: float, high: float) -> float:
        return low + (high - low) * k

    crouch = min(drop, DEEPEST_SQUAT_FROM_M) - 0.55
    squat, over = 0.74 - 0.5 * crouch, 0.66 - 0.5 * crouch
    jump = min(1.0, (drop - 0.55) / 0.35)  # 0: the trailing foot carries until the other lands, 1: both fall
    leave = over - 0.11 + 0.08 * jump
    land, low = mix(0.84, 0.76) - drop, mix(0.68, 0.46) - drop
    t_squat = mix(0.45, 0.68)
    t_over = t_squat + mix(0.22, 0.32)
    t_leave = t_over + 0.15 - 0.09 * jump
    speed = (over - leave) / (t_leave - t_over)
    landing = sqrt(speed * speed + 2.0 * GRAVITY * max(leave - land, 0.0))
    t_land = t_leave + (landing - speed) / GRAVITY
    t_low = t_land + 2.0 * (land - low) / landing
    return _Fall(
        squat,
        over,
        leave,
        land,
        low,
        t_squat,
        t_over,
        t_leave,
        t_land,
        t_low,
        t_low + mix(0.6, 0.8),
        speed,
        0.19 - 0.07 * jump,
    )


def let_down(drop: float, start: float, end: float) -> KeyedMotion:
    """A drop of 0.55 to 1.5 m, from a root at `start` to one at `end` (z, metres)."""
    f = _fall(drop)
    follow = f.t_land + max(0.04, 0.24 - 0.2 * (drop - 0.55) / 0.6)  # when the trailing foot lands
    root: Rows = [
        (0, start),
        (f.t_squat, -0.20),
        (f.t_over, 0.06),
        (f.t_leave, f.leave_z),
        (f.t_land, 0.9 * end),
        (f.t_low, 0.97 * end),
        (f.seconds, end),
    ]
    lead, trail = _feet(drop, f, follow)
    whole = f.seconds
    lead_stands = [
        *stands(0, f.t_squat - 0.05, whole=whole),
        *stands(f.t_land, whole, whole=whole, heel_on=f.t_land + HEEL_AFTER_S),
    ]
    trail_stands = [
        *stands(0, 0.10, whole=whole),
        *stands(0.38, 0.5 * (0.38 + f.t_squat), f.t_leave, whole=whole),
        *stands(follow, whole, whole=whole, heel_on=follow + HEEL_AFTER_S),
    ]
    return KeyedMotion(
        whole,
        start,
        end,
        -drop,
        root=timed(root, 1.0),
        body=timed(_body(drop, f), 1.0),
        level=timed([(0, 0), (f.t_squat, 1), (f.t_low, 1), (whole, 0)], 1.0),
        feet=both_sides(lead, trail, 1.0),
        stands=both_sides(lead_stands, trail_stands, 1.0),
        hands=_hands(f, end),
        elbows=ELBOWS,
    )


def _body(drop: float, f: _Fall) -> Rows:
    bent = 0.35 + 0.25 * (drop - 0.55) / 0.95
    middle = 0.5 * (f.t_leave + f.t_land)
    soft = f.land + 0.75 * (f.low - f.land)
    hips = STANDING_HIPS_M
    return [
        # x, height, pitch, yaw, roll; lean, twist, look down
        (0.0, 0, 0, 0, 0, 0, 0, 0, 0),
        (f.t_squat, 0.03, f.squat - hips, bent, 0, 0, bent, 0, 0.1),
        (f.t_over, 0.03, f.over - hips, bent, 0, 0, bent, 0, 0.1),
        (f.t_leave, 0.01, f.leave - hips, 0.6 * bent, 0, 0, 0.8 * bent, 0, 0.1),
        (middle, 0.0, f.fallen(middle) - hips, 0.4 * bent, 0, 0, 0.6 * bent, 0, 0.1),
        (f.t_land, 0.0, f.land - hips, 0.5 * bent, 0, 0, 0.6 * bent, 0, 0.0),
        (0.5 * (f.t_land + f.t_low), -0.01, soft - hips, 0.7 * bent, 0, 0, 0.7 * bent, 0, -0.1),
        (f.t_low, -0.01, f.low - hips, bent, 0, 0, bent, 0, -0.2),
        (0.4 * f.t_low + 0.6 * f.seconds, 0.01, -0.08 - drop, 0.2, 0, 0, 0.2, 0, -0.05),
        (f.seconds, 0, -drop, 0, 0, 0, 0, 0, 0),
    ]


def _feet(drop: float, f: _Fall, follow: float) -> tuple[Rows, Rows]:
    edge = (0, 0, 0.11, TOE_HEIGHT, -0.04)
    low = 0.06 - drop
    hanging = max(low, 0.4 * f.leave + 0.6 * f.land - 0.84)
    lead: Rows = [
        (0.0, *GROUND, 0, 0),
        (f.t_squat - 0.06, *GROUND, 0, 0),
        (f.t_squat + 0.08, 0, 0, -0.12, 0.12, 0.02, 0.2, 0.2),
        (f.t_over, 0, 0, -0.12, max(low, f.over - 0.70), 0.28, 0.1, 0),
        (0.4 * f.t_over + 0.6 * f.t_land, 0, 0.5, -0.06, 0.5 * hanging, 0.22, 0.3, 0),
        (f.t_land, *TOP, 0.25, 0),
        (f.t_land + HEEL_AFTER_S, *TOP, 0, 0),
        (f.seconds, *TOP, 0, 0),
    ]
    clear, passing = (f.t_leave + share * (follow - f.t_leave) for share in (0.22, 0.55))
    under = f.fallen(passing) - 0.72  # a foot that hangs on a bent leg
    trail: Rows = [
        (0.0, *GROUND, 0, 0),
        (0.10, *GROUND, 0, 0),
        (0.24, 0.5, 0, 0.055, 0.06, -0.02, 0.25, 0),
        (0.38, *edge, 0, 0),
        (0.5 * (0.38 + f.t_squat), *edge, 0.0, 0),
        (f.t_over, *edge, 0.5, 0.1),
        (f.t_leave, *edge, 0.75, 0.1),
        (clear, 0, 0, 0.11, 0.0, 0.09, 0.4, 0.2),
        (passing, 0, 0.4, 0.07, max(under, low) + 0.4 * drop, 0.0, 0.5, 0.1),
        (follow, *TOP, 0.25, 0),
        (follow + HEEL_AFTER_S, *TOP, 0, 0),
        (f.seconds, *TOP, 0, 0),
    ]
    return lead, trail


def _hands(f: _Fall, end: float) -> tuple[Track, Track]:
    """Both go forward for balance in the landing."""
    tracks: list[Rows] = [[], []]
    for side, x in ((0, 1.0), (1, -1.0)):
        tracks[side] = [(f.t_over, 0, 0.34 * x, f.over + 0.05, 0.3, 0.0, 0.2)]
        tracks[side] += [
            (f.t_land + 0.03, 0.5, 0.34 * x, f.land + 0.12, end + 0.22, 0.0, 0.2),
            (f.t_low + 0.05, 0.6, 0.30 * x, f.low + 0.14, end + 0.28, 0.0, 0.2),
            (0.3 * f.t_low + 0.7 * f.seconds, 0, 0.28 * x, f.low + 0.4, end + 0.15, 0.0, 0.2),
        ]
    return timed(tracks[0], 1.0), timed(tracks[1], 1.0)
