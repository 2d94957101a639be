"""One training run: its options, and data and networks shared by its stages, loaded on first use."""

from __future__ import annotations

import argparse
import logging
import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from runtime.assets import asset_path
from runtime.errors import FileError, UsageError
from runtime.motion.features import OUTPUT_SIZE
from runtime.prompts.text_encoder import TextEncoder
from training import parallel
from training.arguments import FRACTIONS
from training.batches import FrameTensors, Normalisation
from training.composition import Composer
from training.data import sources
from training.export.pace import neutral_style
from training.frames import FrameTable, load_frames
from training.networks.content import ContentEncoder
from training.networks.generator import Generator
from training.presets import OPEN, ModelConfig, ablation, preset
from training.sampling import moments, sampling_weights
from training.session import Session, StageLength, load_checkpoint, save_checkpoint
from training.stages import content as stage_content
from training.stages import motion as stage_motion
from training.stages import phase as stage_phase
from training.styles import StyleTexts, load_style_texts

log = logging.getLogger("sport.train")


@dataclass
class Run:
    """A folder of checkpoints (`--out`) with the clips, networks and data of its stages."""

    args: argparse.Namespace
    session: Session
    config: ModelConfig
    encoder: TextEncoder

    @staticmethod
    def of(args: argparse.Namespace) -> Run:
        """Start a run with the command's options; FileError for clips that the preset's licence excludes."""
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
        session.recorded = session.device.type == "cuda" and not args.no_graphs
        run = Run(args, session, config, encoder)
        run.check_licence()
        return run

    @property
    def out(self) -> Path:
        """Folder of the run."""
        return self.session.out

    @property
    def clips(self) -> Path:
        """Folder of the imported clips."""
        return self.args.clips or self.out / "clips"

    @property
    def is_played(self) -> bool:
        """True if the runtime can play the model: it needs this output layout, and ablations are only compared."""
        return self.config.output_size == OUTPUT_SIZE and not self.args.ablation

    def final(self, stage: str) -> Path:
        """Return the path of a stage's final weights."""
        return self.out / f"{stage}_final.pt"

    def length(self, stage: str, batch: int | None = None) -> StageLength:
        """Return the length of a stage; `batch` defaults to that of stages 2 and 3, divided among the processes."""
        batch = batch or max(1, self.args.batch // parallel.workers())
        return StageLength(getattr(self.args, stage), batch, self._end_of(stage))

    def _end_of(self, stage: str) -> float | None:
        """Return when a stage has used its fraction of the time left of --minutes; UsageError if none is left."""
        if self.args.ends is None:
            return None
        now = time.monotonic()
        if now >= self.args.ends:
            raise UsageError(f"--minutes {self.args.minutes:g}: over before stage {stage}.", "Allow more.")
        if self.args.stage != "all" or stage not in FRACTIONS:
            return self.args.ends
        names = list(FRACTIONS)
        coming = sum(FRACTIONS[name] for name in names[names.index(stage) :])
        return now + (self.args.ends - now) * FRACTIONS[stage] / coming

    def check_licence(self) -> None:
        """Raise FileError if non-commercial clips are in a model for publication; otherwise log the amount of data."""
        table = self.table
        bound = sorted(name for name in set(table.sources) if not sources.BY_NAME[name].free)
        if bound and self.config.name == OPEN:
            raise FileError(
                f"{self.clips}: contains clips of {', '.join(bound)}, whose licence is non-commercial.",
                f"Import with --preset {OPEN} into another --out.",
            )
        log.info("%d clips, %d frames, %d styles", len(table.styles), len(table), len(set(table.styles)))

    # --- data ---------------------------------------------------------------------------------------------------------

    @cached_property
    def table(self) -> FrameTable:
        """All frames of the clips."""
        return load_frames(self.clips, self.out / "frames")

    @cached_property
    def texts(self) -> StyleTexts:
        """The clips' descriptions."""
        return self.texts_of(self.table, self.clips)

    def texts_of(self, table: FrameTable, clips: Path | None) -> StyleTexts:
        """Load descriptions of the clips of a table; `clips` is their folder if it contains descriptions."""
        words = self.config.direction_words, self.config.one_sided_words
        return load_style_texts(table, asset_path("prompts/styles.json"), self.encoder, clips, *words)

    @cached_property
    def weights(self) -> np.ndarray:
        """The sampling weight of each frame."""
        return sampling_weights(self.table, favoured=self.texts.of_rhythm())

    @cached_property
    def phase(self) -> np.ndarray:
        """Phases of all frames; FileError before stage 0."""
        stored = self.out / "phase.npy"
        if stored.exists():
            phase = np.load(stored, allow_pickle=False)
            if len(phase) == len(self.table):
                return phase
            log.info("%s belongs to other clips: computing phases again", stored)
        if not self.final("phase").exists():
            raise FileError(f"{stored}: missing.", "Train stage 'phase' first.")
        return stage_phase.encode_table(self.session, self.config, self.table)

    @cached_property
    def frames(self) -> FrameTensors:
        """The frames as tensors, with their composer."""
        frames = FrameTensors.of(self.table, self.phase, self.session.device)
        if self.config.composition:
            frames.composer = Composer(
                self.table, self.texts, frames.y, moments(self.table), self.session.device
            )
        return frames

    @cached_property
    def scales(self) -> dict[str, torch.Tensor]:
        """Normalisation of x, y and Z^t, measured once per run so that resumed stages use the same."""
        path = self.out / "scales.pt"
        if not path.exists():
            centre, deviation = stage_content.style_scale(self.content, self.texts)
            normal = stage_motion.measure(self.frames, self.weights, self.session)
            save_checkpoint(path, vars(normal) | {"style_centre": centre, "style_deviation": deviation})
        parallel.wait()
        return {name: value.to(self.session.device) for name, value in load_checkpoint(path).items()}

    @property
    def style_scale(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Centre and deviation of Z^t."""
        return self.scales["style_centre"], self.scales["style_deviation"]

    @cached_property
    def data(self) -> stage_motion.MotionData:
        """The training data of stages 2 and 3."""
        normal = Normalisation(**{k: self.scales[k] for k in Normalisation.__dataclass_fields__})
        z = stage_content.style_table(self.content, self.texts, *self.style_scale)
        return stage_motion.MotionData(self.frames, normal, z, self.weights)

    @property
    def neutral(self) -> np.ndarray:
        """Z^t `(6, n / 6)` of neutral walking."""
        return neutral_style(self.table, self.data.style)

    # --- networks -----------------------------------------------------------------------------------------------------

    @cached_property
    def content(self) -> ContentEncoder | None:
        """The trained content encoder, None if the model has none; FileError before stage 1."""
        if not self.config.content_encoder:
            return None
        path = self.final("content")
        stored = load_checkpoint(path)
        trained_with = stored["config"]["text_encoder"]
        if trained_with != self.config.text_encoder:
            raise FileError(
                f"{path}: trained with the text encoder {trained_with!r}, not {self.config.text_encoder!r}.",
                "Give its folder with --text-encoder, or choose another --out.",
            )
        module = ContentEncoder(self.config)
        module.load_state_dict(stored["module"])
        return module.to(self.session.device).eval()

    def generator(self, stage: str) -> Generator:
        """Load the motion generator after a stage."""
        module = Generator(self.config)
        module.load_state_dict(load_checkpoint(self.final(stage))["module"])
        return module.to(self.session.device)
