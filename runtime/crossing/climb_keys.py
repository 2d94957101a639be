"""The keys of climbing up a wall: times are shares of the whole, metres and radians in the crossing's frame."""

from __future__ import annotations

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

ELBOWS = ((0.45, -0.4, -0.6), (-0.45, -0.4, -0.6))  # out, down and back


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
        hands=_hands(rise, start, 0.13, 0.22, 0.61, 0.78, seconds),
        elbows=ELBOWS,
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
        hands=_hands(rise, start, 0.12, 0.19, 0.66, 0.80, seconds),
        elbows=ELBOWS,
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


def _hands(
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
