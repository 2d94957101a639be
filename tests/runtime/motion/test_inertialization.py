"""Arms that jump while styles blend are shown on their way; anything else is shown as it is."""

import numpy as np

from runtime import rotations
from runtime.motion.features import FPS
from runtime.motion.pose_smoothing import MAX_ARM_SPEED_RAD_PER_S, MAX_JOINT_SPEED_RAD_PER_S, Inertialization
from runtime.skeleton import SPORT_SKELETON

ARM = SPORT_SKELETON.index("LeftArm")


def _pose(angle: float, joint: int = ARM) -> np.ndarray:
    local = rotations.identity((31,)).astype(np.float64)
    local[joint] = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(angle))
    return local


def _shown(angles, blending, joint: int = ARM, rest: float = 0.0) -> np.ndarray:
    """What is shown of a joint's rotations, `blending` being one flag or one for each frame."""
    arms = Inertialization.at_rest(_pose(angles[0], joint)[None])
    flags = np.broadcast_to(blending, len(angles))
    shown = np.array([_pose(a, joint) for a in angles])
    for frame, flag in enumerate(flags):
        arms.apply(shown[frame : frame + 1], [bool(flag)], [rest])
    return shown[:, joint]


JUMP = np.repeat([0.0, 2.5], [30, 90])  # an arm goes up within a frame


def test_an_arm_that_jumps_while_styles_blend_is_shown_on_its_way():
    shown = _shown(JUMP, True)
    speed = rotations.angle_between(shown[1:], shown[:-1]) * FPS
    assert speed.max() < 1.2 * MAX_ARM_SPEED_RAD_PER_S  # 150 rad/s in the network's own motion
    assert np.abs(np.diff(speed[30:])).max() < 2.0  # and gently to the end
    assert rotations.angle_between(shown[-1], _pose(2.5)[ARM]) < 0.01


def test_an_arm_that_swings_is_shown_as_it_is():
    swing = 0.8 * np.sin(2 * np.pi * np.arange(120) / FPS)  # 5 rad/s at most
    expected = np.array([_pose(a)[ARM] for a in swing])
    np.testing.assert_allclose(_shown(swing, True), expected, atol=1e-12)


def test_without_a_blend_only_what_no_arm_does_is_held_back():
    fast = np.repeat([0.0, 0.3, 0.6], [30, 1, 90])  # 18 rad/s
    np.testing.assert_array_equal(_shown(fast, False), np.array([_pose(a)[ARM] for a in fast]))
    speed = rotations.angle_between(_shown(JUMP, False)[1:], _shown(JUMP, False)[:-1]) * FPS
    assert MAX_ARM_SPEED_RAD_PER_S < speed.max() < 1.2 * MAX_JOINT_SPEED_RAD_PER_S


def test_at_rest_an_arm_settles_calmly_and_breathing_stays():
    still = _shown(JUMP, False, rest=1.0)
    assert (rotations.angle_between(still[1:], still[:-1]) * FPS).max() < MAX_ARM_SPEED_RAD_PER_S
    breathing = 0.05 * np.sin(0.4 * np.pi * np.arange(120) / FPS)
    expected = np.array([_pose(a)[ARM] for a in breathing])
    np.testing.assert_allclose(_shown(breathing, False, rest=1.0), expected, atol=1e-12)
    swing = 0.4 * np.sin(2 * np.pi * np.arange(240) / FPS)
    kept = rotations.angle_between(_shown(swing, False, rest=1.0), _pose(0.0)[ARM])[120:]
    assert kept.max() < 0.4 * 0.4


def test_characters_are_apart():
    """What one character holds back is nothing to the next."""
    quiet, jumping = np.array([_pose(0.2)] * len(JUMP)), np.array([_pose(a) for a in JUMP])
    both = np.stack([quiet, jumping], axis=1)
    arms = Inertialization.at_rest(both[0])
    for frame in both:
        assert not arms.apply(frame, [False, True], [0.0, 0.0])[0]
    np.testing.assert_array_equal(both[:, 0], quiet)
    np.testing.assert_array_equal(both[:, 1, ARM], _shown(JUMP, True))
