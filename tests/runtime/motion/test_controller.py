"""The shipped character is driven: speed, turning, stopping, response, determinism, style change, faults."""

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.motion import features
from runtime.motion.controller import Controller
from runtime.motion.model_files import run_graph
from runtime.motion.state import MAX_JOINT_SPEED_M_PER_S
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from tests.helpers.walker import WalkerModel

FORWARD = Controls((0.0, 1.0))


def drive(controller, controls, frames):
    return [controller.step(controls) for _ in range(frames)]


def speed(poses):
    path = np.array([p.root_position for p in poses])[:, [0, 2]]
    return np.linalg.norm(np.diff(path, axis=0), axis=1).mean() * 60


@pytest.mark.parametrize("gait", [Gait.JOG, Gait.CROUCH])
def test_root_keeps_the_asked_speed_and_direction(model, gait):
    controller = Controller(model, Terrain.flat(size_m=200.0))
    drive(controller, Controls((0.0, 1.0), gait=gait), 90)
    poses = drive(controller, Controls((0.0, 1.0), gait=gait), 60)
    assert speed(poses) == pytest.approx(controller.requested_speed, rel=0.15)
    assert abs(poses[-1].root_yaw) < 0.3


def test_feet_step_while_it_walks_and_it_stops_and_stays(model):
    controller = Controller(model, Terrain.flat())
    drive(controller, FORWARD, 40)
    poses = drive(controller, FORWARD, 70)
    assert speed(poses[30:]) == pytest.approx(controller.requested_speed, rel=0.15)
    assert abs(poses[-1].root_yaw) < 0.3
    assert (np.ptp([p.positions[[4, 9], 1] for p in poses], axis=0) > 0.03).all()
    assert 0.15 < (np.array([p.contacts for p in poses]) > 0.5).mean() < 0.9
    drive(controller, Controls(), 120)
    assert speed(drive(controller, Controls(), 20)) < 0.05


def test_it_turns_towards_the_stick(model):
    controller = Controller(model, Terrain.flat())
    drive(controller, FORWARD, 40)
    poses = drive(controller, Controls((1.0, 0.0)), 120)
    assert poses[-1].root_yaw == pytest.approx(np.pi / 2, abs=0.4)


def test_same_seed_same_bytes_and_bones_never_stretch(model, monkeypatch):
    monkeypatch.setattr("runtime.motion.model.run_graph", run_graph)  # without a memory
    runs = []
    for _ in range(2):
        runs.append(drive(Controller(model, make_terrain("hills"), seed=5), FORWARD, 60))
    for a, b in zip(*runs, strict=True):
        assert a.positions.tobytes() == b.positions.tobytes()
    parents = np.array(SPORT_SKELETON.parents[1:])
    for pose in runs[0]:
        bones = np.linalg.norm(pose.positions[1:] - pose.positions[parents], axis=-1)
        assert np.allclose(bones, np.linalg.norm(SPORT_SKELETON.offsets[1:], axis=-1), atol=1e-4)


def test_toes_stay_above_the_ground_on_stairs_and_hills(model):
    for name in ("stairs", "hills"):
        terrain = make_terrain(name)
        controller = Controller(model, terrain)
        toes = np.array([p.positions[[5, 10]] for p in drive(controller, FORWARD, 110)])
        sunk = terrain.height(toes[..., 0], toes[..., 2]) - toes[..., 1]
        assert np.percentile(sunk, 99) < 0.02


def test_a_style_blends_over_its_transition_and_changes_the_pose(model):
    z = 2.0 * np.random.default_rng(0).normal(size=(6, 64)).astype(np.float32)
    plain, styled = Controller(model, Terrain.flat()), Controller(model, Terrain.flat())
    drive(plain, FORWARD, 60), drive(styled, FORWARD, 60)
    styled.set_style(z, 0.5)
    first, other = styled.step(FORWARD), plain.step(FORWARD)
    assert np.abs(first.positions - other.positions).max() < 0.05  # no jump in the first frame
    drive(styled, FORWARD, 30), drive(plain, FORWARD, 30)
    assert np.allclose(styled.style.z, z)
    assert np.abs(styled.pose.local_rotations - plain.pose.local_rotations).max() > 0.02


def test_temperature_zero_ignores_the_seed(model):
    poses = [drive(Controller(model, Terrain.flat(), seed, 0.0), FORWARD, 20)[-1] for seed in (1, 2)]
    assert np.array_equal(poses[0].positions, poses[1].positions)
    warm = [drive(Controller(model, Terrain.flat(), seed, 1.0), FORWARD, 20)[-1] for seed in (1, 2)]
    assert not np.array_equal(warm[0].positions, warm[1].positions)


def test_a_network_that_gives_nan_is_reported_and_the_character_goes_on():
    controller = Controller(WalkerModel(broken_at=30), Terrain.flat())
    poses, said = [], []
    for _ in range(60):
        poses += drive(controller, FORWARD, 1)
        said.append(controller.message)
    assert [k for k, message in enumerate(said) if "not finite" in message] == [29]  # and not for ever
    assert all(np.isfinite(p.positions).all() for p in poses)


class LeapingModel(WalkerModel):
    """A walker whose network is elsewhere in frames 60 to 63: the body turned round and 0.3 m lower, or the root gone."""

    def __init__(self, part):
        super().__init__()
        self.part = part

    def step(self, x, noise, style):
        y, shown = super().step(x, noise, style)
        if 60 <= self.frame < 64:
            joints = y[0, features.OUTPUT["joint_positions"]].reshape(J, 3)
            turned = y[0, features.OUTPUT["joint_rotations"]].reshape(J, 6)
            if self.part == "pose":
                joints[0, 1] -= 0.3
                turned[:, [0, 1]] *= -1.0
                turned[:, [3, 4]] *= -1.0
            elif self.part == "root":
                y[0, features.OUTPUT["root"]] = 40.0
            else:
                y[:] = np.nan
        return y, shown


@pytest.mark.parametrize("part", ["pose", "root", "nothing finite"])
def test_no_joint_is_faster_than_a_captured_one_when_the_network_jumps(part):
    calm, leaping = (Controller(m, Terrain.flat(size_m=200.0)) for m in (WalkerModel(), LeapingModel(part)))
    last, speeds = leaping.pose.positions, []
    for frame in range(120):
        pose = leaping.step(FORWARD)
        assert frame >= 59 or (pose.positions == calm.step(FORWARD).positions).all()
        joints, _ = SPORT_SKELETON.forward_kinematics(pose.hips_position, pose.local_rotations)
        assert np.allclose(joints, pose.positions, atol=1e-4)
        speeds.append(np.linalg.norm(pose.positions - last, axis=-1).max() * features.FPS)
        last = pose.positions
    assert 10.0 < max(speeds) < 1.02 * MAX_JOINT_SPEED_M_PER_S
    assert max(speeds[-20:]) < 5.0


def test_a_character_begins_in_the_models_neutral_style():
    model = WalkerModel()
    model.neutral = np.full((6, 64), 0.3, np.float32)
    assert np.array_equal(Controller(model, Terrain.flat()).style.z, model.neutral)


def test_strength_changes_the_style_that_holds_and_those_that_come():
    model = WalkerModel()
    strengths = []
    fold = model.fold_style
    model.fold_style = lambda z, strength: strengths.append(strength) or fold(z, strength)
    controller = Controller(model, Terrain.flat(), strength=1.3)
    z = np.full((6, 64), 0.2, np.float32)
    controller.set_style(z, 0.0)
    controller.strength = 0.5
    assert np.array_equal(controller.style.z, z)
    controller.set_style(2 * z, 0.1)
    controller.step(Controls())
    assert strengths == [1.3, 1.3, 0.5, 0.5]
    assert controller.strength == 0.5
    assert Controller(model, Terrain.flat()).strength == 1.0


def test_settled_it_stands_in_its_style_and_sets_off_without_flying_hands(model):
    hands = [SPORT_SKELETON.index(side + "Hand") for side in ("Left", "Right")]
    z = model.neutral + 1.5 * np.random.default_rng(3).normal(size=(6, 64)).astype(np.float32)

    def fastest(settled):
        controller = Controller(model, Terrain.flat(size_m=200.0))
        controller.reset(1.0, 2.0, 0.5)
        controller.set_style(z, 0.0)
        if settled:
            assert np.allclose(controller.settle().root_position[[0, 2]], [1.0, 2.0])
        poses = drive(controller, FORWARD, 120)
        moved = np.linalg.norm(np.diff([p.positions[hands] for p in poses], axis=0), axis=-1) * 60
        assert np.allclose(poses[0].root_position[[0, 2]], [1.0, 2.0], atol=0.05)
        return moved[:10].max(), moved[80:].max()

    for settled in (True, False):
        begins, own = fastest(settled)
        assert begins < own
