"""Frames from clips, rollout lanes, and the whole pipeline on two small synthetic clips."""

import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnxscript")

from runtime.controls import Controls  # noqa: E402
from runtime.motion import features  # noqa: E402
from runtime.motion.controller import Controller  # noqa: E402
from runtime.motion.features import INPUT, OUTPUT  # noqa: E402
from runtime.motion.model import load_model  # noqa: E402
from runtime.motion.model_files import exact_8_bit_products  # noqa: E402
from runtime.skeleton import PART_NAMES, REST_HIPS_HEIGHT  # noqa: E402
from runtime.terrain.height_map import Terrain  # noqa: E402
from tests.helpers.synthetic_clips import LENGTH, SPEED, write_clip  # noqa: E402
from training.augmentation.sentences import longer_sentences  # noqa: E402
from training.batches import FrameTensors  # noqa: E402
from training.frames import clip_frames, load_frames  # noqa: E402
from training.pipeline import main  # noqa: E402
from training.rollouts import RolloutLanes  # noqa: E402
from training.sampling import sampling_weights  # noqa: E402
from training.stages import motion as stage_motion  # noqa: E402


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
    middle = LENGTH // 2
    y = features.split_output(frames.y[middle].astype(np.float32))
    assert y.root == pytest.approx([0.0, SPEED, 0.0], abs=5e-3)
    assert y.trajectory_positions[-1] == pytest.approx([0.0, SPEED * 50 / 60], abs=5e-3)
    x = frames.x[middle].astype(np.float32)
    path = x[INPUT["trajectory_positions"]].reshape(12, 2)
    assert path[:, 1] == pytest.approx(SPEED * features.TRAJECTORY_OFFSETS / 60, abs=5e-3)
    assert y.joint_positions[0] == pytest.approx([0.0, REST_HIPS_HEIGHT, 0.0], abs=5e-3)
    assert np.linalg.norm(y.joint_velocities[0]) == pytest.approx(SPEED, abs=5e-3)


def test_next_input_holds_the_pose_of_this_output(clips):
    """What the runtime feeds back is what training showed: x_{i+1} carries j_i of y_i."""
    frames = clip_frames(clips / "b.npz")
    for name in ("joint_positions", "joint_velocities"):
        assert np.array_equal(frames.x[101][INPUT[name]], frames.y[100][OUTPUT[name]])


def test_heights_are_relative_to_the_mean_ground_of_the_window(clips):
    frames = clip_frames(clips / "c.npz")
    middle = LENGTH // 2
    heights = frames.heights[middle, 0].astype(np.float32).reshape(12, 3)
    assert heights[:, 1].mean() == pytest.approx(0.0, abs=2e-3)
    run = SPEED * 10 / 60
    assert np.diff(heights[:, 1]) == pytest.approx(np.full(11, 0.2 * run), abs=3e-3)


def test_held_out_clips_are_never_drawn(small_table):
    table = small_table
    weights = sampling_weights(table)
    assert weights.sum() == pytest.approx(1.0)
    assert weights[table.held_out[table.clip]].sum() == 0
    assert weights[table.start[:-1]].sum() == 0


def test_a_lane_that_predicts_the_truth_sees_captured_frames(frames, monkeypatch):
    monkeypatch.setattr("training.rollouts.FOREIGN_POSE", 0.0)
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
    monkeypatch.setattr("training.rollouts.FOREIGN_POSE", 1.0)
    rows = torch.arange(100, 164)
    lanes = RolloutLanes(frames, 64, 1e9, iter([rows]))
    pose = INPUT["joint_positions"]
    own = frames.inputs(rows, lanes.patch)[:, pose]
    begun = lanes.inputs()[:, pose]
    assert not torch.allclose(begun, own)
    assert torch.allclose(begun.sum(0), own.sum(0), atol=0.1)  # the same poses in another order


def test_lanes_restart_at_the_end_of_their_clip(frames):
    end = int(frames.last[0])
    lanes = RolloutLanes(frames, 1, 1e9, iter([torch.tensor([end - 1]), torch.tensor([50])]))
    lanes.advance(torch.zeros(1, 473), torch.zeros(1, 473))
    assert lanes.rows.tolist() == [50]


def arguments(clips: Path, out: Path) -> list[str]:
    common = {"preset": "tiny", "clips": clips, "out": out, "batch": 16, "device": "cpu"}
    return [text for key, value in common.items() for text in (f"--{key}", str(value))]


@pytest.fixture
def short_work(monkeypatch):
    """What takes long without being another case: all longer sentences, variances of many batches, six courses."""
    few = [s for part in PART_NAMES for s in longer_sentences() if s.part == part][::60]
    monkeypatch.setattr("training.stages.words.longer_sentences", lambda: few)
    for name in ("estimate_variance", "measure_codes"):
        monkeypatch.setattr(stage_motion, name, partial(getattr(stage_motion, name), batches=1))
    courses = (("a proud queen", "random", "jog", "flat"),)
    monkeypatch.setattr("training.export.quantize.COURSES", courses)


def test_the_whole_pipeline_from_clips_to_a_character_that_can_be_driven(
    clips, tmp_path, short_work, monkeypatch, caplog
):
    clips = shutil.copytree(clips, tmp_path / "clips")
    out = tmp_path / "run"
    common = arguments(clips, out)
    steps = {"phase": 2, "content": 2, "words": 2, "stage2": 3, "stage3": 3, "ground": 2}
    crossed, measured = [], []

    def cross(model: Path, folder: Path, *_: object) -> dict[str, int]:
        """In place of walks over courses, which this network cannot do: two clips."""
        crossed.append(load_model(model).name)
        folder.mkdir(parents=True)
        for name in "ac":
            shutil.copy(clips / f"{name}.npz", folder)
        return {"stairs kept": 2}

    monkeypatch.setattr("training.courses.make_all", cross)
    monkeypatch.setattr("training.pipeline.measure_traversals", measured.append)
    counts = [f"--{stage}-steps={count}" for stage, count in steps.items()]
    assert main(["all", *common, *counts, "--layers", "0", "--course-minutes", "1"]) == 0
    assert len(crossed) == 1
    assert measured == [out / "model"]
    before, after = (torch.load(out / f"{stage}_final.pt")["module"] for stage in ("stage3", "ground"))
    changed = {name.split(".")[0] for name in before if not torch.equal(before[name], after[name])}
    assert changed == {"encoder", "modulator", "mixture_decoder"}
    model = load_model(out / "model")
    if exact_8_bit_products():
        assert load_model(out / "model", precision="int8").metadata["quantised"]["relative_error"] > 0.0
    else:
        assert "without an 8-bit twin" in caplog.text
    assert (out / "model" / "README.md").read_text().startswith("# Model")
    poses = []
    for _ in range(2):
        controller = Controller(model, Terrain.flat(), seed=3)
        poses.append([controller.step(Controls((0.0, 1.0))) for _ in range(20)])
    for first, second in zip(*poses, strict=True):
        assert np.isfinite(first.positions).all()
        assert first.local_rotations.tobytes() == second.local_rotations.tobytes()


def test_a_stage_resumes_where_it_stopped(clips, tmp_path, caplog):
    out = tmp_path / "run"
    common = arguments(clips, out)
    main(["phase", *common, "--phase-steps", "2"])
    (out / "phase.npy").unlink()
    (out / "phase_final.pt").unlink()
    with caplog.at_level("INFO"):
        main(["phase", *common, "--phase-steps", "3"])
    assert "resumed at step 2" in caplog.text
