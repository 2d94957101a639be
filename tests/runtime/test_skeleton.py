"""The 31 joints, forward kinematics and mirroring."""

import numpy as np
import pytest

from runtime import rotations
from runtime.skeleton import MIRROR_JOINTS, SPORT_SKELETON, J, Skeleton, mirror_motion


def random_motion(frames=5, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(frames, 3)), rotations.normalize(rng.normal(size=(frames, J, 4)))


def test_the_skeleton_has_31_joints_with_parents_first():
    assert J == 31
    assert SPORT_SKELETON.parents[0] == -1
    assert all(0 <= parent < j for j, parent in enumerate(SPORT_SKELETON.parents) if j)
    assert len(set(SPORT_SKELETON.names)) == J


def test_rest_pose_stands_upright_with_the_left_on_plus_x():
    named = dict(zip(SPORT_SKELETON.names, SPORT_SKELETON.rest_positions, strict=True))
    assert named["LeftFoot"][1] < named["LeftLeg"][1] < named["Hips"][1] < named["Head"][1]
    assert named["LeftHand"][0] > 0.4 > -0.4 > named["RightHand"][0]
    assert named["LeftToeBase"][2] > named["LeftFoot"][2] + 0.1


def test_forward_kinematics_keeps_bone_lengths_and_inverts():
    hips, local = random_motion()
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    parents = list(SPORT_SKELETON.parents[1:])
    lengths = np.linalg.norm(positions[:, 1:] - positions[:, parents], axis=-1)
    expected = np.linalg.norm(SPORT_SKELETON.offsets[1:], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(expected, lengths.shape), atol=1e-6)
    assert rotations.angle_between(SPORT_SKELETON.local_rotations(world), local).max() < 1e-6


def test_forward_kinematics_by_hand():
    chain = Skeleton(("a", "b", "c"), (-1, 0, 1), np.array([[9, 9, 9], [0, 1, 0], [0, 2, 0]], float))
    quarter = rotations.from_axis_angle(np.array([0.0, 0, 1]), np.array(np.pi / 2))
    local = np.stack([quarter, quarter, rotations.identity()])
    positions, _ = chain.forward_kinematics(np.array([1.0, 0, 0]), local)
    np.testing.assert_allclose(positions, [[1, 0, 0], [0, 0, 0], [0, -2, 0]], atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_mirrored_motion_is_the_reflection(seed):
    hips, local = random_motion(seed=seed)
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, local)
    mirrored, _ = SPORT_SKELETON.forward_kinematics(*mirror_motion(hips, local))
    np.testing.assert_allclose(mirrored, positions[:, MIRROR_JOINTS] * [-1, 1, 1], atol=1e-6)
    twice = mirror_motion(*mirror_motion(hips, local))
    np.testing.assert_allclose(twice[0], hips)
    np.testing.assert_allclose(twice[1], local)
