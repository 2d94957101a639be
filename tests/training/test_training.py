"""Frames from clips, and rollout lanes on them."""

import numpy as np
import pytest
import torch

from runtime.motion import features
from runtime.motion.features import INPUT, OUTPUT
from runtime.skeleton import REST_HIPS_HEIGHT
from tests.helpers.synthetic_clips import LENGTH_FRAMES, SPEED_M_PER_S, write_clip
from training.batches import FrameTensors
from training.frames import clip_frames, load_frames
from training.rollouts import RolloutLanes
from training.sampling import sampling_weights

pytestmark = pytest.mark.needs_torch


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    write_clip(folder / "a.npz", "neutral", 0.0)
    write_clip(folder / "b.npz", "angry", 1.1)
    write_clip(folder / "c.npz", "neutral", 0.0, slope=0.2)
    write_clip(folder / "d.npz", "angry", 0.3, held_out=True)
    return folder


@pytest.fixture(scope="module")
def small_table(clips, tmp_path_factory):
    return load_frames(clips, tmp_path_factory.mktemp("frames"))


@pytest.fixture
def frames(small_table) -> FrameTensors:
    phase = np.random.default_rng(0).normal(size=(len(small_table), 5, 2)).astype(np.float32)
    return FrameTensors.of(small_table, phase, torch.device("cpu"))


@pytest.mark.parametrize("name", ["a", "b"])
def test_root_relative_features_do_not_know_where_the_clip_heads(clips, name):
    frames = clip_frames(clips / f"{name}.npz")
    middle = LENGTH_FRAMES // 2
    y = features.split_output(frames.y[middle].astype(np.float32))
    assert y.root == pytest.approx([0.0, SPEED_M_PER_S, 0.0], abs=5e-3)
    assert y.trajectory_positions[-1] == pytest.approx([0.0, SPEED_M_PER_S * 50 / 60], abs=5e-3)
    path = frames.x[middle].astype(np.float32)[INPUT["trajectory_positions"]].reshape(12, 2)
    assert path[:, 1] == pytest.approx(SPEED_M_PER_S * features.TRAJECTORY_OFFSETS / 60, abs=5e-3)
    assert y.joint_positions[0] == pytest.approx([0.0, REST_HIPS_HEIGHT, 0.0], abs=5e-3)
    assert np.linalg.norm(y.joint_velocities[0]) == pytest.approx(SPEED_M_PER_S, abs=5e-3)


def test_next_input_holds_the_pose_of_this_output(clips):
    """What the runtime feeds back is what training showed: x_{i+1} carries j_i of y_i."""
    frames = clip_frames(clips / "b.npz")
    for name in ("joint_positions", "joint_velocities"):
        assert np.array_equal(frames.x[101][INPUT[name]], frames.y[100][OUTPUT[name]])


def test_heights_are_relative_to_the_mean_ground_of_the_window(clips):
    frames = clip_frames(clips / "c.npz")
    middle = LENGTH_FRAMES // 2
    heights = frames.heights[middle, 0].astype(np.float32).reshape(12, 3)
    assert heights[:, 1].mean() == pytest.approx(0.0, abs=2e-3)
    run = SPEED_M_PER_S * 10 / 60
    assert np.diff(heights[:, 1]) == pytest.approx(np.full(11, 0.2 * run), abs=3e-3)


def test_held_out_clips_are_never_drawn(small_table):
    table = small_table
    weights = sampling_weights(table)
    assert weights.sum() == pytest.approx(1.0)
    assert weights[table.held_out[table.clip]].sum() == 0
    assert weights[table.start[:-1]].sum() == 0


def test_a_lane_that_predicts_the_truth_sees_captured_frames(frames, monkeypatch):
    monkeypatch.setattr("training.rollouts.FOREIGN_POSE_FRACTION", 0.0)
    rows = torch.tensor([100, 400])
    lanes = RolloutLanes(frames, 2, 1e9, iter([rows, rows]))
    for k in range(5):
        expected = frames.inputs(rows + k, lanes.patch)
        ours = lanes.inputs()
        pose = slice(0, INPUT["gait"].stop)
        assert torch.allclose(ours[:, pose], expected[:, pose], atol=2e-3)
        truth = frames.outputs(rows + k, lanes.patch)
        lanes.advance(truth, truth)


def test_lanes_can_begin_in_the_pose_of_another_clip(frames, monkeypatch):
    monkeypatch.setattr("training.rollouts.FOREIGN_POSE_FRACTION", 1.0)
    rows = torch.arange(100, 164)
    lanes = RolloutLanes(frames, 64, 1e9, iter([rows]))
    pose = INPUT["joint_positions"]
    own = frames.inputs(rows, lanes.patch)[:, pose]
    begun = lanes.inputs()[:, pose]
    assert not torch.allclose(begun, own)
    assert torch.allclose(begun.sum(0), own.sum(0), atol=0.1)  # the same poses in another order


def test_lanes_restart_at_the_end_of_their_clip(frames):
    end, y = int(frames.last[0]), torch.zeros(1, 473)
    rows = [torch.tensor([row]) for row in (end - 6, 40, 50)]
    lanes = RolloutLanes(frames, 1, 1e9, iter(rows))
    seen = []
    for _ in range(9):
        lanes.draw()
        seen.append(int(lanes.rows[0]))
        lanes.advance(y, y)
    # every fourth frame, before the end
    assert seen == [end - 6, end - 5, end - 4, end - 3, 40, 41, 42, 43, 44]
