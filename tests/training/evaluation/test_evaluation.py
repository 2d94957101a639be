"""The evaluation from clip files to tables, with a synthetic walker in the place of captured people and of a model."""

import json
import threading

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.controls import Gait
from runtime.errors import FileError, SportError, UsageError
from runtime.motion.features import INPUT, OUTPUT
from runtime.terrain.height_map import Terrain
from tests.helpers.synthetic_clips import save_motion
from tests.helpers.walker import WalkerModel, walk
from training.evaluation.command import MOTION, main
from training.evaluation.metrics.motion import load_motion
from training.evaluation.motion import driving, evaluated_model, scores
from training.evaluation.motion.capture import (
    TERRAIN_GROUP,
    Options,
    driving_segments,
    make_plan,
    read_capture,
)
from training.evaluation.motion.driving import RingWalk, Take, follow, replay, requests_of, run_ring
from training.evaluation.motion.evaluated_model import style_texts
from training.evaluation.motion.scores import score_held_out, score_model
from training.evaluation.motion.tables import check, markdown
from training.frames import clip_frames

Z = np.zeros((6, 64), np.float32)


def write_clip(folder, name, style, frames=300, held_out=False, share=1.0, **changes):
    split = "held_out" if held_out else "train"
    save_motion(folder, name, walk(frames, speed_share=share), style=style, split=split, **changes)


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    for number in range(6):
        held_out = number == 0
        write_clip(folder, f"a_{number}", "neutral", held_out=held_out, share=0.95 + 0.02 * number)
        write_clip(folder, f"b_{number}", "old", held_out=held_out, share=0.5 + 0.02 * number)
    write_clip(folder, "rollout_0", "neutral", held_out=True, source="pfnn_rollouts")
    write_clip(folder, "rollout_1", "neutral", source="pfnn_rollouts")
    write_clip(folder, "a_0_m", "neutral", mirrored=True)
    write_clip(folder, "a_0_t", "neutral")
    write_clip(folder, "layer_00000", "neutral", tier="layered")
    return folder


class CrowdWalker(WalkerModel):
    """Continues the cycle from the pose that it sees: characters of a crowd walk as each alone."""

    def __post_init__(self):
        super().__post_init__()
        self.lock = threading.Lock()

    def step(self, x, noise, style):
        seen = x[0, INPUT["joint_positions"]].reshape(-1, 3)
        with self.lock:
            self.frame = int(np.square(self._positions - seen).sum((1, 2)).argmin())
            return super().step(x, noise, style)


class NoisyWalker(CrowdWalker):
    """Its hips rise and sink with the diffusion noise."""

    def step(self, x, noise, style):
        y, alpha = super().step(x, noise, style)
        y[0, OUTPUT["joint_positions"].start + 1] += float(noise.mean())
        return y, alpha


class FakeModel:
    """A model that walks whatever is asked of it."""

    name, decoder = "walker", "diffusion"

    def __init__(self):
        self.model = CrowdWalker()
        config = {"experts": 2, "hidden": 4, "embedding": 4, "front": [4, 2], "output_size": 473}
        self.model.metadata["config"] = config

    def style(self, style, number):
        return Z + 0.01


@pytest.fixture(scope="module")
def results(clips):
    """Of walks as short as their scores allow."""
    plan = make_plan(clips, None, Options(3.0, 1.0, 1.0, 1, 1, 1), None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scores, "TERRAINS", ("stairs",))
        patch.setattr(scores, "DIVERSITY_FRAMES", 40)
        patch.setattr(scores, "DIVERSITY_LEAD_IN", 20)
        patch.setattr(evaluated_model, "TIMED_FRAMES", 10)
        patch.setattr(driving, "LEAD_IN_FRAMES", 30)
        found = {"held_out": score_held_out(plan), "models": [score_model(plan, FakeModel())]}
        return {"command": "sport evaluate", "feature_sets": plan.feature_sets, **found}


def test_catalogue_knows_captured_clips_only(clips):
    capture = read_capture(clips)
    assert len(capture.clips) == 14
    assert capture.groups == ["neutral", "old"]
    assert [c.path.stem for c in capture.of(TERRAIN_GROUP, True)] == ["rollout_0"]
    assert capture.seconds("neutral", Gait.WALK, held_out=True) == pytest.approx(5.0)
    with pytest.raises(FileError, match="sleepy"):
        read_capture(clips, ["sleepy"])


def test_segments_begin_with_held_out_clips_and_keep_to_the_time(clips):
    segments = driving_segments(read_capture(clips), "neutral", 12.0)
    assert segments[0].clip.held_out
    assert not any(s.clip.held_out for s in segments[1:])
    assert sum(s.seconds for s in segments) == pytest.approx(12.0, abs=0.1)
    assert segments == driving_segments(read_capture(clips), "neutral", 12.0)


def test_root_features_are_those_that_training_sees(clips):
    frames, root = clip_frames(clips / "a_1.npz"), load_motion(clips / "a_1.npz").root_features()
    y = frames.y.astype(np.float32)
    assert np.abs(y[:, OUTPUT["joint_positions"]].reshape(-1, 31, 3) - root.joints).max() < 1e-3
    assert np.abs(y[:, OUTPUT["joint_rotations"]].reshape(-1, 31, 6) - root.rotations).max() < 1e-3
    assert np.abs(y[:, OUTPUT["root"]] - root.velocity).max() < 2e-3


def test_following_goes_where_the_clip_goes_at_its_time(clips):
    clip = load_motion(clips / "a_1.npz").cut(0, 150)
    requests = requests_of(clip, lead_in=60)
    assert len(requests.xz) == len(clip) + 60
    assert np.diff(requests.xz[:61, 1]) == pytest.approx(np.full(60, requests.velocity[0, 1] / 60))
    (made,) = follow(WalkerModel(), [Take(clip, Z)])
    assert (len(made), made.style, made.source) == (len(clip), "neutral", "generated")
    assert np.linalg.norm(made.positions[:, 0] - clip.positions[:, 0], axis=-1).max() < 0.35
    assert made.unlocked.shape == made.positions.shape


def test_a_network_that_fails_stops_the_evaluation(clips):
    with pytest.raises(SportError, match="not finite"):
        follow(WalkerModel(broken_at=150), [Take(load_motion(clips / "a_1.npz"), Z)])


def test_courses_stay_on_the_ring():
    walks = [RingWalk("neutral", Z, Gait.WALK, 3), RingWalk("neutral", Z, Gait.JOG, 4)]
    for run in run_ring(WalkerModel(), Terrain.flat(), walks, 2.0):
        assert len(run.motion) == len(run.path_error) == 120
        assert run.path_error.mean() < 0.3


def test_replay_takes_the_clips_controls_and_seeds_matter_only_with_temperature(clips):
    clip = load_motion(clips / "a_1.npz").cut(0, 60)
    takes = [Take(clip, Z, seed) for seed in (1, 2)]
    runs = {t: replay(NoisyWalker(), takes, t, 20) for t in (0.0, 1.0)}
    assert runs[0.0][0].shape == (40, 31, 3)
    assert np.array_equal(*runs[0.0])
    assert not np.array_equal(*runs[1.0])
    seen = []
    model = WalkerModel()
    step = model.step
    model.step = lambda x, noise, style: (seen.append(x[0]), step(x, noise, style))[1]
    replay(model, [Take(clip, Z)])
    frames = clip_frames(clips / "a_1.npz")
    # t^p and t^d of the clip
    assert np.abs(seen[50][:48] - frames.x[50][:48].astype(np.float32)).max() < 0.02


@pytest.mark.needs_torch
def test_scores_of_a_walker_are_those_of_a_walker(results):
    model = results["models"][0]
    own = model["following"]["styles"]["neutral"]
    assert own["path_error_m"] < 0.3
    assert own["speed_ratio"] == pytest.approx(1.0, abs=0.1)
    assert model["following"]["fmd"]["kinematic"]["distance"] > 0
    assert model["diversity"]["temperature_0"] == 0.0
    assert model["transitions"]["ratio"] == pytest.approx(1.0, abs=0.3)
    assert set(model["courses"]) == {"neutral", "old"}
    assert set(model["courses"]["neutral"]["walk"]) == {"captured", "flat", "rough"}
    assert results["held_out"]["recognition"]["score"] == {"neutral": 1.0, "old": 1.0}


@pytest.mark.needs_torch
def test_bars_count_and_name_what_misses(results):
    bars = check(results["models"][0], results["held_out"])
    assert all(0 <= b.met <= b.cases and len(b.missed) == b.cases - b.met for b in bars)
    worse = json.loads(json.dumps(results["models"][0]))
    worse["courses"]["neutral"]["walk"]["flat"]["after"]["soles"] = 9.0
    worse["following"]["recognition"]["score"]["old"] = 0.1
    missed = [text for b in check(worse, results["held_out"]) for text in b.missed]
    assert any(t.startswith("neutral walk 9 > ") for t in missed)
    assert "old 0.1 < 0.8" in missed


@pytest.mark.needs_torch
def test_tables_hold_the_capture_and_every_model(results):
    text = markdown(json.loads(json.dumps(results)))
    assert "| held-out capture |" in text
    assert "| walker (diffusion) |" in text


def test_style_texts_take_written_and_measured_descriptions_in_turn():
    library = json.loads(asset_path("prompts/styles.json").read_text(encoding="utf-8"))["drunk"]
    written = len(library["descriptions"]) - library["measured"]
    texts = style_texts({"drunk"})["drunk"]
    assert len(texts) == len(library["descriptions"])
    assert texts[0].head == library["descriptions"][0]["head"]
    assert texts[1].head == library["descriptions"][written]["head"]
    assert all(style_texts({"twitching", "walking_stick"}).values())  # which the data sets alone have
    with pytest.raises(FileError, match="sleepy"):
        style_texts({"sleepy"})


def test_options_that_cannot_be_met_are_named(tmp_path):
    with pytest.raises(UsageError, match="--seconds 1"):
        main(["--clips", str(tmp_path), "--model", "./m", "--seconds", "1"])
    with pytest.raises(FileError, match="no clips"):
        main(["--clips", str(tmp_path), "--model", "./m", "--quick"])
    options = MOTION.parser("sport evaluate").parse_args(["--clips", "c", "--model", "./a", "--model", "./b"])
    assert options.model[1].name == "b"
