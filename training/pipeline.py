"""`sport train`: every stage from raw capture to shipped ONNX as one resumable command, or alone."""

from __future__ import annotations

import argparse
import json
import logging
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import torch

from runtime.assets import asset_path
from runtime.atomic import write_atomic
from runtime.errors import FileError, UsageError
from runtime.motion.features import OUTPUT_SIZE
from runtime.motion.model_files import exact_8_bit_products
from runtime.prompts.text_encoder import SHIPPED, TextEncoder
from training import parallel
from training.arguments import STAGES, build_parser
from training.augmentation.build import LAYERS, build_layers
from training.batches import FrameTensors, Normalisation
from training.composition.composer import Composer
from training.courses import clips as course_clips
from training.data import catalog
from training.export.calibrate import calibrate, phase_signs
from training.export.crossings import measure_crossings
from training.export.half_storage import store_model_in_half
from training.export.model import Trained, export_model
from training.export.quantize import quantize_model
from training.frames import FrameTable, load_frames
from training.history import History
from training.natural_pace import neutral_style, start_state, style_speeds
from training.networks.content import ContentEncoder
from training.networks.diffusion import Schedule, reverse_steps
from training.networks.generator import Generator
from training.presets import OPEN, ModelConfig, ablation, preset
from training.rest_rhythm import rest_rhythm
from training.sampling import moments, sampling_weights
from training.session import Session, load_checkpoint, save_checkpoint
from training.stages import (
    content as stage_content,
)
from training.stages import (
    ground as stage_ground,
)
from training.stages import (
    motion as stage_motion,
)
from training.stages import (
    phase as stage_phase,
)
from training.stages import (
    words as stage_words,
)
from training.styles import StyleTexts, load_style_texts

log = logging.getLogger("sport.train")


def main(argv: list[str] | None = None) -> int:
    """Run one stage or all of them."""
    args = build_parser().parse_args(argv)
    _log_progress()
    wanted = STAGES if args.stage == "all" else (args.stage,)
    if set(wanted) - {"import", "layer"}:
        _refuse_table_one(preset(args.preset))  # now: an import takes hours
    args.out.mkdir(parents=True, exist_ok=True)
    if "import" in wanted and args.clips is None:
        _import(args)
    if "layer" in wanted:
        _layer(args)
    if set(wanted) - {"import", "layer"}:
        _train(args, set(wanted))
    return 0


def _import(args: argparse.Namespace) -> None:
    from training.data.importer import import_all

    if args.data is None:
        raise FileError("--data: missing.", "Name the folder that holds the motion data catalog.")
    if not (args.out / "report.json").exists():  # written last
        import_all(args.data, args.out, free_only=args.preset == OPEN)


def _layer(args: argparse.Namespace) -> None:
    from training.styles import CAPTIONS
    from training.text.captions import write_clip_captions

    clips = args.clips or args.out / "clips"
    if args.layers and not (clips / LAYERS).exists():
        build_layers(clips, clips, args.layers, args.seed)
    if not (clips / CAPTIONS).exists():
        write_clip_captions(clips, clips / CAPTIONS)


def _train(args: argparse.Namespace, wanted: set[str]) -> None:
    """The stages after import and augmentation that are `wanted`, in their order."""
    run = Run.of(args)
    for stage in STAGES:
        if stage not in wanted or stage in ("import", "layer"):
            continue
        if args.processes > 1 and stage in parallel.STAGES:
            _ = run.phase  # written once, before all of them read it
            if stage == "ground" and run.learns_courses:
                _ = run.course_data()
            parallel.run_together(args.processes, _train_stage, args, stage)
        else:
            run.train(stage)


def _train_stage(args: argparse.Namespace, stage: str) -> None:
    """One stage in one of several processes."""
    _log_progress()
    Run.of(argparse.Namespace(**vars(args) | {"stage": stage})).train(stage)


def _log_progress() -> None:
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    for chatty in ("onnx_ir", "onnxscript", "torch.onnx"):
        logging.getLogger(chatty).setLevel(logging.WARNING)


@dataclass
class Run:
    """One run: its options, and what the stages share, each made or read when it is first needed."""

    args: argparse.Namespace
    session: Session
    config: ModelConfig
    encoder: TextEncoder

    @staticmethod
    def of(args: argparse.Namespace) -> Run:
        """From the options of the command. FileError for clips that must not enter the model."""
        encoder = TextEncoder(args.text_encoder)
        config = replace(preset(args.preset), text_encoder=encoder.name, text_size=encoder.dimensions)
        if args.ablation:
            config = ablation(config, args.ablation)
        session = Session(args.out, half=not args.no_half, seed=args.seed)
        device = parallel.join(args.stage)
        if device is not None:
            session.device = device
        elif args.device:
            session.device = torch.device(args.device)
        run = Run(args, session, config, encoder)
        _check_data(config, run.clips, run.table)
        return run

    @property
    def clips(self) -> Path:
        """Folder of the imported clips."""
        return self.args.clips or self.args.out / "clips"

    @cached_property
    def table(self) -> FrameTable:
        """All frames of the clips."""
        return _load(self.clips, self.args.out / "frames", self.args.limit)

    @cached_property
    def texts(self) -> StyleTexts:
        """The clips' descriptions."""
        return self._texts_of(self.table, self.clips)

    def _texts_of(self, table: FrameTable, clips: Path | None) -> StyleTexts:
        words = self.config.direction_words, self.config.one_sided_words
        styles = self.args.styles or asset_path("prompts/styles.json")
        return load_style_texts(table, styles, self.encoder, clips, *words)

    @cached_property
    def weights(self) -> np.ndarray:
        """How often each frame is drawn."""
        return sampling_weights(self.table, favoured=self.texts.of_rhythm())

    @cached_property
    def phase(self) -> np.ndarray:
        """Phases of all frames. FileError before stage 0."""
        stored = self.args.out / "phase.npy"
        if stored.exists():
            phase = np.load(stored, allow_pickle=False)
            if len(phase) == len(self.table):
                return phase
            log.info("%s belongs to another set of clips: encoding these", stored)
        if not (self.args.out / "phase_final.pt").exists():
            raise FileError(f"{stored}: missing.", "Train stage 'phase' first.")
        return stage_phase.encode_table(self.session, self.config, self.table)

    @cached_property
    def frames(self) -> FrameTensors:
        """The frames as tensors, with what composes them."""
        frames = FrameTensors.of(self.table, self.phase, self.session.device)
        if self.config.composition:
            frames.composer = Composer(
                self.table, self.texts, frames.y, moments(self.table), self.session.device
            )
        return frames

    @cached_property
    def content(self) -> ContentEncoder | None:
        """The trained content encoder; None where the model has none. FileError before stage 1."""
        if not self.config.content_encoder:
            return None
        stored = load_checkpoint(self.content_path)
        trained_with = stored["config"].get("text_encoder", SHIPPED["name"])
        if trained_with != self.config.text_encoder:
            raise FileError(
                f"{self.content_path}: trained with the text encoder {trained_with!r}, not"
                f" {self.config.text_encoder!r}.",
                "Name its folder with --text-encoder, or another --out.",
            )
        module = ContentEncoder(self.config)
        stage_content.begin_with(module, stored["module"])
        return module.to(self.session.device).eval()

    @property
    def content_path(self) -> Path:
        """File of the content encoder."""
        return self.args.out / "content_final.pt"

    @cached_property
    def scales(self) -> dict[str, torch.Tensor]:
        """Normalisation of x, y and Z^t: measured once per run, so that a resumed stage goes on with the same."""
        path = self.args.out / "scales.pt"
        if not path.exists():
            centre, deviation = stage_content.style_scale(self.content, self.texts)
            normal = stage_motion.measure(self.frames, self.weights, self.session)
            save_checkpoint(path, normal.tensors() | {"style_centre": centre, "style_deviation": deviation})
        parallel.wait()
        return {name: value.to(self.session.device) for name, value in load_checkpoint(path).items()}

    @property
    def style_scale(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Centre and deviation of Z^t."""
        return self.scales["style_centre"], self.scales["style_deviation"]

    @cached_property
    def data(self) -> stage_motion.MotionData:
        """What stages 2 and 3 train on."""
        normal = Normalisation(**{k: self.scales[k] for k in Normalisation.__dataclass_fields__})
        z = stage_content.style_table(self.content, self.texts, *self.style_scale)
        return stage_motion.MotionData(self.frames, normal, z, self.weights)

    @property
    def neutral(self) -> np.ndarray:
        """Z^t `(6, n / 6)` of neutral walking."""
        return neutral_style(self.table, self.data.style)

    def generator(self, stage: str) -> Generator:
        """The motion generator as a stage left it."""
        module = Generator(self.config)
        module.load_state_dict(load_checkpoint(self.args.out / f"{stage}_final.pt")["module"])
        return module.to(self.session.device)

    @property
    def batch(self) -> int:
        """Samples of a step of stages 2 and 3 in each process."""
        return max(1, self.args.batch // parallel.workers())

    # --- stages -------------------------------------------------------------------------------------------------------

    def train(self, stage: str) -> None:
        """A stage of `STAGES` after import and augmentation."""
        getattr(self, f"train_{stage}" if stage != "export" else "export")()

    def train_phase(self) -> None:
        """Stage 0, once."""
        if not (self.args.out / "phase_final.pt").exists():
            options = self.args.phase, PHASE_BATCH, self.args.max_minutes
            stage_phase.run(self.session, self.config, self.table, self.weights, *options)

    def train_content(self) -> None:
        """Stage 1, once."""
        if self.config.content_encoder and not self.content_path.exists():
            stage_content.run(
                self.session,
                self.config,
                self.table,
                self.frames,
                self.weights,
                self.texts,
                self.args.content,
                max_minutes=self.args.max_minutes,
                clips=self.clips,
            )

    def train_words(self) -> None:
        """Longer sentences, once for a content encoder."""
        content = self.content
        if content is None or not self.config.longer_sentences:
            return
        stored = load_checkpoint(self.content_path)
        if "longer_sentences" in stored:
            return
        learnt = stage_words.learn_longer_sentences(
            content, self.config, self.texts, self.encoder, self.args.words, self.args.seed
        )
        distances = "  ".join(f"{name} {value:.3f}" for name, value in learnt.items())
        logs = self.args.out / "logs"
        logs.mkdir(parents=True, exist_ok=True)
        (logs / "words.txt").write_text(
            f"step {self.args.words} of {self.args.words}, distances {distances}", encoding="utf-8"
        )
        save_checkpoint(
            self.content_path, stored | {"module": content.state_dict(), "longer_sentences": learnt}
        )
        content.to(self.session.device)

    def train_stage2(self) -> None:
        """Stage 2, resumed where it was left."""
        options = self.args.stage2, self.batch, self.args.max_minutes
        stage_motion.run_stage2(self.session, self.config, self.data, *options)

    def train_stage3(self) -> None:
        """Stage 3, resumed where it was left."""
        options = self.args.stage3, self.batch, self.args.max_minutes
        generator = stage_motion.run_stage3(
            self.session, self.config, self.data, self.generator("stage2"), *options
        )
        save_checkpoint(self.args.out / "stage3_final.pt", {"module": generator.state_dict()})

    @property
    def learns_courses(self) -> bool:
        """Whether the stage ground is asked for, of a model that somebody plays with."""
        return bool(self.args.course_minutes) and _is_played(self.config, self.args)

    def train_ground(self) -> None:
        """Courses crossed by the run's own model, and the generator trained on them; nothing without minutes of them."""
        if not self.learns_courses:
            return
        options = self.neutral, self.args.ground, self.batch, self.args.max_minutes
        generator = stage_ground.run_ground(
            self.session, self.data, self.course_data(), self.generator("stage3"), *options
        )
        save_checkpoint(self.args.out / "ground_final.pt", {"module": generator.state_dict()})

    def course_data(self) -> stage_motion.MotionData:
        """What the stage ground trains on beside captured clips; of several processes the first makes it, once."""
        normal = self.data.normal  # read by all, who wait for each other, before the first goes on alone
        if parallel.rank():
            parallel.wait()
        folder = self.args.out / "courses"
        clips = folder / "clips"
        if not (folder / "report.json").exists():  # written last
            model = self.args.out / "model-before-ground"
            export_model(self.trained("stage3", "diffusion"), model)
            minutes, seed, count = self.args.course_minutes, self.args.seed, self.args.processes
            seen = course_clips.make_all(model, clips, minutes, seed, count)
            write_atomic(folder / "report.json", json.dumps(seen, indent=1) + "\n")
        table = load_frames(clips, folder / "frames")
        phase = stage_ground.course_phases(self.session, self.config, table, self.table, self.phase, folder)
        if not parallel.rank():
            parallel.wait()
        z = stage_content.style_table(self.content, self._texts_of(table, None), *self.style_scale)
        weights = np.ones(len(table))
        weights[table.start[:-1]] = 0.0
        frames = FrameTensors.of(table, phase, self.session.device)
        return stage_motion.MotionData(frames, normal, z, weights / weights.sum())

    def export(self) -> None:
        """Graphs, metadata and card of the run."""
        mixture = self.args.decoder == "mixture"
        folder = self.args.out / ("model-mixture" if mixture else "model")
        stage = "stage2" if mixture else "ground" if self.on_ground else "stage3"
        _write_model(self.trained(stage, self.args.decoder), self.args, folder)
        # codes have mirror images where every sentence is read as of the left side
        if self.content is not None and self.config.one_sided_words and _is_played(self.config, self.args):
            signs = phase_signs(self.table, self.phase)
            if signs is None:
                log.warning("%s: not calibrated, no clip has its mirror image", folder)
            else:
                calibrate(folder, signs, self.args.text_encoder)
            measure_crossings(folder)

    @property
    def on_ground(self) -> bool:
        """Whether the run has trained on courses."""
        return (self.args.out / "ground_final.pt").exists()

    def trained(self, stage: str, decoder: str) -> Trained:
        """What is exported of the run as a stage left it."""
        generator = self.generator(stage)
        config, data, table = self.config, self.data, self.table
        sigma = np.zeros(config.inference_steps)
        if decoder == "diffusion":
            sigma = stage_motion.estimate_variance(self.session, config, data, generator)
        schedule = Schedule.linear(config.diffusion_steps)
        history = History.of_run(self.args.out)
        return Trained(
            config=config,
            content=self.content,
            generator=generator,
            normal=data.normal,
            style_centre=self.style_scale[0],
            style_deviation=self.style_scale[1],
            speeds=torch.as_tensor(_paces_and_rhythm(table, self.phase, data, self.texts)),
            steps=reverse_steps(schedule, schedule.subsequence(config.inference_steps), sigma),
            sigma_bar_squared=sigma,
            start=start_state(table, self.phase),
            credits=catalog.credits_of(set(table.sources)),
            notes=_notes(self.args, table, history),
            curves=history.losses,
            neutral=self.neutral,
            sequence_scales=_sequence_scales(self.content_path, table) if self.content is not None else {},
            decoder=decoder,
        )


PHASE_BATCH = 128


def _refuse_table_one(config: ModelConfig) -> None:
    """UsageError for a preset whose outputs are not those of this program's frames: it counts parameters only."""
    if config.output_size != OUTPUT_SIZE:
        raise UsageError(
            f"--preset {config.name}: has {config.output_size} outputs, the frames of this program have {OUTPUT_SIZE}; it"
            " serves the parameter counts of Table I only.",
            "Train paper-rotations, which is the same with joint rotations.",
        )


def _check_data(config: ModelConfig, clips: Path, table: FrameTable) -> None:
    """FileError for clips that must not enter a model which anybody may publish; else says how much there is."""
    bound = sorted(name for name in set(table.sources) if not catalog.BY_NAME[name].free)
    if bound and config.name == OPEN:
        raise FileError(
            f"{clips}: holds clips of {', '.join(bound)}, whose licence is non-commercial.",
            f"Import with --preset {OPEN} into another --out.",
        )
    log.info("%d clips, %d frames, %d styles", len(table.styles), len(table), len(set(table.styles)))


def _paces_and_rhythm(
    table: FrameTable, phase: np.ndarray, data: stage_motion.MotionData, texts: StyleTexts
) -> np.ndarray:
    """`(385, 2 + 2 C)` from Z^t: walking and jogging speed, then amplitude and rate of each phase channel at rest."""
    return np.concatenate(
        [style_speeds(table, data.style, texts.of_pace()), rest_rhythm(table, phase, data.style)], axis=1
    )


def _is_played(config: ModelConfig, args: argparse.Namespace) -> bool:
    """Whether somebody plays with the model: the runtime, which measures it, loads no other output, and nobody an ablation."""
    return config.output_size == OUTPUT_SIZE and not args.ablation


def _write_model(trained: Trained, args: argparse.Namespace, folder: Path) -> None:
    export_model(trained, folder)
    if _is_played(trained.config, args):
        if exact_8_bit_products():
            quantize_model(folder, text_encoder=args.text_encoder)
        else:
            log.warning(
                "%s: without an 8-bit twin, which this processor cannot measure (no VNNI); make it elsewhere with "
                "python -m training.export.quantize",
                folder,
            )
    store_model_in_half(folder)
    log.info("exported to %s", folder)


@lru_cache(1)
def _load(clips: Path, folder: Path, limit: int | None) -> FrameTable:
    """The frames, kept for the next variant of an ablation."""
    return load_frames(clips, folder, limit=limit)


def _sequence_scales(path: Path, table: FrameTable) -> dict[str, torch.Tensor]:
    """What the motion encoder's input was normalised by; a checkpoint that lacks it was trained on the same table."""
    stored: dict[str, torch.Tensor] | None = load_checkpoint(path).get("scales")
    return stored or stage_content.Sequences(table, torch.device("cpu")).scales


def _notes(args: argparse.Namespace, table: FrameTable, history: History) -> dict[str, object]:
    return {
        "frames": len(table),
        "clips": len(table.styles),
        "styles": sorted(set(table.styles)),
        "steps": {stage: history.steps[stage] for stage in STAGES if stage in history.steps},
        "seed": args.seed,
        "licence": catalog.licence_of(set(table.sources)),
    }


if __name__ == "__main__":
    from runtime.errors import run_command

    raise SystemExit(run_command("train", main))
