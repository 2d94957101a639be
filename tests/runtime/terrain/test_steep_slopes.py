"""Slopes of 45 degrees and more: no knee flips over the hip, no foot is left behind over it, and no leg stays in the ground."""

import numpy as np
import pytest

from runtime.arrays import Array
from runtime.controls import Controls, Gait
from runtime.feet.ik import solve_legs
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.limbs import KEYFRAMED, LIMBS, MAX_TURN_RAD_PER_FRAME, Limb, resolve_penetration
from runtime.motion.state import standing
from runtime.rotations import angle_between
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from tests.helpers.shipped import shipped_model
from tests.helpers.walker import WalkerModel

LEG_JOINTS = [joint for limb in LIMBS[2:] for joint in (limb.lower, *limb.rest)]
ARMS = [18, 19, 20, 25, 26, 27]


def depth(terrain: Terrain, hips: Array, local: Array) -> float:
    """Metres that the deepest joint of the legs is under the ground."""
    joints = SPORT_SKELETON.forward_kinematics(hips, local)[0][LEG_JOINTS]
    return float((terrain.height(joints[:, 0], joints[:, 2]) - joints[:, 1]).max())


@pytest.mark.parametrize(("rise", "seed", "seconds"), [(1.0, 2, 3.5), (-1.0, 2, 3.7)])
def test_no_knee_flips_where_a_jogger_meets_a_slope_of_45_degrees(
    rise: float, seed: int, seconds: float
) -> None:
    heights = np.clip(np.linspace(-20.0, 20.0, 401) - 3.0, 0.0, 4.0) * rise
    controller = Controller(shipped_model(), Terrain.flat(), seed=seed)
    slope = np.tile(heights.astype(np.float32), (401, 1))
    controller.set_terrain(Terrain("slope", slope, 0.1, (-20.0, -20.0)))
    last, fastest = controller.pose.positions, 0.0
    for _ in range(round(seconds * FPS)):
        joints = controller.step(Controls((0.0, 1.0), None, Gait.JOG)).positions
        fastest = max(fastest, float(np.linalg.norm(joints - last, axis=-1).max()) * FPS)
        last = joints
    assert abs(float(controller.pose.root_position[1])) > 1.0  # it is on the slope
    assert fastest < 25.0


@pytest.mark.parametrize("limbs", [LIMBS, KEYFRAMED])
@pytest.mark.parametrize(
    ("rise", "degrees", "hips_m"), [(1.5, 90, 0.7), (1.5, 225, 0.6), (2.0, 135, 0.6), (3.0, 225, 0.8)]
)
def test_a_leg_that_hangs_in_a_slope_goes_round_to_where_it_has_room(
    rise: float, degrees: float, hips_m: float, limbs: tuple[Limb, ...]
) -> None:
    state = standing(WalkerModel(), Terrain.flat(), None, 0, 0.0, 0.0, 0.0)  # type: ignore[arg-type]
    hips, shown = state.poses.hips[0].astype(float), state.poses.local[0].astype(float)
    ways, angle = np.linspace(-4.0, 4.0, 81), np.radians(degrees)
    heights = rise * (np.cos(angle) * ways[:, None] + np.sin(angle) * ways[None])
    slope = Terrain("slope", heights.astype(np.float32), 0.1, (-4.0, -4.0))
    hips[1] = hips_m
    ankles = SPORT_SKELETON.forward_kinematics(hips, shown)[0][[4, 9]]
    ankles[:, 1] = slope.height(ankles[:, 0], ankles[:, 2]) + ANKLE_HEIGHT
    asked = solve_legs(hips, shown, ankles)
    assert depth(slope, hips, asked) < 0.2
    assert depth(slope, hips, shown) > 0.5
    asked[[18, 25]] = shown[[18, 25]] = (1.0, 0.0, 0.0, 0.0)  # arms to both sides
    for _ in range(8):
        before, shown = shown, resolve_penetration(hips, asked, shown, slope, limbs)
        assert angle_between(before, shown).max() < MAX_TURN_RAD_PER_FRAME + 1e-6
    assert depth(slope, hips, shown) < 0.2
    # a climber's, whose hands are on a wall: they leave it only where they are deep in it
    if limbs is KEYFRAMED:
        arms = SPORT_SKELETON.forward_kinematics(hips, asked)[0][18:31]
        deep = (slope.height(arms[:, 0], arms[:, 2]) - arms[:, 1]).max()
        assert deep > 0.15 or angle_between(shown[ARMS], asked[ARMS]).max() < 1e-3


def test_a_foot_is_out_of_a_wall_that_comes_under_it_in_the_first_frame() -> None:
    controller = Controller(WalkerModel(), Terrain.flat())  # type: ignore[arg-type]
    for _ in range(30):
        pose = controller.step(Controls((0.0, 1.0)))
    foot = pose.positions[4]
    heights = np.zeros((81, 81), np.float32)
    x, z = (round((float(v) + 4.0) / 0.1) for v in (foot[0], foot[2]))
    heights[x - 1 : x + 2, z - 1 : z + 2] = 0.75
    wall = Terrain("wall", heights, 0.1, (-4.0, -4.0))
    controller.set_terrain(wall)
    pose = controller.step(Controls((0.0, 1.0)))
    assert depth(wall, pose.hips_position, pose.local_rotations) < 0.25
