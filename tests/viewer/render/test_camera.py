"""Cameras: geometry of view and ray, mouse and stick, springs, staying above ground."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.helpers.render_scene import hills
from viewer.render.camera import Camera, FollowCamera, OrbitCamera
from viewer.render.frame import make_frame

yaws = st.floats(-math.pi, math.pi)
pitches = st.floats(-0.3, 1.4)
distances = st.floats(0.7, 40.0)
ndc = st.floats(-0.95, 0.95)


@given(yaws, pitches, distances)
def test_view_is_a_rigid_motion_that_looks_at_the_target(yaw: float, pitch: float, distance: float) -> None:
    view = OrbitCamera((1.0, 2.0, -3.0), yaw, pitch, distance).view_matrix().astype(float)
    np.testing.assert_allclose(view[:3, :3] @ view[:3, :3].T, np.eye(3), atol=1e-5)
    assert np.linalg.det(view[:3, :3]) == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(view @ [1.0, 2.0, -3.0, 1.0], [0, 0, -distance, 1], atol=1e-4 * distance)


@given(yaws, pitches, distances)
def test_heading_is_the_ground_direction_of_the_view(yaw: float, pitch: float, distance: float) -> None:
    camera = OrbitCamera((0.0, 1.0, 0.0), yaw, pitch, distance)
    looked = camera.target - camera.position
    apart = math.remainder(math.atan2(looked[0], looked[2]) - camera.yaw, math.tau)
    assert apart == pytest.approx(0, abs=1e-6)


def view_ray(camera: Camera, x: float, y: float, aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Origin `(3,)` and unit direction `(3,)` through a point of the screen, both -1..1, y up."""
    tangent = math.tan(camera.fov_y / 2)
    local = np.array([(x - camera.shift) * tangent * aspect, y * tangent, -1.0])
    direction = camera.view_matrix()[:3, :3].T.astype(float) @ local
    return camera.position, direction / np.linalg.norm(direction)


@given(yaws, pitches, ndc, ndc, st.floats(0.5, 3.0), st.sampled_from([0.0, 0.4]))
def test_ray_goes_through_the_point_that_projects_there(yaw, pitch, x, y, aspect, shift) -> None:
    camera = OrbitCamera((0.5, 1.0, 0.2), yaw, pitch, 5.0)
    camera.shift = shift
    origin, direction = view_ray(camera, x, y, aspect)
    point = np.append(origin + 3.0 * direction, 1.0)
    clip = camera.projection_matrix(aspect).astype(float) @ camera.view_matrix().astype(float) @ point
    np.testing.assert_allclose(clip[:2] / clip[3], [x, y], atol=1e-4)


def test_a_shifted_camera_shows_its_target_there_and_the_same_sky_behind() -> None:
    camera = OrbitCamera((0.5, 1.0, 0.2), 0.7, 0.2, 5.0)
    camera.shift = 0.4
    clip = camera.projection_matrix(1.5) @ camera.view_matrix() @ np.append(camera.target, 1.0)
    np.testing.assert_allclose(clip[:2] / clip[3], [0.4, 0.0], atol=1e-5)
    frame = make_frame(camera, (150, 100), [], 0.0, 512)
    right, up, forward = np.frombuffer(frame.uniforms[128:], np.float32).reshape(7, 4)[1:4, :3]
    for x, y in ((-1.0, 0.5), (0.4, 0.0), (1.0, -1.0)):  # as sky.frag finds its rays
        ray = forward + x * right + y * up
        np.testing.assert_allclose(ray / np.linalg.norm(ray), view_ray(camera, x, y, 1.5)[1], atol=1e-5)


def test_character_facing_away_has_its_left_on_the_left_of_the_picture() -> None:
    # looks along +Z, where the character's left is +X
    camera = OrbitCamera((0.0, 1.0, 0.0), yaw=0.0, pitch=0.1)
    clip = camera.projection_matrix(1.0) @ camera.view_matrix() @ np.array([0.5, 1.0, 0.0, 1.0])
    assert clip[0] / clip[3] < 0


def test_orbit_drags_the_scene() -> None:
    camera = OrbitCamera(yaw=0.0, pitch=0.2)
    near = np.array([0.0, 0.9, -1.0, 1.0])  # on the eye's side of the target
    before = camera.view_matrix() @ near
    camera.orbit(40, 30)
    after = camera.view_matrix() @ near
    assert after[0] > before[0], "what is near follows the pointer to the right"
    assert camera.pitch > 0.2, "a drag down shows the scene from above"
    camera.orbit(0, 1e6)
    assert camera.pitch == camera.MAX_PITCH


@given(yaws, pitches, st.floats(-200, 200), st.floats(-200, 200))
def test_pan_keeps_the_target_under_the_pointer(yaw: float, pitch: float, dx: float, dy: float) -> None:
    camera = OrbitCamera((0.0, 1.0, 0.0), yaw, pitch, 4.0)
    held = np.append(camera.target, 1.0)
    camera.pan(dx, dy, 720.0)
    clip = camera.projection_matrix(1.0).astype(float) @ camera.view_matrix().astype(float) @ held
    np.testing.assert_allclose(clip[:2] / clip[3] * 360.0, [dx, -dy], atol=0.05)


def test_zoom_stays_in_range() -> None:
    camera = OrbitCamera(distance=4.0)
    camera.zoom(3)
    assert camera.distance < 4.0
    camera.zoom(1000)
    assert camera.distance == camera.MIN_DISTANCE
    camera.zoom(-1000)
    assert camera.distance == camera.MAX_DISTANCE


def test_follow_camera_arrives_at_its_target_and_keeps_its_heading() -> None:
    camera = FollowCamera(yaw=0.7)
    for _ in range(180):
        camera.update(np.array([3.0, 1.0, 2.0]), 1 / 60)
    np.testing.assert_allclose(camera.target, [3.0, 1.0, 2.0], atol=1e-3)
    assert camera.yaw == pytest.approx(0.7)


def test_stick_turns_right_and_alignment_waits_for_it() -> None:
    camera = FollowCamera(yaw=0.0)
    for _ in range(30):
        camera.update(np.zeros(3), 1 / 60, stick=(1.0, 0.0), align_yaw=1.0)
    assert camera.yaw < -0.5, "right is towards -X when looking along +Z"
    turned = camera.yaw
    for _ in range(600):
        camera.update(np.zeros(3), 1 / 60, align_yaw=turned + 0.8)
    assert camera.yaw == pytest.approx(turned + 0.8, abs=0.05)


def test_follow_camera_stays_above_hills_and_sees_its_target() -> None:
    terrain = hills()
    camera = FollowCamera(pitch=0.0, distance=5.0)
    for step in range(400):
        x, z = 0.05 * step - 10.0, 4.0 * math.sin(0.02 * step)
        target = np.array([x, float(terrain.height(x, z)) + 0.9, z])
        camera.update(target, 1 / 60, stick=(0.4, 0.3), terrain=terrain)
        eye = camera.position
        assert eye[1] > float(terrain.height(eye[0], eye[2])) + 0.09


def test_snap_leaves_no_motion() -> None:
    camera = FollowCamera()
    camera.update(np.array([50.0, 1.0, 0.0]), 1 / 60)
    camera.snap(np.array([1.0, 1.0, 1.0]))
    camera.update(np.array([1.0, 1.0, 1.0]), 1 / 60)
    np.testing.assert_allclose(camera.target, [1.0, 1.0, 1.0], atol=1e-9)
