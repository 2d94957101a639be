"""The pose layer: what is keyed is there, the rest is as it was, feet stay planted, curves do not overshoot."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.errors import UsageError
from runtime.feet.ik import LEG_FEET
from runtime.skeleton import SPORT_SKELETON, J
from runtime.takes.clip import Clip
from runtime.takes.pose_layer import (
    Curve,
    JointValue,
    PoseKey,
    PoseLayer,
    Tangent,
    dragged,
    layered,
    mirrored_pose,
    pose_as_key,
    turned,
)

JOINTS = ("Head", "LeftHand", "LeftForeArm", "LeftLeg", "LeftArm")
HEAD, HAND, ELBOW, KNEE, ARM = (SPORT_SKELETON.index(name) for name in JOINTS)
small = st.floats(-1.0, 1.0).map(lambda value: round(value, 3))
vectors = st.tuples(small, small, small)


def layer_of(*keys: PoseKey, fps: float = 60.0, **options: float | bool) -> PoseLayer:
    layer = PoseLayer(**options)
    for key in keys:
        layer = layer.with_key(key, fps)
    return layer


@given(vector=vectors, at=st.integers(40, 80))
@settings(max_examples=20, deadline=None)
def test_a_turn_is_there_at_its_key_and_nowhere_outside_its_eases(
    walk: Clip, vector: tuple[float, float, float], at: int
) -> None:
    key = PoseKey(at / 60.0).with_value(Curve.TURN, HEAD, np.array(vector))
    made = layered(walk, layer_of(key, ease_in=0.25, ease_out=0.5))
    turn = rotations.from_rotation_vector(np.array(vector))
    expected = rotations.multiply(walk.local_rotations[at, HEAD], turn)
    assert rotations.angle_between(made.local_rotations[at, HEAD], expected) < 1e-3
    outside = np.r_[0 : at - 15, at + 31 : len(walk)]
    assert np.array_equal(made.local_rotations[outside], walk.local_rotations[outside])
    others = np.arange(J) != HEAD
    assert np.abs(made.local_rotations[:, others] - walk.local_rotations[:, others]).max() < 1e-6


def test_joints_have_curves_of_their_own_and_the_last_key_can_hold(walk: Clip) -> None:
    head = PoseKey(0.5).with_value(Curve.TURN, HEAD, np.eye(3)[0])
    arm = PoseKey(1.5).with_value(Curve.TURN, ARM, np.eye(3)[1])
    layer = layer_of(head, arm, ease_in=0.25, ease_out=0.25)
    times = np.array([0.5, 1.0, 1.5])
    assert np.allclose(layer.values(Curve.TURN, HEAD, times), [[1, 0, 0], [0, 0, 0], [0, 0, 0]])
    assert np.allclose(layer.values(Curve.TURN, ARM, times), [[0, 0, 0], [0, 0, 0], [0, 1, 0]])
    kept = layer_of(head, arm, ease_in=0.25, keeps=True)
    assert np.allclose(kept.values(Curve.TURN, HEAD, np.array([0.5, 1.0, 60.0])), np.eye(3)[[0, 0, 0]])


@given(values=st.lists(small, min_size=2, max_size=6), tangent=st.sampled_from(list(Tangent)))
@settings(max_examples=40, deadline=None)
def test_a_curve_passes_its_keys_and_stays_between_them(values: list[float], tangent: Tangent) -> None:
    keys = [PoseKey(1.0 + k, (JointValue(HEAD, v, 0, 0),), (), tangent) for k, v in enumerate(values)]
    layer = layer_of(*keys)
    assert np.allclose(layer.values(Curve.TURN, HEAD, 1.0 + np.arange(len(values)))[:, 0], values)
    for k, (a, b) in enumerate(pairwise(values)):
        between = layer.values(Curve.TURN, HEAD, 1.0 + k + np.linspace(0.0, 0.999, 20))[:, 0]
        assert between.min() >= min(a, b) - 1e-9
        assert between.max() <= max(a, b) + 1e-9


@given(down=st.floats(0.0, 0.3), ahead=st.floats(-0.1, 0.1), pitch=st.floats(-0.4, 0.4))
@settings(max_examples=20, deadline=None)
def test_feet_stay_where_they_are_while_the_hips_move(
    walk: Clip, down: float, ahead: float, pitch: float
) -> None:
    key = PoseKey(1.0).with_value(Curve.MOVE, 0, np.array([0.0, -down, ahead]))
    key = key.with_value(Curve.TURN, 0, np.array([pitch, 0.0, 0.0]))
    made = layered(walk, layer_of(key))
    before, after = (clip.world()[0][:, LEG_FEET] for clip in (walk, made))
    straight = np.linalg.norm(after - made.world()[0][:, [2, 7]], axis=-1) > 0.83
    assert np.where(straight, 0.0, np.linalg.norm(after - before, axis=-1)).max() < 2e-3
    assert made.hips_positions[60, 1] - walk.hips_positions[60, 1] == pytest.approx(-down, abs=1e-5)


@pytest.mark.parametrize("joint", [HAND, ELBOW, KNEE, 4, 0, HEAD])
def test_what_is_dragged_goes_where_it_is_dragged(walk: Clip, joint: int) -> None:
    walk = layered(walk, layer_of(PoseKey(1.0).with_value(Curve.TURN, ELBOW, np.array([0.0, -0.8, 0.0]))))
    positions, world = (array[60] for array in walk.world())
    by = np.array([0.02, 0.05, -0.03]) if joint != HAND else np.array([-0.15, 0.1, 0.1])
    key = dragged(PoseKey(1.0), joint, positions.astype(float), world.astype(float), by)
    after = layered(walk, layer_of(key)).world()[0][60, joint]
    missing, asked = np.linalg.norm(after - positions[joint] - by), np.linalg.norm(by)
    assert missing < (1e-3 if joint in (HAND, 4, 0) else asked)


def test_a_gizmo_turns_in_the_world(walk: Clip) -> None:
    world = walk.world()[1][60].astype(float)
    turn = rotations.from_axis_angle(np.eye(3)[1], np.asarray(0.4))
    key = turned(turned(PoseKey(1.0), ARM, world, turn), ARM, world, rotations.identity())
    after = layered(walk, layer_of(key)).world()[1][60, ARM]
    assert rotations.angle_between(after, rotations.multiply(turn, world[ARM])) < 1e-3


@pytest.mark.parametrize("mirror", [False, True])
def test_a_copied_pose_is_the_same_elsewhere(walk: Clip, mirror: bool) -> None:
    local = walk.local_rotations[20].astype(float)
    local = mirrored_pose(local) if mirror else local
    made = layered(walk, layer_of(pose_as_key(walk.hips_positions[20], local, walk, 75)))
    own = made.local_rotations[75].astype(float)
    turn = rotations.from_yaw(rotations.yaw_of(local[0]) - rotations.yaw_of(own[0]))
    own[0] = rotations.multiply(turn, own[0])
    assert np.degrees(rotations.angle_between(own, local)).max() < 1.0
    assert made.hips_positions[75, 1] == pytest.approx(walk.hips_positions[20, 1], abs=1e-5)


def test_values_of_no_body_are_refused() -> None:
    with pytest.raises(UsageError):
        PoseKey(1.0, (JointValue(40, 0, 0, 0),))
    with pytest.raises(UsageError):
        PoseKey(1.0, (), (JointValue(0, 0, 100.0, 0),))
    with pytest.raises(UsageError):
        PoseKey(1.0, (JointValue(1, 0, 0, 0), JointValue(1, 0, 0, 0)))
    with pytest.raises(UsageError):
        PoseLayer(ease_in=-1.0)
    with pytest.raises(UsageError):
        PoseLayer((PoseKey(0.0), PoseKey(1e-320)))
