"""Two-bone IK: reach, bone lengths, knees, and the scalar twin of the per-frame path."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime import rotations
from runtime.easing import spring
from runtime.feet import ik
from runtime.feet.leg import leg_bones, leg_forward, leg_inverse
from runtime.scalar_math import damp
from runtime.skeleton import SPORT_SKELETON, J

LEG = 0.4118 + 0.4233
ANKLES, KNEES, HIPS, TOES = [4, 9], [3, 8], [2, 7], [5, 10]
seeds = st.integers(0, 2**32 - 1)


def poses(seed, shape=(6,), bend=(0.4, 2.0)):
    """Hips positions and local rotations with hinge knees, bent by `bend` radians."""
    rng = np.random.default_rng(seed)
    axis = rotations.normalize(rng.normal(size=(*shape, J, 3)))
    local = rotations.from_axis_angle(axis, rng.uniform(-0.5, 0.5, (*shape, J)))
    hinge = np.broadcast_to([1.0, 0.0, 0.0], (*shape, 2, 3))
    local[..., KNEES, :] = rotations.from_axis_angle(hinge, rng.uniform(*bend, (*shape, 2)))
    return rng.normal(size=(*shape, 3)), local


def forward(hips, local):
    return SPORT_SKELETON.forward_kinematics(hips, local)


def knee_forward(positions, world):
    """How far each knee lies before the line from hip to ankle, along the thigh's own forward."""
    hip, knee, ankle = positions[..., HIPS, :], positions[..., KNEES, :], positions[..., ANKLES, :]
    axis = rotations.normalize(ankle - hip)
    off = (knee - hip) - np.sum((knee - hip) * axis, -1, keepdims=True) * axis
    ahead = rotations.rotate(world[..., HIPS, :], np.broadcast_to([0.0, 0, 1], off.shape))
    return np.sum(off * ahead, axis=-1)


@given(seeds, st.sampled_from([(), (1,), (4,), (2, 3)]))
def test_the_pose_is_kept_when_the_targets_are_its_own_ankles(seed, shape):
    hips, local = poses(seed, shape, bend=(0.6, 2.0))
    positions, world = forward(hips, local)
    after, world_after = forward(hips, ik.solve_legs(hips, local, positions[..., ANKLES, :]))
    np.testing.assert_allclose(after, positions, atol=2e-5)
    assert rotations.angle_between(world_after, world).max() < 1e-3


@given(seeds, st.floats(0.0, 0.1))
def test_a_straight_leg_whose_target_is_its_own_ankle_stays_as_straight(seed, bend):
    hips, local = poses(seed, (), bend=(bend, bend))  # radians: less than any easing leaves
    positions, _ = forward(hips, local)
    after, _ = forward(hips, ik.solve_legs(hips, local, positions[ANKLES]))
    spans = [np.linalg.norm(p[ANKLES] - p[HIPS], axis=-1) for p in (positions, after)]
    np.testing.assert_allclose(spans[1], spans[0], atol=1e-6)


def test_legs_without_length_divide_nothing():
    leg = leg_forward(leg_bones(0), (1e17, 1e17, 1e17), [(1.0, 0.0, 0.0, 0.0)] * J)
    assert leg.hip == leg.knee  # a float is too coarse out there
    assert np.isfinite(leg_inverse(leg, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))).all()
    point = np.full(3, 1e17)
    assert np.isfinite(ik.two_bone(point, point, point, np.zeros(3), np.array([0.0, 0, 1]))).all()


@given(seeds)
def test_reachable_targets_are_reached_and_nothing_else_moves(seed):
    hips, local = poses(seed)
    positions, world = forward(hips, local)
    rng = np.random.default_rng(seed)
    direction = rotations.normalize(rng.normal(size=(6, 2, 3)) + np.array([0, -1.5, 0]))
    targets = positions[:, HIPS] + direction * rng.uniform(0.3, 0.97, (6, 2, 1)) * LEG
    solved = ik.solve_legs(hips, local, targets)
    after, world_after = forward(hips, solved)
    np.testing.assert_allclose(after[:, ANKLES], targets, atol=1e-6)
    others = [j for j in range(J) if j not in (2, 3, 4, 7, 8, 9)]
    np.testing.assert_array_equal(solved[:, others], local[:, others])
    assert rotations.angle_between(world_after[:, ANKLES], world[:, ANKLES]).max() < 1e-6


@given(seeds)
def test_knees_bend_forwards_only(seed):
    hips, local = poses(seed, bend=(-1.0, 1.0))  # some of them broken backwards
    positions, _ = forward(hips, local)
    targets = positions[:, ANKLES] + np.random.default_rng(seed).normal(size=(6, 2, 3)) * 0.1
    after, world = forward(hips, ik.solve_legs(hips, local, targets))
    assert knee_forward(after, world).min() > -1e-6


@given(seeds, st.floats(1.0, 4.0))
def test_out_of_reach_targets_stretch_no_bone(seed, far):
    hips, local = poses(seed)
    positions, _ = forward(hips, local)
    direction = rotations.normalize(np.random.default_rng(seed).normal(size=(6, 2, 3)))
    targets = positions[:, HIPS] + direction * far * LEG
    after, _ = forward(hips, ik.solve_legs(hips, local, targets))
    leg = after[:, ANKLES] - after[:, HIPS]
    assert np.linalg.norm(leg, axis=-1).max() <= LEG * ik.MAX_REACH + 1e-6  # these poses are not straighter
    assert np.sum(rotations.normalize(leg) * direction, -1).min() > 1 - 1e-6
    thigh = np.linalg.norm(after[:, KNEES] - after[:, HIPS], axis=-1)
    np.testing.assert_allclose(thigh, 0.4118, atol=1e-6)


@given(seeds)
def test_feet_take_the_rotations_asked_for(seed):
    hips, local = poses(seed)
    positions, _ = forward(hips, local)
    wanted = rotations.normalize(np.random.default_rng(seed).normal(size=(6, 2, 4)))
    _, world = forward(hips, ik.solve_legs(hips, local, positions[:, ANKLES], wanted))
    assert rotations.angle_between(world[:, ANKLES], wanted).max() < 1e-6


def test_the_knee_does_not_pop_when_the_leg_straightens():
    hips, local = poses(3, (1,), bend=(0.5, 0.6))
    positions, _ = forward(hips, local)
    direction = rotations.normalize(positions[:, ANKLES] - positions[:, HIPS])
    distances = np.linspace(0.9, 1.1, 2001) * LEG
    targets = positions[:, HIPS] + direction * distances[:, None, None]
    motion = np.repeat(local, len(distances), 0)
    after, _ = forward(np.repeat(hips, len(distances), 0), ik.solve_legs(hips[[0] * 2001], motion, targets))
    upper = after[:, KNEES] - after[:, HIPS]
    lower = after[:, ANKLES] - after[:, KNEES]
    angle = np.arccos(np.clip(np.sum(rotations.normalize(upper) * rotations.normalize(lower), -1), -1, 1))
    degrees_per_millimetre = np.abs(np.diff(np.degrees(angle), axis=0)) / (np.diff(distances)[:, None] * 1e3)
    assert degrees_per_millimetre.max() < 3.0  # without easing the rate is unbounded


def test_two_bone_without_a_pole_keeps_the_plane_of_a_bent_limb():
    hip, knee, ankle = np.array([0.0, 1, 0]), np.array([0.3, 0.6, 0]), np.array([0.0, 0.2, 0])
    target = np.array([0.0, 0.4, 0])
    upper, lower = ik.two_bone(hip, knee, ankle, target)
    new_knee = hip + rotations.rotate(upper, knee - hip)
    np.testing.assert_allclose(new_knee + rotations.rotate(lower, ankle - knee), target, atol=1e-9)
    assert new_knee[0] > 0.3
    assert abs(new_knee[2]) < 1e-9


@given(seeds)
def test_scalar_legs_agree_with_the_arrays(seed):
    hips, local = poses(seed, (), bend=(-0.2, 2.0))
    positions, world = forward(hips, local)
    rng = np.random.default_rng(seed)
    targets = positions[ANKLES] + rng.normal(size=(2, 3)) * 0.2
    feet = rotations.normalize(rng.normal(size=(2, 4)))
    expected = ik.solve_legs(hips, local, targets, feet)
    for side in (0, 1):
        bones = leg_bones(side)
        leg = leg_forward(bones, tuple(hips.tolist()), local.tolist())
        np.testing.assert_allclose(leg.toe, positions[TOES[side]], atol=1e-7)
        np.testing.assert_allclose(leg.foot, world[ANKLES[side]], atol=1e-7)
        solved = leg_inverse(leg, tuple(targets[side].tolist()), tuple(feet[side].tolist()))
        first = bones.joints[1]
        assert rotations.angle_between(np.array(solved), expected[first : first + 3]).max() < 1e-5


@given(st.floats(-2.0, 2.0), st.floats(-10.0, 10.0), st.floats(0.05, 0.5))
def test_the_spring_is_critically_damped(offset, velocity, half_life):
    """x'' = -2 y x' - y^2 x with y = 2 ln 2 / half-life, from x(0) = offset and x'(0) = velocity."""
    y, h, middle = 2.0 * np.log(2.0) / half_life, 1e-4, 0.2

    def at(seconds: float) -> float:
        return float(spring(np.array(offset), np.array(velocity), np.array(0.0), half_life, seconds)[0])

    assert at(0.0) == pytest.approx(offset, abs=1e-12)
    assert (at(h) - at(-h)) / (2 * h) == pytest.approx(velocity, abs=0.05)
    slope = (at(middle + h) - at(middle - h)) / (2 * h)
    bend = (at(middle + h) - 2 * at(middle) + at(middle - h)) / h**2
    assert bend == pytest.approx(-2 * y * slope - y * y * at(middle), abs=0.05)
    assert damp(offset, velocity, 0.0, half_life, middle)[0] == pytest.approx(at(middle), abs=1e-8)


@given(st.floats(-2, 2), st.floats(-3, 3), st.floats(0.02, 0.3))
def test_the_spring_is_exact_over_any_step(value, velocity, half_life):
    once = damp(value, velocity, 0.5, half_life, 0.1)
    many = (value, velocity)
    for _ in range(10):
        many = damp(*many, 0.5, half_life, 0.01)
    np.testing.assert_allclose(once, many, atol=1e-9)
    rest, speed = damp(value, velocity, 0.5, half_life, 40 * half_life)
    assert abs(rest - 0.5) < 1e-6
    assert abs(speed) < 1e-4
