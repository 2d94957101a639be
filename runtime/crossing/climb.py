"""Up a wall with hands and feet, and down a drop: key poses for a rise or a fall of 0.55 to 1.5 m."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from runtime.arrays import Array
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
from runtime.crossing.keyed_pose import CrossingPose, Track
from runtime.skeleton import TOE_HEIGHT

CLIMBING_ELBOWS = ((0.45, -0.4, -0.6), (-0.45, -0.4, -0.6))  # out, down and back


def step_up(rise: float, start: float, end: float, seconds: float) -> KeyedMotion:
    """A low wall: hands on the edge, one high step from the ground, the other foot after it."""
    root: Rows = [
        (0, start),
        (0.28, -0.38),
        (0.42, -0.37),
        (0.52, -0.30),
        (0.61, -0.22),
        (0.69, -0.13),
        (0.82, 0.75 * end),
        (1, end),
    ]
    lead, trail = _step_up_feet(rise)
    lead_stands = [*stands(0, 0.28, 0.29), *stands(0.59, 1.0)]
    trail_stands = [*stands(0, 0.35, 0.62), *stands(0.92, 1.0)]
    return KeyedMotion(
        seconds,
        start,
        end,
        rise,
        root=timed(root, seconds),
        body=timed(_step_up_body(rise), seconds),
        level=timed([(0, 0), (0.22, 1), (0.7, 1), (1, 0)], seconds),
        feet=both_sides(lead, trail, seconds),
        stands=both_sides(lead_stands, trail_stands, seconds),
        hands=_climbing_hands(rise, start, 0.13, 0.22, 0.61, 0.78, seconds),
        elbows=CLIMBING_ELBOWS,
    )


def _step_up_body(rise: float) -> Rows:
    carried = (
        min(0.39 + rise, 1.03) - STANDING_HIPS_M
    )  # on tiptoe and on the arms, so that the lead foot passes
    return [
        # x, height, pitch, yaw, roll; lean, twist, look down
        (0.00, 0, 0, 0, 0, 0, 0, 0, 0),
        (0.22, 0.01, -0.08, 0.60, 0, 0, 0.65, 0, -0.35),
        (0.40, 0.04, carried - 0.02, 0.75, 0.05, -0.10, 0.70, -0.05, -0.4),
        (0.50, 0.03, carried, 0.85, 0.05, -0.08, 0.75, -0.05, -0.4),
        (0.61, 0.00, max(0.04, carried), 0.85, 0.02, 0, 0.65, 0, -0.4),
        (0.70, -0.02, rise - 0.36, 0.62, 0, 0.03, 0.55, 0, -0.3),
        (0.80, -0.03, rise - 0.15, 0.32, -0.04, 0, 0.32, 0, -0.15),
        (0.92, 0.01, rise - 0.02, 0.06, 0, 0, 0.06, 0, 0),
        (1.00, 0, rise, 0, 0, 0, 0, 0, 0),
    ]


def _step_up_feet(rise: float) -> tuple[Rows, Rows]:
    lead: Rows = [
        (0.00, *GROUND, 0, 0),
        (0.28, *GROUND, 0, 0),
        (0.35, 1, 0, -0.02, 0.08, -0.03, 0.5, 0.2),
        (0.46, 0, 0, -0.17, rise + 0.03, -0.17, 0.15, 0.8),
        (0.53, 0, 0.5, -0.09, 0.5 * rise + 0.07, -0.01, 0.0, 0.7),
        (0.59, *TOP, 0, 0.45),
        (0.85, *TOP, 0, 0.05),
        (1.00, *TOP, 0, 0),
    ]
    trail: Rows = [
        (0.00, *GROUND, 0, 0),
        (0.36, *GROUND, 0, 0),
        (0.48, *GROUND, 0.35, 0.15),
        (0.63, *GROUND, 0.9, 0.55),
        (0.72, 0.3, 0, 0.07, 0.62 * rise, -0.12, 1.0, 0.65),
        (0.80, 0, 0.3, 0.08, 0.7 * rise + 0.15, -0.10, 0.55, 0.4),
        (0.86, 0, 0.8, 0.02, 0.2 * rise + 0.09, -0.02, 0.1, 0.15),
        (0.92, *TOP, 0, 0.05),
        (1.00, *TOP, 0, 0),
    ]
    return lead, trail


def pull_up(rise: float, start: float, end: float, seconds: float) -> KeyedMotion:
    """A high wall: a push off the ground and the wall's face, the trunk over the edge, a foot on top."""
    root: Rows = [
        (0, start),
        (0.23, -0.42),
        (0.41, -0.42),
        (0.51, -0.33),
        (0.59, -0.22),
        (0.68, -0.17),
        (0.74, -0.10),
        (0.81, 0.3 * end),
        (0.90, 0.92 * end),
        (1, end),
    ]
    lead, trail = _pull_up_feet(rise)
    lead_stands = [*stands(0, 0.24, 0.32), *stands(0.66, 1.0)]
    trail_stands = [*stands(0, 0.24, 0.29), *stands(0.37, 0.37, 0.41), *stands(0.89, 1.0)]
    return KeyedMotion(
        seconds,
        start,
        end,
        rise,
        root=timed(root, seconds),
        body=timed(_pull_up_body(rise), seconds),
        level=timed([(0, 0), (0.16, 1), (0.78, 1), (1, 0)], seconds),
        feet=both_sides(lead, trail, seconds),
        stands=both_sides(lead_stands, trail_stands, seconds),
        hands=_climbing_hands(rise, start, 0.12, 0.19, 0.66, 0.80, seconds),
        elbows=CLIMBING_ELBOWS,
    )


def _pull_up_body(rise: float) -> Rows:
    # height of the pelvis that leaves the ground, and of one that the arms carry
    tiptoe, support = 1.02, rise + 0.34

    def height(share: float) -> float:
        return tiptoe + (support - tiptoe) * share - STANDING_HIPS_M

    return [
        (0.00, 0, 0, 0, 0, 0, 0, 0, 0),
        (0.15, 0, -0.03, 0.08, 0, 0, 0.10, 0, -0.1),
        (0.23, 0, -0.10, 0.15, 0, 0, 0.15, 0, -0.3),
        (0.32, 0.01, height(0.0), 0.05, 0, 0, 0.10, 0, -0.2),
        (0.41, 0.02, height(0.35), 0.05, 0, 0, 0.12, 0, -0.2),
        (0.51, 0.03, height(0.80), 0.35, 0.06, -0.10, 0.40, -0.05, -0.2),
        (0.58, 0.04, height(1.0), 0.80, 0.12, -0.22, 0.60, -0.08, -0.4),
        (0.66, 0.01, rise - 0.56, 0.80, 0.08, -0.05, 0.60, -0.05, -0.4),
        (0.78, -0.03, rise - 0.30, 0.50, 0, 0.04, 0.40, 0, -0.2),
        (0.88, -0.02, rise - 0.12, 0.20, -0.03, 0, 0.20, 0, -0.1),
        (0.95, 0.01, rise - 0.03, 0.05, 0, 0, 0.05, 0, 0),
        (1.00, 0, rise, 0, 0, 0, 0, 0, 0),
    ]


def _pull_up_feet(rise: float) -> tuple[Rows, Rows]:
    step = 0.29 * rise  # height of the foot on the face
    lead: Rows = [
        (0.00, *GROUND, 0, 0),
        (0.25, *GROUND, 0, 0),
        (0.33, *GROUND, 0.8, 0.1),
        (0.44, 0, 0, -0.14, 0.30 * rise, -0.24, 0.7, 0.4),
        (0.52, 0, 0, -0.28, rise - 0.30, -0.22, 0.5, 1.0),
        (0.59, 0, 0.15, -0.28, 0.85 * rise + 0.06, -0.10, 0.0, 1.2),
        (0.66, *TOP, 0, 0.8),
        (0.85, *TOP, 0, 0.15),
        (1.00, *TOP, 0, 0),
    ]
    trail: Rows = [
        (0.00, *GROUND, 0, 0),
        (0.25, *GROUND, 0, 0),
        (0.30, *GROUND, 0.4, 0.1),
        (0.37, 0, 0, 0.14, step, -0.04, -0.5, 0.9),
        (0.43, 0, 0, 0.14, step, -0.04, 0.2, 0.5),
        (0.56, 0, 0, 0.11, rise - 0.64, -0.20, 0.9, 0.1),
        (0.67, 0, 0, 0.12, rise - 0.52, -0.22, 1.0, 0.2),
        (0.73, 0, 0, 0.16, rise - 0.24, -0.26, 1.0, 0.4),
        (0.78, 0, 0.0, 0.18, rise + 0.06, -0.14, 0.8, 0.6),
        (0.83, 0, 0.6, 0.06, 0.4 * rise + 0.09, -0.02, 0.3, 0.5),
        (0.89, *TOP, 0, 0.15),
        (1.00, *TOP, 0, 0),
    ]
    return lead, trail


def _climbing_hands(
    rise: float, start: float, raised: float, held: float, left: float, down: float, seconds: float
) -> tuple[Track, Track]:
    """Hands that come up before the chest, go onto the edge and leave it; times are shares of the whole."""
    tracks = []
    for side in (1.0, -1.0):
        over = max(rise + 0.10, min(1.0, rise + 0.3))
        # the first place is near the second: an arm that swings from one while its weight is small could turn over
        rows: Rows = [
            (0.0, 0, 0.24 * side, min(over, 1.25), start + 0.14, 0.3, -0.5),
            (raised, 1, 0.22 * side, over, -0.13, 0.3, -0.5),
            (held, 1, 0.20 * side, rise + 0.03, 0.0, 0.2, 0.0),
            (left, 1, 0.20 * side, rise + 0.03, 0.0, 0.2, 0.0),
            (down, 0, 0.24 * side, rise + 0.3, 0.05, 0.2, 0.3),
        ]
        tracks.append(timed(rows, seconds))
    return tracks[0], tracks[1]


GRAVITY = 9.81
HEEL_AFTER_S = 0.06  # the toes land first
DEEPEST_SQUAT_FROM_M = 1.0  # a deeper squat does not fit a leg that still stands on the edge
FALLING_ELBOWS = ((0.6, 0.2, -0.6), (-0.6, 0.2, -0.6))


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
        hands=_falling_hands(f, end),
        elbows=FALLING_ELBOWS,
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


def _falling_hands(f: _Fall, end: float) -> tuple[Track, Track]:
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


STEP_UP_M = 0.68  # up to which the lead foot steps from the ground onto the top
FARTHEST_END_M = 0.28  # behind the edge, where a climber stands up
LANDING_M = 0.52  # behind the edge, where one who got down stands up


class _Crossing:
    """What climbing up and getting down have in common: a keyed motion at a tempo."""

    def __init__(self, motion: KeyedMotion, tempo: float) -> None:
        self._motion, self._tempo = motion, tempo
        self.seconds = motion.seconds / tempo
        self.end_z = motion.end_z

    def root_z(self, t: float) -> float:
        """Place of the root along z in metres at `t` seconds."""
        return self._motion.root.at(t * self._tempo)[0]

    def pose(self, t: float, hips: Array, local: Array) -> CrossingPose:
        """The pose at `t` seconds; `hips` `(3,)` and `local` `(31, 4)` are the incoming one, root at `root_z(t)`."""
        return self._motion.pose(min(max(t * self._tempo, 0.0), self._motion.seconds), hips, local)


class Climb(_Crossing):
    """Up onto a wall: hands on the edge, a foot on top, stand."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        """`rise` metres up from a root at `start_z` < 0; the wall's top is `depth` thick; `tempo` over 1 is faster."""
        end_z = min(FARTHEST_END_M, 0.5 * depth)
        seconds = 1.5 + 1.5 * (rise - 0.6)
        make = step_up if rise < STEP_UP_M else pull_up
        super().__init__(make(rise, start_z, end_z, seconds), tempo)


class Descend(_Crossing):
    """Down a drop: squat at the edge, step off, land on bent knees, stand."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        """`rise` < 0 is the drop in metres, from a root at `start_z` < 0; `depth` is not used; `tempo` over 1 is faster."""
        super().__init__(let_down(-rise, start_z, LANDING_M), tempo)
