"""A clip becomes a stick: its path, speed, facing and gaits, and what a walker makes of them."""

from dataclasses import replace

import numpy as np
import pytest

from runtime import rotations
from runtime.controls import Gait
from runtime.motion.controller import Controller
from runtime.pose import FPS
from runtime.skeleton import J
from runtime.takes.clip import Clip
from runtime.takes.input_recording import StyleChange, resimulate
from runtime.takes.metadata import PromptEvent
from runtime.takes.restyle import LEAD_IN_FRAMES, path_error, requests_of, restyled
from runtime.terrain.library import load_terrain
from tests.helpers.walker import WalkerModel

Z = np.zeros((6, 64), np.float32)


def clip_along(places: np.ndarray, yaw: np.ndarray, height: np.ndarray | float = 0.95) -> Clip:
    """A body that stands stiff, moved along places `(T, 2)` and turned by yaws `(T,)`."""
    count = len(places)
    hips = np.stack([places[:, 0], np.broadcast_to(height, count), places[:, 1]], -1).astype(np.float32)
    local = np.zeros((count, J, 4), np.float32)
    local[..., 0] = 1.0
    local[:, 0] = rotations.from_yaw(yaw)
    return Clip("led", float(FPS), hips, local, np.ones((count, 4), np.float32))


def straight(speed: float, seconds: float = 4.0, **options: float) -> Clip:
    at = np.arange(round(seconds * FPS)) / FPS
    return clip_along(np.stack([np.zeros_like(at), speed * at], -1), np.zeros_like(at), **options)


def crouched(clip: Clip) -> Clip:
    """The clip on bent legs, over the same ground."""
    local, hips, angle = clip.local_rotations.copy(), clip.hips_positions.copy(), np.radians(48.0)
    for thigh, shin in ((2, 3), (7, 8)):
        local[:, thigh] = rotations.from_rotation_vector(np.array([-angle, 0.0, 0.0]))
        local[:, shin] = rotations.from_rotation_vector(np.array([2.0 * angle, 0.0, 0.0]))
    feet = clip.world()[0][:, [4, 9], 1] - replace(clip, local_rotations=local).world()[0][:, [4, 9], 1]
    hips[:, 1] += feet.mean(1)
    return replace(clip, local_rotations=local, hips_positions=hips)


@pytest.mark.parametrize(
    ("clip", "gait"),
    [
        (straight(1.2), Gait.WALK),
        (straight(3.0), Gait.JOG),
        (straight(0.0), Gait.STAND),
        (crouched(straight(0.6)), Gait.CROUCH),
    ],
    ids=["walk", "jog", "stand", "crouch"],
)
def test_gaits_follow_from_speed_and_height(clip: Clip, gait: Gait) -> None:
    found = requests_of(clip)
    assert (found.gaits == gait).mean() > 0.9
    assert len(found.path) == len(clip) + LEAD_IN_FRAMES


def test_a_jump_is_pressed_before_the_body_leaves_the_ground() -> None:
    clip = straight(1.2)
    air = np.clip(np.sin(np.linspace(0.0, np.pi, 30)), 0.0, 1.0) * 0.3
    hips = clip.hips_positions.copy()
    hips[100:130, 1] += air
    found = requests_of(replace(clip, hips_positions=hips)).gaits[LEAD_IN_FRAMES:]
    jumps = np.flatnonzero(found == Gait.JUMP)
    assert 80 <= jumps[0] < 104
    assert 120 <= jumps[-1] < 132


def test_the_lead_in_comes_from_where_the_clip_comes() -> None:
    found = requests_of(straight(1.5))
    assert found.path[0, 1] == pytest.approx(-1.5 * LEAD_IN_FRAMES / FPS, abs=0.02)
    assert found.velocity[0] == pytest.approx([0.0, 1.5], abs=0.02)


def test_a_body_that_goes_sideways_keeps_its_facing() -> None:
    at = np.arange(240) / FPS
    sideways = clip_along(np.stack([at, np.zeros_like(at)], -1), np.zeros_like(at))
    assert requests_of(sideways).facing.all()
    assert not requests_of(straight(1.0)).facing.any()


def test_a_walker_keeps_to_the_path_and_the_time_and_can_be_resimulated() -> None:
    at = np.arange(360) / FPS
    yaw = 0.4 * np.sin(0.8 * at)
    velocity = 1.3 * np.stack([np.sin(yaw), np.cos(yaw)], -1)
    clip = clip_along(np.cumsum(velocity, axis=0) / FPS, yaw)
    controller = Controller(WalkerModel(), load_terrain("flat"), 3)
    made, inputs = restyled(clip, controller, StyleChange(0, Z, 0.0, PromptEvent(0.0, "a walker")))
    assert (len(made), made.prompts[0].prompt) == (len(clip), "a walker")
    error = path_error(made, clip)
    assert error.path_m < 0.15
    assert error.time_s < 0.15
    again, _ = resimulate(inputs, Controller(WalkerModel(), load_terrain("flat"), 3), 0)
    shown = np.stack([pose.hips_position for pose in again])
    assert np.abs(shown[:, [0, 2]] - made.hips_positions[:, [0, 2]]).max() < 0.3


def test_the_error_is_that_of_a_clip_that_lags() -> None:
    clip = straight(1.2)
    late = replace(clip, hips_positions=clip.hips_positions - np.array([0.1, 0.0, 0.36], np.float32))
    error = path_error(late, clip)
    assert error.path_m == pytest.approx(0.1, abs=0.02)
    assert error.time_s == pytest.approx(0.3, abs=0.03)
