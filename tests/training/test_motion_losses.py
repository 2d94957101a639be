"""Losses of rollouts, the pace of straight walks, paths as a stick gives them, and the Analytic-DPM variance."""

import numpy as np
import pytest
import torch

from runtime import rotations
from runtime.controls import Gait
from runtime.motion.features import (
    FPS,
    INPUT,
    INPUT_SIZE,
    MOTION_INPUT_SIZE,
    OUTPUT,
    OUTPUT_SIZE,
    TRAJECTORY_OFFSETS,
    L,
)
from runtime.skeleton import SPORT_SKELETON, J
from tests.training.test_training import clips, frames, small_table  # noqa: F401
from training import losses
from training.batches import Normalisation
from training.export.pace import captured_paces, straight_speeds, style_speeds
from training.frames import LAYERED, FrameTable
from training.kinematics import KNEES, knee_flexion, shown_joints, turns
from training.networks.generator import Generator
from training.presets import preset
from training.rollouts import MOVEMENTS, RolloutLanes, steered
from training.session import Session
from training.stages.diffusion import estimate_variance
from training.stages.motion import MotionData, from_other_poses
from training.styles import StyleTable

pytestmark = pytest.mark.needs_torch


def test_steps_that_are_the_velocity_are_no_unrest_and_trembling_is():
    velocity, scale, kept = torch.full((4, 6), 0.8), torch.full((6,), 0.5), torch.ones(4, 6)
    assert losses.unrest(velocity.clone(), velocity, scale, kept) == 0.0
    assert torch.isclose(losses.unrest(velocity + 0.5, velocity, scale, kept), torch.tensor(1.0))
    assert losses.unrest(velocity + 0.5, velocity, scale, torch.zeros(4, 6)) == 0.0


def test_a_lane_that_predicts_the_truth_moves_by_its_velocity(frames, monkeypatch):  # noqa: F811
    monkeypatch.setattr("training.rollouts.FOREIGN_POSE_FRACTION", 0.0)
    rows = torch.tensor([100, 620])  # on a floor, and up a slope
    lanes = RolloutLanes(frames, 2, 1e9, iter([rows, rows, rows]))
    for k in range(3):
        assert lanes.age.tolist() == [k, k]
        truth = frames.outputs(rows + k, lanes.patch)
        moved = truth[:, OUTPUT["joint_positions"]] - lanes.previous_joints().flatten(1)
        assert torch.allclose(moved * FPS, truth[:, OUTPUT["joint_velocities"]], atol=0.15)
        lanes.advance(truth, truth)


def walk(speed: float, sideways: float = 0.0, frames: int = 240) -> tuple[np.ndarray, np.ndarray]:  # noqa: F811
    """x and y of a clip that goes on at one velocity; only what the pace is read from is filled."""
    x, y = np.zeros((frames, MOTION_INPUT_SIZE), np.float16), np.zeros((frames, OUTPUT_SIZE), np.float16)
    x[:, INPUT["gait"]].reshape(frames, L, -1)[:, :, Gait.WALK] = 1.0
    y[:, OUTPUT["root"]] = (sideways, speed, 0.0)
    return x, y


def table(items: list[tuple[str, str, float, float]]) -> FrameTable:
    parts = [walk(speed, sideways) for *_, speed, sideways in items]
    x, y = (np.concatenate(values) for values in zip(*parts, strict=True))
    count = len(items)
    nothing = np.zeros((len(x), 1), np.float32)
    return FrameTable(
        x, y, np.zeros((len(x), 1, 36), np.float16), nothing, nothing, np.zeros((len(x), 20, 6), np.int16),
        np.repeat(np.arange(count, dtype=np.int32), 240), 240 * np.arange(count + 1),
        [style for style, *_ in items], ["100style"] * count, [content for _, content, *_ in items],
        [str(k) for k in range(count)], np.zeros(count, bool), np.zeros(count, bool), np.ones(count, int),
    )  # fmt: skip


def test_a_style_is_as_fast_as_its_straight_forward_walk():
    clips_of = table(
        [
            ("angry", "walk forward", 1.375, 0.0),
            ("angry", "walk sideways", 0.0, 0.5),
            ("angry", "mixed transitions", 0.75, 0.0),
            ("angry", LAYERED, 2.0, 0.0),
            ("sad", "mixed walk jog", 0.625, 0.0),
        ]
    )
    found = straight_speeds(clips_of, Gait.WALK)
    np.testing.assert_allclose(found[[0, 2, 3, 4]], [1.375, 0.75, 2.0, 0.625], rtol=1e-3)
    assert np.isnan(found[1])
    assert captured_paces(clips_of, Gait.WALK) == {"angry": pytest.approx(1.375), "sad": pytest.approx(0.625)}


def test_the_pace_of_legs_stays_beside_the_arms_torso_and_head_of_others():
    styles = ["angry", "sad", "neutral", "tired"]
    clips_of = table([(name, "walk forward", 0.75 + 0.25 * k, 0.0) for k, name in enumerate(styles)])
    codes = torch.eye(4, 64)  # one direction a style, the same in every part
    index = torch.arange(4)[:, None, None].expand(4, 8, 6).clone()
    speeds = style_speeds(clips_of, StyleTable([codes] * 6, index), np.zeros(4, bool), ridge=0.01)
    own = np.tile(codes.numpy()[:, None], (1, 6, 1))
    others = own[::-1].copy()
    others[:, 2:4] = own[:, 2:4]
    paces = [0.75, 1.0, 1.25, 1.5]
    found = [codes.reshape(4, -1) @ speeds[:-1, 0] + speeds[-1, 0] for codes in (own, others)]
    np.testing.assert_allclose(found[0], paces, atol=0.02)
    np.testing.assert_allclose(found[1], paces, atol=0.05)


def test_the_variance_of_a_denoiser_that_knows_nothing_is_kept_within_its_bounds(frames, tmp_path):  # noqa: F811
    config = preset("tiny")
    torch.manual_seed(0)
    module = Generator(config).eval()
    ends = [value(size) for size in (INPUT_SIZE, OUTPUT_SIZE) for value in (torch.zeros, torch.ones)]
    normal = Normalisation(*ends)
    style = StyleTable([torch.zeros(1, 64)] * 6, torch.zeros((4, 8, 6), dtype=torch.long))
    weights = np.ones(len(frames.x)) / len(frames.x)
    data = MotionData(frames, normal, style, weights)
    found = estimate_variance(Session(tmp_path, half=False), data, module, batches=1)
    assert found.shape == (config.inference_steps,)
    assert (found >= 0.0).all()
    with torch.no_grad():
        rows = torch.arange(1, len(frames.x) - 1)
        patch = torch.zeros_like(rows)
        e, alpha = module.embed(data.input(rows, patch), data.styles(frames.clip[rows]))
        spread = module.target_codes(e, alpha, data.output(rows, patch)).var(0).mean()
    assert found.max() <= 1.5 * float(spread)


def test_shown_joints_are_those_of_the_skeleton():
    rng = np.random.default_rng(4)
    local = rotations.normalize(rng.normal(size=(5, J, 4)))
    hips = rng.normal(size=(5, 3))
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    y = np.zeros((5, OUTPUT_SIZE))
    y[:, OUTPUT["joint_positions"]] = rng.normal(size=(5, 3 * J))
    y[:, OUTPUT["joint_positions"]][:, :3] = hips
    y[:, OUTPUT["joint_rotations"]] = rotations.to_6d(world).reshape(5, -1)
    joints = shown_joints(torch.as_tensor(y, dtype=torch.float32))
    np.testing.assert_allclose(joints.numpy(), positions, atol=1e-4)


def test_swing_is_nothing_for_equal_energies_out_of_step_and_grows_with_less():
    phase = torch.linspace(0, 2 * torch.pi, 65)[:-1, None]
    kept, scale = torch.ones(64, 1), torch.ones(1)
    captured = phase.sin()
    assert losses.swing(phase.cos(), captured, scale, kept) < 1e-8
    shrunk = [float(losses.swing(s * phase.cos(), captured, scale, kept)) for s in (0.9, 0.7, 0.5)]
    assert 0 < shrunk[0] < shrunk[1] < shrunk[2]
    assert losses.swing(0.5 * captured, captured, scale, torch.zeros(64, 1)) == 0.0


def test_a_rollout_that_swings_less_than_its_own_clip_is_widened_and_one_that_swings_more_narrowed():
    own = torch.tensor([[0.5], [0.5]], requires_grad=True)
    energies = torch.tensor([[[0.25], [0.25]], [[1.0], [0.04]]])  # of the rollouts; of their clips
    scale, kept = torch.ones(1), torch.ones(2, 1)
    losses.own_swing(own, energies, scale, kept).backward()
    wider, narrower = own.grad[:, 0].tolist()
    assert wider < 0.0 < narrower  # the step is against the gradient
    even = torch.tensor([[0.5], [0.5]], requires_grad=True)
    losses.own_swing(even, torch.full((2, 2, 1), 0.25), scale, kept).backward()
    assert even.grad.abs().max() < 1e-6
    assert losses.own_swing(own, energies, scale, torch.zeros(2, 1)) == 0.0


def test_the_energies_of_lanes_are_means_since_they_settled_and_begin_anew_with_them(frames):  # noqa: F811
    rows = torch.full((64,), 200)
    lanes = RolloutLanes(frames, 2, 1e9, iter([rows, rows]))
    own, captured = torch.full((2, MOVEMENTS), 2.0), torch.ones(2, MOVEMENTS)
    assert not lanes.energies(own, captured, since=5).any()
    lanes.age += 5
    for _ in range(400):
        found = lanes.energies(own, captured, since=5)
    assert found[0].numpy() == pytest.approx(4.0, rel=1e-3)
    assert found[1].numpy() == pytest.approx(1.0, rel=1e-3)
    lanes._restart(torch.tensor([False, True]))
    assert lanes.energies(own, captured, since=500)[:, 0].all()
    assert not lanes.energies(own, captured, since=500)[:, 1].any()


def test_knees_out_of_step_bend_as_the_capture_does_and_half_bent_ones_do_not():
    phase = torch.linspace(0, 2 * torch.pi, 65)[:-1, None]
    captured = 0.6 + 0.6 * phase.sin()
    assert losses.distribution(captured.roll(16, 0), captured, losses.BEND_UNIT_RAD) < 1e-8
    bends = [0.6 + s * phase.sin() for s in (0.5, 0.3, 0.1)]
    shrunk = [float(losses.distribution(bend, captured, losses.BEND_UNIT_RAD)) for bend in bends]
    assert 0 < shrunk[0] < shrunk[1] < shrunk[2]
    assert losses.distribution(captured[:0], captured[:0], losses.BEND_UNIT_RAD) == 0.0


def test_the_flexion_of_a_knee_is_the_turn_of_the_shin_in_the_thigh():
    rng = np.random.default_rng(5)
    local = rotations.normalize(np.array([1.0, 0, 0, 0]) + 0.2 * rng.normal(size=(3, J, 4)))
    bends = np.array([[0.0, 1.2], [0.3, -0.05], [0.02, 0.7]])
    for side, knee in enumerate(KNEES):
        local[:, knee] = rotations.from_axis_angle(np.array([1.0, 0, 0]), bends[:, side])
    _, world = SPORT_SKELETON.forward_kinematics(np.zeros((3, 3)), local)
    y = np.zeros((3, OUTPUT_SIZE))
    y[:, OUTPUT["joint_rotations"]] = rotations.to_6d(world).reshape(3, -1)
    np.testing.assert_allclose(knee_flexion(torch.as_tensor(y)).numpy(), bends, atol=1e-6)


@pytest.mark.parametrize(
    ("axis", "entries"),
    [((0.0, 1.0, 0.0), [0, 2, 4, 7, 8]), ((1.0, 0.0, 0.0), [5]), ((0.0, 0.0, 1.0), [1, 3, 6])],
)
def test_turns_are_those_of_the_whole_body_about_up_left_and_forward(axis, entries):
    angle = 0.3
    turn = np.broadcast_to(rotations.from_axis_angle(np.array(axis), np.array(angle)), (J, 4))
    y = np.zeros((2, OUTPUT_SIZE))
    turned = np.stack([np.broadcast_to([1.0, 0, 0, 0], (J, 4)), turn])
    y[:, OUTPUT["joint_rotations"]] = rotations.to_6d(turned).reshape(2, -1)
    joints = np.stack([SPORT_SKELETON.rest_positions, rotations.rotate(turn, SPORT_SKELETON.rest_positions)])
    found = turns(torch.as_tensor(y), torch.as_tensor(joints))
    expected = np.zeros(9)
    expected[entries] = angle
    about = [k for k in range(9) if k not in (7, 8) or axis[1]]  # a foot's yaw is another where it leans
    np.testing.assert_allclose((found[1] - found[0]).numpy()[about], expected[about], atol=1e-6)


def test_a_rollout_that_is_off_on_average_is_drawn_back_and_one_that_is_out_of_step_is_not():
    away = torch.tensor([[1.0], [1.0]], requires_grad=True)
    offsets = torch.tensor([[1.0], [0.0]])
    losses.offset(away, offsets, torch.ones(1), torch.ones(2, 1)).backward()
    assert away.grad[0] > 0.0 == away.grad[1]


def test_the_offsets_of_lanes_are_means_since_they_settled(frames):  # noqa: F811
    rows = torch.full((64,), 200)
    lanes = RolloutLanes(frames, 2, 1e9, iter([rows, rows]))
    own, captured = torch.full((2, MOVEMENTS), 3.0), torch.ones(2, MOVEMENTS)
    assert not lanes.offsets(own, captured, since=5).any()
    lanes.age += 5
    for step in range(1000):
        found = lanes.offsets(own, captured + 10.0 * (-1) ** step, since=5)
    assert found.numpy() == pytest.approx(2.0, abs=0.3)


def test_what_is_fed_back_stays_within_the_capture_and_what_is_asked_for_does_not():
    x = torch.randn(200, INPUT_SIZE, generator=torch.Generator().manual_seed(0))
    normal = Normalisation.measure(x, torch.randn(200, OUTPUT_SIZE))
    most = normal.normalised(x).abs().amax(0)
    far = normal.normalised(100.0 * x).abs().amax(0)
    for name, field in INPUT.items():
        bounded = name in ("joint_velocities", "phase")
        assert torch.allclose(far[field], most[field]) == bounded, name


def test_a_share_of_captured_samples_comes_from_the_pose_of_another():
    x = torch.arange(1000.0)[:, None].repeat(1, INPUT_SIZE)
    before = x.clone()
    found = from_other_poses(x, 0.4)
    assert torch.equal(x, before)
    changed = found != x
    pose = torch.zeros(INPUT_SIZE, dtype=torch.bool)
    for name in ("joint_positions", "joint_velocities"):
        pose[INPUT[name]] = True
    rows = changed.any(1)
    assert 0.3 < rows.float().mean() < 0.5
    assert torch.equal(changed[rows], pose.expand(int(rows.sum()), -1))
    # positions and velocities of the same one
    assert (found[:, pose].amax(1) == found[:, pose].amin(1)).all()
    assert torch.equal(from_other_poses(x, 0.0), x)


def test_pairs_with_the_same_text_are_no_negatives():
    torch.manual_seed(2)
    motion = torch.randn(4, 8)
    text = motion.clone()
    text[1] = text[0]
    motion[1] = motion[0]
    same = torch.eye(4, dtype=torch.bool)
    punished = losses.contrastive(motion, text, same)
    same[0, 1] = same[1, 0] = True
    assert losses.contrastive(motion, text, same) < punished


# --- captured paths as a stick gives them: straight or round, without the sway of steps
TIME = np.asarray(TRAJECTORY_OFFSETS) / FPS


def one_path(across: np.ndarray, ahead: np.ndarray, yaw: np.ndarray, count: int = 400) -> torch.Tensor:
    """Rows of x with one path and facing."""
    x = torch.rand(1, INPUT_SIZE).expand(count, -1).clone()
    pairs = {"trajectory_positions": (across, ahead), "trajectory_directions": (np.sin(yaw), np.cos(yaw))}
    for name, pair in pairs.items():
        x[:, INPUT[name]] = torch.as_tensor(np.stack(pair, -1).ravel(), dtype=torch.float32)
    return x


def path(x: torch.Tensor) -> np.ndarray:
    return x[:, INPUT["trajectory_positions"]].reshape(len(x), L, 2).numpy()


def test_an_even_path_stays_and_so_does_all_that_is_no_path():
    x = one_path(0.1 * TIME**2, 1.3 * TIME, np.zeros(L))
    np.testing.assert_allclose(steered(x).numpy(), x.numpy(), atol=1e-5)


def test_the_sway_of_steps_shrinks_by_random_shares_and_some_rows_keep_it(monkeypatch):
    torch.manual_seed(0)
    x = one_path(0.03 * np.sin(2 * np.pi * TIME), 1.3 * TIME, 0.1 * np.sin(2 * np.pi * TIME))
    y = steered(x)
    sway = np.ptp(path(y)[..., 0], axis=1) / np.ptp(path(x)[..., 0], axis=1)
    assert 0.25 < (sway > 0.999).mean() < 0.45  # EXACT
    assert sway.min() < 0.6
    facing = y[:, INPUT["trajectory_directions"]].reshape(len(y), L, 2).norm(dim=-1)
    np.testing.assert_allclose(facing.numpy(), 1.0, atol=1e-5)
    monkeypatch.setattr("training.rollouts.EXACT_PATH_FRACTION", 1.0)
    assert torch.equal(steered(x)[:, INPUT["trajectory_positions"]], x[:, INPUT["trajectory_positions"]])
