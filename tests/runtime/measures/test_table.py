"""The table of measures: known poses have known values, mirror images mirrored ones, and what is kept in files its columns."""

import numpy as np
import pytest

from runtime import rotations
from runtime.edits.request import ARM, LEG, TRUNK
from runtime.measures.table import MEASURES, TARGETS, BodyMeasures, measure, measures_of, targets_of
from runtime.skeleton import PART_NAMES, SPORT_SKELETON, mirror_motion
from tests.helpers.walker import CYCLE_FRAMES, STRIDE_M, walk

X, Y, Z = np.eye(3)
FRAMES = 240
SWING = 25 * np.sin(np.arange(FRAMES) / 60 * 2 * np.pi)
RANGE = 2 * 25 * np.sin(np.radians(72))  # from the 10th to the 90th percentile of that


def posed(turns: dict[str, tuple[np.ndarray, np.ndarray | float]], yaw: float = 0.0) -> BodyMeasures:
    """Measures of who stands, with joints turned about an axis by degrees, and faces by a yaw."""
    local = rotations.identity((FRAMES, len(SPORT_SKELETON)))
    for joint, (axis, degrees) in turns.items():
        angle = np.radians(np.broadcast_to(np.asarray(degrees, float), FRAMES))
        local[:, SPORT_SKELETON.index(joint)] = rotations.from_axis_angle(axis, angle)
    local[:, 0] = rotations.multiply(rotations.from_yaw(np.full(FRAMES, yaw)), local[:, 0])
    return measure(np.tile([0.0, 1.0, 0.0], (FRAMES, 1)), local, np.ones((FRAMES, 4)))


@pytest.mark.parametrize("yaw", [0.0, 2.5])
@pytest.mark.parametrize(
    ("turns", "part", "name", "value", "tolerance"),
    [
        ({"LeftForeArm": (Y, -100.0)}, "left_arm", "elbow_bend", 100.0, 0.5),
        ({"LeftForeArm": (Y, -100.0)}, "right_arm", "elbow_bend", 0.0, 0.5),
        ({}, "left_arm", "hand_out", 0.49, 0.05),
        ({"RightArm": (Z, 90.0)}, "right_arm", "hand_out", 0.0, 0.03),
        ({"RightArm": (Y, 90.0)}, "right_arm", "hand_front", 0.49, 0.05),
        ({"LeftArm": (Z, 90.0)}, "left_arm", "hand_level", 2.36, 0.05),
        ({"LeftLeg": (X, 50.0)}, "left_leg", "knee_bend", 50.0, 0.5),
        ({"LeftUpLeg": (X, -30.0)}, "left_leg", "thigh_lift", 30.0, 3.0),
        ({"RightUpLeg": (Y, -20.0)}, "right_leg", "toe_out", 20.0, 0.5),
        ({"LeftFoot": (X, 25.0)}, "left_leg", "foot_pitch", 25.0, 0.5),
        ({"LowerBack": (X, 14.0)}, "torso", "pitch", 14.0 - 3.3, 0.5),  # at rest the neck is behind the hips
        ({"LowerBack": (Z, -12.0)}, "torso", "roll", 12.0, 1.5),
        ({"Spine1": (Y, SWING)}, "torso", "twist_range", RANGE, 1.0),
        ({"Head": (X, 40.0)}, "head", "pitch", 40.0, 0.5),
        ({"Head": (Y, 30.0)}, "head", "turn", 30.0, 0.5),
        ({"Head": (Z, -20.0)}, "head", "roll", 20.0, 0.5),
        ({"Head": (Y, SWING)}, "head", "turn_range", RANGE, 1.0),
    ],
)
def test_a_known_pose_has_its_value(turns, part, name, value, tolerance, yaw) -> None:
    assert getattr(getattr(posed(turns, yaw), part), name) == pytest.approx(value, abs=tolerance)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("step_length", STRIDE_M / 2), ("cadence", 2 * 60 / CYCLE_FRAMES), ("speed", STRIDE_M * 60 / CYCLE_FRAMES),
        ("walk_ratio", STRIDE_M / 4 * CYCLE_FRAMES / 60), ("moving", 1.0), ("stance_lead", 0.0), ("halting", 0.0),
    ],
)  # fmt: skip
def test_a_walk_has_its_pace(name: str, value: float) -> None:
    walked = measure(*walk(6 * CYCLE_FRAMES))
    for leg in (walked.left_leg, walked.right_leg):
        assert getattr(leg, name) == pytest.approx(value, rel=0.05, abs=0.05)


def test_the_mirror_image_has_the_other_side_s_values_and_the_other_sign_of_what_has_a_side() -> None:
    hips, local, contacts = walk(300)
    for k, joint in enumerate(("LeftArm", "LeftForeArm", "RightUpLeg", "Spine1", "Head")):
        turn = rotations.from_axis_angle(np.array([0.3, 0.8, -0.5]), np.full(300, 0.1 + 0.1 * k))
        at = SPORT_SKELETON.index(joint)
        local[:, at] = rotations.multiply(local[:, at], turn)
    own = measure(hips, local, contacts)
    mirrored = measure(*mirror_motion(hips, local), contacts[:, [2, 3, 0, 1]])
    for part in PART_NAMES:
        other = part.replace("left", "R").replace("right", "left").replace("R", "right")
        for name, row in measures_of(part).items():
            sign = -1.0 if row.sided else 1.0
            found = getattr(getattr(mirrored, other), name)
            assert found == pytest.approx(sign * getattr(getattr(own, part), name), abs=1e-4), (part, name)


def test_rows_have_names_of_their_own_and_targets_are_shown_by_measures() -> None:
    assert len({(row.part, row.name) for row in MEASURES}) == len(MEASURES)
    assert len({(row.part, row.name) for row in TARGETS}) == len(TARGETS)
    assert all(row.measure in ("", *measures_of(row.part)) for row in TARGETS)
    assert targets_of("left_arm") == targets_of("right_arm")


def test_columns_of_what_is_asked_stay_where_files_have_them() -> None:
    assert LEG == ("outward", "lower", "pitch", "toe_out", "knee", "lift")
    assert TRUNK == ("lean", "aside", "twist", "sway", "rock", "bounce", "fold", "shrug")
    assert ARM == ("elbow", "elbow_out", "swing")
