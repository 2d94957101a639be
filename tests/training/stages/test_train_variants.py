"""The pipeline from clips to models that the runtime walks: the whole of it once, then presets and ablations.

The tests have one run of all stages in common; each takes a step or two.
"""

import functools
import json
import logging
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from runtime.controls import Controls
from runtime.errors import FileError, ModelError, UsageError
from runtime.motion.controller import Controller
from runtime.motion.features import PAPER_OUTPUT_SIZE
from runtime.motion.model import load_model
from runtime.pose import Pose
from runtime.prompts.content import PromptEncoder
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES, SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from tests.helpers.quick_export import export_quickly
from tests.helpers.synthetic_clips import write_clip
from tests.training.stages.test_stage_words import BagOfWords
from training import ablations, pipeline
from training.ablations import SHARED
from training.arguments import StageSteps
from training.augmentation.sentences import longer_sentences
from training.export import model as export_module
from training.export import quantize
from training.networks.content import StatisticsReader
from training.networks.generator import Generator
from training.networks.phase import PeriodicAutoencoder, two_hop_neighbours
from training.presets import ABLATIONS, PRESETS, ablation, preset
from training.stages import diffusion as stage_diffusion
from training.stages import motion as stage_motion

pytestmark = pytest.mark.needs_torch

NARROW = {  # of the tiny preset; everything else stays as the preset has it
    name: getattr(PRESETS["tiny"], name)
    for name in ("hidden", "embedding", "front", "denoiser_width", "content_feedforward", "phase_kernel")
} | {"denoiser_blocks": 2, "content_layers": 1}
STAGES = ("phase", "content", "words", "stage2", "stage3")
NEUTRAL = PartDescriptions.from_mapping({part: f"{part} relaxed, walking" for part in PART_NAMES})


class Words(BagOfWords):
    """Sentences without the encoder's network."""

    def __init__(self, _folder: Path | None = None) -> None:
        self.name = "all-MiniLM-L6-v2"


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder of clips, and what makes a step of everything short: few sentences, few windows, a quick exporter."""
    folder = tmp_path_factory.mktemp("clips")
    write_clip(folder / "a.npz", "neutral", 0.0)
    write_clip(folder / "b.npz", "angry", 1.1)
    few = [s for part in PART_NAMES for s in [s for s in longer_sentences() if s.part == part][::400][:3]]
    measure, motion = StatisticsReader.measure, export_module._export_motion
    kept: list[bytes] = []

    def motion_once(content: Any, scales: Any, to: Path) -> float:
        """The graph that no walk reads: exported for the first model, copied for the others."""
        if kept:
            (to / "motion.onnx").write_bytes(kept[0])
            return 0.0
        error = motion(content, scales, to)
        kept.append((to / "motion.onnx").read_bytes())
        return error

    logging.disable(logging.WARNING)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("training.stages.words.longer_sentences", lambda: few)
        patch.setattr("training.run.TextEncoder", Words)
        patch.setattr(StatisticsReader, "measure", lambda self, joints: measure(self, joints[:256]))
        patch.setattr("training.stages.words._error", lambda *_: 0.0)  # of thousands of sentences, four times
        patch.setattr(quantize, "COURSES", (("a proud queen", "random", "jog", "flat"),))
        patch.setattr(quantize, "WALK_S", 1.0)
        patch.setattr(pipeline, "measure_traversals", lambda folder: (folder / "traversed").touch())
        for name in ("estimate_variance", "measure_codes"):
            patch.setattr(stage_diffusion, name, functools.partial(getattr(stage_diffusion, name), batches=1))
        patch.setattr(stage_motion, "measure", functools.partial(stage_motion.measure, count=2000))
        for name in ("PHASE_BATCH", "CONTENT_BATCH"):
            patch.setattr(pipeline, name, 16)
        patch.setattr("training.stages.content.STATISTICS_WINDOWS", 128)
        patch.setattr("training.stages.content.MEASURED_CLIPS", 64)
        rows = stage_motion.RandomRows
        for module in (stage_motion, stage_diffusion):
            patch.setattr(
                module, "RandomRows", lambda weights, batch, *more: rows(weights, min(batch, 64), *more)
            )
        export_quickly(patch)
        patch.setattr(export_module, "_export_motion", motion_once)
        for name, config in list(PRESETS.items()):
            patch.setitem(PRESETS, name, replace(config, **NARROW))
        yield folder
    logging.disable(logging.NOTSET)


def train(clips: Path, out: Path, preset: str, *more: str) -> None:
    """One step of each stage and an export."""
    common = {"preset": preset, "clips": clips, "out": out, "batch": 16, "device": "cpu", "layers": 0}
    options = [text for key, value in common.items() for text in (f"--{key}", str(value))]
    pipeline.main(["all", *options, *(f"--{stage}-steps=1" for stage in STAGES), *more])


@pytest.fixture(scope="module")
def full(short: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of the model that is played, whose phases and content encoder ablations share."""
    out = tmp_path_factory.mktemp("full")

    def cross(model: Path, folder: Path, *_: object) -> dict[str, int]:
        """In place of walks over courses, which this network cannot do: a clip."""
        assert load_model(model).name == "compact"
        folder.mkdir(parents=True)
        shutil.copy(short / "a.npz", folder)
        return {"stairs kept": 1}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("training.courses.make_all", cross)
        train(short, out, "compact", "--ground-steps=1", "--course-minutes=1")
    return out


def walks(folder: Path) -> None:
    """The runtime loads a model, encodes a prompt and walks it, twice in the same way."""
    model = load_model(folder)
    z = PromptEncoder(Words(), model.prompt_path).encode(NEUTRAL)

    def walk() -> list[Pose]:
        controller = Controller(model, Terrain.flat(), seed=3)
        controller.set_style(z, 0.1)
        return [controller.step(Controls((0.0, 1.0))) for _ in range(6)]

    poses = walk()
    assert all(np.isfinite(pose.positions).all() for pose in poses)
    assert not np.array_equal(poses[0].positions, poses[-1].positions)
    for first, second in zip(poses, walk(), strict=True):
        assert first.local_rotations.tobytes() == second.local_rotations.tobytes()


def test_the_whole_pipeline_ends_in_a_model_that_is_walked(full: Path) -> None:
    files = (full / f"{stage}_final.pt" for stage in ("stage3", "ground"))
    before, after = (torch.load(file, weights_only=True)["module"] for file in files)
    changed = {name.split(".")[0] for name in before if not torch.equal(before[name], after[name])}
    assert changed == {"encoder", "modulator", "mixture_decoder"}
    walks(full / "model")
    assert (full / "model" / "traversed").exists()
    assert (full / "model" / "README.md").read_text().startswith("# Model")
    small = load_model(full / "model", precision="int8")
    assert small.metadata["quantised"]["relative_error"] > 0.0


def test_a_run_of_some_minutes_ends_on_time_with_every_stage_whole(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, rates = [1000.0], []

    def monotonic() -> float:
        now[0] += 1.0
        return now[0]

    for module in ("pipeline", "run", "session"):
        monkeypatch.setattr(f"training.{module}.time", SimpleNamespace(monotonic=monotonic))
    step = torch.optim.AdamW.step
    monkeypatch.setattr(
        torch.optim.AdamW, "step", lambda own: (rates.append(own.param_groups[0]["lr"]), step(own))
    )
    options = ["--clips", str(short), "--out", str(tmp_path), "--batch=16", "--device=cpu", "--layers=0"]
    pipeline.main(["all", "--minutes=6", *options])
    assert 0.97 * 360.0 < now[0] - 1000.0 <= 360.0
    hours = json.loads((tmp_path / "hours.json").read_text())
    assert hours["stage2"] == pytest.approx(4 * hours["stage3"], rel=0.25)
    assert hours["content"] == pytest.approx(4 * hours["phase"], rel=0.25)
    for stage in ("phase", "content", "stage2", "stage3"):
        saved = torch.load(tmp_path / f"{stage}.pt", weights_only=True)
        assert saved["step"] > 3
        assert 1.0 < saved["at"] == getattr(StageSteps(), stage)  # the schedule is over, in fewer steps
        assert (tmp_path / f"{stage}_final.pt").exists()
    assert rates[-1] < 0.05 * max(rates[-20:])
    assert not (tmp_path / "model").exists()
    with pytest.raises(UsageError, match="over before stage"):
        pipeline.main(["stage3", "--minutes=0", *options])


@pytest.mark.parametrize("name", ["pae", "no-content-encoder"])
def test_an_ablation_is_trained_exported_and_walked(
    name: str, short: Path, full: Path, tmp_path: Path
) -> None:
    ablations.prepare(full, tmp_path / "run", SHARED[name], short)
    train(short, tmp_path / "run", "compact", "--ablation", name)
    walks(tmp_path / "run" / "model")


def test_stage_2_alone_is_exported(short: Path, full: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its graph has a test of its own (`test_networks.py`); this is the command of "w/o diffusion"."""
    exported = []
    monkeypatch.setattr(pipeline, "write_model", lambda trained, _run, to: exported.append((trained, to)))
    options = ["--preset", "compact", "--clips", str(short), "--out", str(full), "--device", "cpu"]
    assert pipeline.main(["export", *options, "--ablation", "full", "--decoder", "mixture"]) == 0
    ((trained, to),) = exported
    assert (trained.decoder, to) == ("mixture", full / "model-mixture")
    saved = torch.load(full / "stage2_final.pt", map_location="cpu", weights_only=True)["module"]
    weights = trained.generator.state_dict()
    assert all(torch.equal(weights[name], saved[name]) for name in weights.keys() & saved.keys())
    assert not trained.sigma_bar_squared.any()


def test_paper_rotations_is_trained_exported_and_walked(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "quantize_model", lambda *_args, **_options: None)
    train(short, tmp_path, "paper-rotations")
    walks(tmp_path / "model")


@pytest.mark.parametrize("stage", ["all", "phase", "stage2", "export"])
def test_training_refuses_the_preset_without_rotations_before_it_begins(stage: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"^--preset paper: has 287 outputs.*473.*Train paper-rotations"):
        pipeline.main([stage, "--preset", "paper", "--out", str(tmp_path / "run")])
    assert not (tmp_path / "run").exists()


def test_the_preset_without_rotations_is_refused_with_a_sentence(
    short: Path, full: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(full / "model", tmp_path / "model")
    metadata = json.loads((folder / "metadata.json").read_text(encoding="utf-8"))
    metadata["config"]["output_size"] = PAPER_OUTPUT_SIZE
    (folder / "metadata.json").write_text(json.dumps(metadata), encoding="utf-8")
    with pytest.raises(ModelError, match="with joint rotations"):
        load_model(folder)


def test_the_open_model_refuses_clips_that_bind_it(tmp_path: Path) -> None:
    clips = tmp_path / "clips"
    clips.mkdir()
    write_clip(clips / "a.npz", "neutral", 0.0)
    with np.load(clips / "a.npz") as clip:
        np.savez(clips / "b.npz", **{**clip, "source": "bandai_namco"})
    with pytest.raises(FileError, match=r"bandai_namco.*non-commercial"):
        pipeline.main(["phase", "--preset", "open", "--clips", str(clips), "--out", str(tmp_path / "out")])


# --- ablations
@pytest.mark.parametrize("name", ABLATIONS)
def test_every_variant_makes_a_frame(name: str) -> None:
    config = ablation(preset("tiny"), name)
    generator = Generator(config).eval()
    y, _, alpha = generator.decode_mixture(torch.randn(3, 472), torch.randn(3, config.style_size))
    assert y.shape == (3, config.output_size)
    assert alpha.shape == (3, config.experts)


def test_the_variants_change_what_they_are_named_for() -> None:
    full = preset("tiny")
    count = {n: sum(p.numel() for p in Generator(ablation(full, n)).parameters()) for n in ABLATIONS}
    assert count["4-experts"] < count["4-content-experts"] < count["full"] < count["no-content-encoder"]
    assert ablation(full, "no-content-encoder").style_size == 6 * full.text_size
    phases = [PeriodicAutoencoder(ablation(full, name)) for name in ("full", "pae")]
    has_graph = [any("graph" in n for n, _ in phase.named_parameters()) for phase in phases]
    assert has_graph == [True, False]
    joined = two_hop_neighbours(True) - two_hop_neighbours()
    hips = sorted(SPORT_SKELETON.index(f"{side}UpLeg") for side in ("Left", "Right"))
    assert torch.nonzero(joined).tolist() == [hips, hips[::-1]]


def test_shared_stages_are_copied_and_missed(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    for file in SHARED["full"]:
        (run / file).write_bytes(b"x")
    ablations.prepare(run, tmp_path / "out", SHARED["pae"], tmp_path)
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["content_final.pt"]
    (run / "phase.npy").unlink()
    with pytest.raises(FileError, match=r"phase\.npy"):
        ablations.prepare(run, tmp_path / "other", SHARED["full"], tmp_path)


def test_the_table_of_frames_is_shared_by_variants_of_the_same_clips_alone(tmp_path: Path) -> None:
    run, clips = tmp_path / "run", tmp_path / "clips"
    for folder in (run / "frames", clips):
        folder.mkdir(parents=True)
    (clips / "walk.npz").write_bytes(b"walk")
    (run / "frames" / "table.json").write_text('{"files": [["walk.npz", 4]]}', encoding="utf-8")
    for file in SHARED["full"]:
        (run / file).write_bytes(b"x")
    ablations.prepare(run, tmp_path / "same", SHARED["full"], clips)
    assert (tmp_path / "same" / "frames").resolve() == (run / "frames").resolve()
    (clips / "jog.npz").write_bytes(b"jog")
    ablations.prepare(run, tmp_path / "other", SHARED["full"], clips)
    assert not (tmp_path / "other" / "frames").exists()
