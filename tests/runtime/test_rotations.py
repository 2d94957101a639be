"""Axioms of rotation math, on any leading shape."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from runtime import rotations as R

ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
shapes = hnp.array_shapes(min_dims=0, max_dims=3, max_side=4)


def random_quaternions(seed, shape):
    return R.normalize(np.random.default_rng(seed).normal(size=(*shape, 4)))


@st.composite
def quaternions(draw, count=1):
    shape, seed = draw(shapes), draw(st.integers(0, 2**32 - 1))
    result = tuple(random_quaternions((seed, k), shape) for k in range(count))
    return result if count > 1 else result[0]


def same_rotation(a, b, tolerance=1e-6):
    assert np.max(R.angle_between(a, b), initial=0.0) < tolerance


@given(quaternions(3))
def test_multiplication_is_associative_and_inverse_undoes(abc):
    a, b, c = abc
    np.testing.assert_allclose(R.multiply(R.multiply(a, b), c), R.multiply(a, R.multiply(b, c)), atol=1e-12)
    identity = np.broadcast_to(R.identity(), a.shape)
    np.testing.assert_allclose(R.multiply(a, R.inverse(a)), identity, atol=1e-12)


@given(quaternions(2), st.integers(0, 1000))
def test_rotating_keeps_length_and_composes(ab, seed):
    a, b = ab
    v = np.random.default_rng(seed).normal(size=(*a.shape[:-1], 3))
    np.testing.assert_allclose(np.linalg.norm(R.rotate(a, v), axis=-1), np.linalg.norm(v, axis=-1), rtol=1e-9)
    np.testing.assert_allclose(R.rotate(R.multiply(a, b), v), R.rotate(a, R.rotate(b, v)), atol=1e-9)
    np.testing.assert_allclose(R.rotate(a, v), (R.to_matrix(a) @ v[..., None])[..., 0], atol=1e-9)


@given(quaternions())
def test_matrix_and_6d_round_trips(q):
    same_rotation(R.from_matrix(R.to_matrix(q)), q)
    same_rotation(R.from_6d(R.to_6d(q)), q)
    np.testing.assert_allclose(np.linalg.det(R.to_matrix(q)), 1.0, atol=1e-9)


@pytest.mark.parametrize("angle", [np.pi, np.pi - 1e-7])
@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0]])
def test_half_turns_survive_the_matrix(axis, angle):
    q = R.from_axis_angle(np.array(axis, float), np.array(angle))
    same_rotation(R.from_matrix(R.to_matrix(q)), q, 1e-5)


@given(quaternions(), st.floats(0.1, 10.0), st.floats(-1.0, 1.0))
def test_6d_accepts_scaled_and_skewed_columns(q, scale, skew):
    d = R.to_6d(q)
    first, second = d[..., :3] * scale, d[..., 3:] + skew * d[..., :3]
    same_rotation(R.from_6d(np.concatenate([first, second], -1)), q)


@pytest.mark.parametrize("order", ORDERS)
@given(quaternions())
def test_euler_round_trip(order, q):
    same_rotation(R.from_euler(R.to_euler(q, order), order), q, 1e-5)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("second", [np.pi / 2, -np.pi / 2])
def test_euler_round_trip_in_gimbal_lock(order, second):
    q = R.from_euler(np.array([0.3, second, -1.1]), order)
    same_rotation(R.from_euler(R.to_euler(q, order), order), q, 1e-4)


def test_euler_order_means_intrinsic_rotations_as_in_bvh():
    z, x = np.array(0.4), np.array(-0.9)
    about_z, about_x = (R.from_axis_angle(np.eye(3)[k], turn) for k, turn in ((2, z), (0, x)))
    same_rotation(R.from_euler(np.array([0.4, 0.0, -0.9]), "ZYX"), R.multiply(about_z, about_x))


@given(st.integers(0, 2**32 - 1))
def test_between_turns_one_vector_into_the_other(seed):
    a, b = R.normalize(np.random.default_rng(seed).normal(size=(2, 5, 3)))
    np.testing.assert_allclose(R.rotate(R.between(a, b), a), b, atol=1e-7)
    np.testing.assert_allclose(R.rotate(R.between(a, -a), a), -a, atol=1e-6)


@given(quaternions(2), st.floats(0.0, 1.0))
def test_slerp_has_its_ends_and_a_constant_speed(ab, t):
    a, b = ab
    same_rotation(R.slerp(a, b, 0.0), a)
    same_rotation(R.slerp(a, b, 1.0), b)
    whole = R.angle_between(a, b)
    np.testing.assert_allclose(R.angle_between(a, R.slerp(a, b, t)), t * whole, atol=1e-5)


@given(st.floats(-np.pi, np.pi))
def test_yaw_turns_forward_towards_left(yaw):
    forward = R.rotate(R.from_yaw(yaw), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(forward, [np.sin(yaw), 0.0, np.cos(yaw)], atol=1e-9)


def test_continuous_only_flips_signs():
    q = random_quaternions(3, (50, 4))
    result = R.continuous(q)
    assert np.all(np.sum(result[1:] * result[:-1], axis=-1) >= 0)
    same_rotation(result, q)


@given(quaternions())
def test_rotation_vectors_give_the_rotation_back(q):
    v = R.to_rotation_vector(q)
    assert np.all(np.linalg.norm(v, axis=-1) <= np.pi + 1e-9)
    same_rotation(R.from_rotation_vector(v), q)


def test_small_rotation_vectors_are_kept():
    v = np.array([[0.0, 0.0, 0.0], [1e-13, 0.0, 0.0], [0.0, 1e-6, -1e-6]])
    np.testing.assert_allclose(R.to_rotation_vector(R.from_rotation_vector(v)), v, rtol=1e-9, atol=1e-20)
