"""Jumps: off the ground at once at any speed, thrown as a body is, given way to, over the ground that is there."""

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.motion.controller import Controller
from runtime.motion.model import MotionModel
from runtime.pose import FPS, Pose
from runtime.skeleton import TOE_HEIGHT
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import load_terrain
from runtime.traversal.jump import Jump

TOES = (5, 10)
STAND, WALK, JOG = Controls(), Controls((0.0, 1.0)), Controls((0.0, 1.0), gait=Gait.JOG)
PRESSED = 4  # frames


def ready(model: MotionModel, stick: Controls, frames: int, terrain: Terrain | None = None) -> Controller:
    """A character that has gone on for so long."""
    controller = Controller(model, terrain or load_terrain("flat"), seed=1)
    for _ in range(frames):
        controller.step(stick)
    return controller


def jump(controller: Controller, stick: Controls, frames: int = 80) -> list[Pose]:
    """Poses from the button on."""
    pressed = Controls(stick.move, stick.facing, Gait.JUMP)
    return [controller.step(pressed if k < PRESSED else stick) for k in range(frames)]


def soles(poses: list[Pose], terrain: Terrain | None = None) -> np.ndarray:
    """Heights `(T, 2)` of the toes over their resting ones."""
    toes = np.array([pose.positions[list(TOES)] for pose in poses], np.float64)
    ground = 0.0 if terrain is None else terrain.height(toes[..., 0], toes[..., 2])
    return toes[..., 1] - ground - TOE_HEIGHT


@pytest.mark.parametrize(("stick", "frames"), [(STAND, 20), (WALK, 80), (JOG, 110)])
def test_a_jump_leaves_the_ground_at_once_flies_as_a_body_and_gives_way(
    stick: Controls, frames: int, model: MotionModel
) -> None:
    controller = ready(model, stick, frames)
    before = [controller.step(stick) for _ in range(40)]
    poses = jump(controller, stick)
    height = np.array([pose.hips_position[1] for pose in poses], np.float64)
    usual = float(np.median([pose.hips_position[1] for pose in before]))
    top = int(height.argmax())
    off = (soles(poses) > 0.04).all(-1)
    first = top - int(np.argmin(off[top::-1])) + 1
    last = top + int(np.argmin(off[top:]))
    assert first / FPS <= 0.3
    assert height[top] - usual > 0.25
    fall = np.polyfit(np.arange(first, last) / FPS, height[first:last], 2)[0] * 2.0
    assert -10.6 < fall < -9.0
    assert 0.04 < usual - height[last : last + 30].min() < 0.2
    assert abs(height[-1] - usual) < 0.08  # and comes back
    way = np.array([pose.root_position[[0, 2]] for pose in (*before, *poses)], np.float64)
    speed = np.linalg.norm(np.diff(way, axis=0), axis=-1) * FPS
    flown, gone = speed[40 + first : 40 + last].mean(), speed[:40].mean()
    assert flown > 0.85 * gone - 0.05
    knees = np.array([_flexions(pose) for pose in (*before[-2:], *poses)])
    assert np.abs(np.diff(knees, n=2, axis=0)).max() < 8.0
    left, right = poses[top].positions[list(TOES)][:, 2]
    assert stick is not JOG or abs(left - right) > 0.6  # the feet of a leap are apart


def _flexions(pose: Pose) -> list[float]:
    points = pose.positions.astype(np.float64)
    angles = []
    for hip, knee, ankle in ((2, 3, 4), (7, 8, 9)):
        a, b = points[knee] - points[hip], points[ankle] - points[knee]
        angles.append(float(np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)))))
    return angles


def test_one_press_is_one_jump_and_a_jog_stays_a_jog(model: MotionModel) -> None:
    controller = ready(model, STAND, 10)
    pressed = Controls(gait=Gait.JUMP)
    height = [float(controller.step(pressed).hips_position[1]) for _ in range(110)]
    assert max(height[75:]) - height[0] < 0.1, "held down it does not jump again"
    controller = ready(model, JOG, 60)
    jump(controller, JOG, PRESSED)
    assert controller.state.wished_speed[0] == pytest.approx(controller.full_speed(Gait.JOG))


def test_a_jump_comes_down_on_the_ground_that_is_there(model: MotionModel) -> None:
    hills = load_terrain("hills")
    heights = soles(jump(ready(model, WALK, 80, hills), WALK), hills)
    assert heights.min() > -0.03
    assert np.abs(heights[55:]).min() < 0.02


def test_in_a_flight_the_ground_changes_and_a_fall_from_a_cliff_ends_in_a_squat(model: MotionModel) -> None:
    high = Terrain("high", np.full((3, 3), 12.0, np.float32), 40.0, (-40.0, -40.0))
    controller = ready(model, STAND, 20, high)
    jump(controller, STAND, 25)
    controller.set_terrain(load_terrain("flat"))
    assert 0.6 < min(controller.step(STAND).hips_position[1] for _ in range(60)) < 1.3
    fall = Jump(stage="flight", begin=(13.0, 0.1))
    hips = []
    for _ in range(150):
        fall.advance(0.95, 0.0, (0.0, 0.0))
        hips.append(fall.hips)
    assert 0.4 < min(hips) < 0.6
    assert hips[-1] == pytest.approx(0.95, abs=0.01)
