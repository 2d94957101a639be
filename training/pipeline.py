"""`sport train`: every stage from raw capture to shipped ONNX as one resumable command, or alone."""

from __future__ import annotations

import argparse
import logging
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

from runtime.assets import asset_path
from runtime.errors import FileError, UsageError
from runtime.motion.features import OUTPUT_SIZE
from runtime.prompts.text_encoder import SHIPPED, TextEncoder
from training import parallel
from training.arguments import STAGES, build_parser
from training.batches import Frames, Normalisation
from training.data import archives
from training.export.half_storage import store_model_in_half
from training.export.model import Trained, export_model
from training.export.quantize import quantize_model
from training.frames import FrameTable, load_frames, sampling_weights
from training.history import History
from training.layering.build import LAYERS, build_layers
from training.natural_pace import neutral_style, start_state, style_speeds
from training.networks.content import ContentEncoder
from training.networks.diffusion import Schedule, reverse_steps
from training.networks.generator import Generator
from training.presets import OPEN, ModelConfig, ablation, preset
from training.rest_rhythm import rest_rhythm
from training.session import Session, load_checkpoint, save_checkpoint
from training.stages import (
    content as stage_content,
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
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    for chatty in ("onnx_ir", "onnxscript", "torch.onnx"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
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
        raise FileError("--data: missing.", "Name the folder that holds the motion data archives.")
    if not (args.out / "clips").exists():
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
    clips = args.clips or args.out / "clips"
    table = _load(clips, args.limit)
    _check_data(config, clips, table)
    words = config.direction_words, config.one_sided_words
    texts = load_style_texts(table, args.styles or asset_path("prompts/styles.json"), encoder, clips, *words)
    weights = sampling_weights(table, favoured=texts.of_rhythm())
    phase = _phase(args, session, config, table, weights, "phase" in wanted)
    if wanted == {"phase"}:
        return
    content = _content(args, session, config, table, weights, texts, "content" in wanted)
    if "words" in wanted and content is not None and config.longer_sentences:
        _words(args, content, config, texts, encoder)
    if not wanted & {"stage2", "stage3", "export"}:
        return
    frames = Frames.of(table, phase, session.device)
    scales = _scales(session, frames, weights, content, texts)
    normal = Normalisation(**{k: scales[k] for k in Normalisation.__dataclass_fields__})
    scale = scales["style_centre"], scales["style_deviation"]
    z = stage_content.style_table(content, texts, *scale)
    data = stage_motion.MotionData(frames, normal, z, weights)
    if "stage2" in wanted:
        stage_motion.run_stage2(session, config, data, args.stage2, args.batch, args.max_minutes)
    if "stage3" in wanted:
        generator = _generator(args.out / "stage2_final.pt", config).to(session.device)
        stage_motion.run_stage3(session, config, data, generator, args.stage3, args.batch, args.max_minutes)
        save_checkpoint(args.out / "stage3_final.pt", {"module": generator.state_dict()})
    if "export" in wanted:
        _export(args, session, config, data, content, table, phase, scale)


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
    bound = sorted(name for name in set(table.sources) if not archives.BY_NAME[name].free)
    if bound and config.name == OPEN:
        raise FileError(
            f"{clips}: holds clips of {', '.join(bound)}, whose licence is non-commercial.",
            f"Import with --preset {OPEN} into another --out.",
        )
    log.info("%d clips, %d frames, %d styles", len(table.styles), len(table), len(set(table.styles)))


def _export(
    args: argparse.Namespace,
    session: Session,
    config: ModelConfig,
    data: stage_motion.MotionData,
    content: ContentEncoder | None,
    table: FrameTable,
    phase: np.ndarray,
    scale: tuple[torch.Tensor, torch.Tensor],
) -> None:
    """Graphs, metadata and card of the run; `scale` are centre and deviation of Z^t."""
    mixture = args.decoder == "mixture"
    weights_of = "stage2_final.pt" if mixture else "stage3_final.pt"
    generator = _generator(args.out / weights_of, config).to(session.device)
    sigma = np.zeros(config.inference_steps)
    if not mixture:
        sigma = stage_motion.estimate_variance(session, config, data, generator)
    schedule = Schedule.linear(config.diffusion_steps)
    history = History.of_run(args.out)
    trained = Trained(
        config=config,
        content=content,
        generator=generator,
        normal=data.normal,
        style_centre=scale[0],
        style_deviation=scale[1],
        speeds=torch.as_tensor(_paces_and_rhythm(table, phase, data)),
        steps=reverse_steps(schedule, schedule.subsequence(config.inference_steps), sigma),
        sigma_bar_squared=sigma,
        start=start_state(table, phase),
        credits=archives.credits_of(set(table.sources)),
        notes=_notes(args, table, history),
        curves=history.losses,
        neutral=neutral_style(table, data.style),
        sequence_scales=_sequence_scales(args.out / "content_final.pt", table) if content is not None else {},
        decoder=args.decoder,
    )
    _write_model(trained, args, args.out / ("model-mixture" if mixture else "model"))


def _paces_and_rhythm(table: FrameTable, phase: np.ndarray, data: stage_motion.MotionData) -> np.ndarray:
    """`(385, 2 + 2 C)` from Z^t: walking and jogging speed, then amplitude and rate of each phase channel at rest."""
    return np.concatenate([style_speeds(table, data.style), rest_rhythm(table, phase, data.style)], axis=1)


def _write_model(trained: Trained, args: argparse.Namespace, folder: Path) -> None:
    export_model(trained, folder)
    # the runtime, which measures it, loads no other output; an ablation is not played with
    if trained.config.output_size == OUTPUT_SIZE and not args.ablation:
        quantize_model(folder, text_encoder=args.text_encoder)
    store_model_in_half(folder)
    log.info("exported to %s", folder)


@lru_cache(1)
def _load(clips: Path, limit: int | None) -> FrameTable:
    """The frames, kept for the next variant of an ablation."""
    return load_frames(clips, limit=limit)


def _scales(
    session: Session, frames: Frames, weights: np.ndarray, content: ContentEncoder | None, texts: StyleTexts
) -> dict[str, torch.Tensor]:
    """Normalisation of x, y and Z^t: measured once per run, so that a resumed stage goes on with the same."""
    path = session.out / "scales.pt"
    if not path.exists():
        centre, deviation = stage_content.style_scale(content, texts)
        normal = stage_motion.measure(frames, weights, session)
        save_checkpoint(path, normal.tensors() | {"style_centre": centre, "style_deviation": deviation})
    parallel.wait()
    return {name: value.to(session.device) for name, value in load_checkpoint(path).items()}


def _phase(
    args: argparse.Namespace,
    session: Session,
    config: ModelConfig,
    table: FrameTable,
    weights: np.ndarray,
    wanted: bool,
) -> np.ndarray:
    stored = args.out / "phase.npy"
    if stored.exists():
        phase = np.load(stored, allow_pickle=False)
        if len(phase) == len(table):
            return phase
        log.info("%s belongs to another set of clips: encoding these", stored)
    if (args.out / "phase_final.pt").exists():
        return stage_phase.encode_table(session, config, table)
    if not wanted:
        raise FileError(f"{stored}: missing.", "Train stage 'phase' first.")
    return stage_phase.run(session, config, table, weights, args.phase, max_minutes=args.max_minutes)


def _content(
    args: argparse.Namespace,
    session: Session,
    config: ModelConfig,
    table: FrameTable,
    weights: np.ndarray,
    texts: StyleTexts,
    wanted: bool,
) -> ContentEncoder | None:
    if not config.content_encoder:
        return None
    path = args.out / "content_final.pt"
    if wanted and not path.exists():
        return stage_content.run(
            session,
            config,
            table,
            weights,
            texts,
            args.content,
            max_minutes=args.max_minutes,
            clips=args.clips or args.out / "clips",
        )
    stored = load_checkpoint(path)
    trained_with = stored["config"].get("text_encoder", SHIPPED["name"])
    if trained_with != config.text_encoder:
        raise FileError(
            f"{path}: trained with the text encoder {trained_with!r}, not {config.text_encoder!r}.",
            "Name its folder with --text-encoder, or another --out.",
        )
    module = ContentEncoder(config)
    stage_content.begin_with(module, stored["module"])
    return module.to(session.device).eval()


def _words(
    args: argparse.Namespace,
    content: ContentEncoder,
    config: ModelConfig,
    texts: StyleTexts,
    encoder: TextEncoder,
) -> None:
    """Longer sentences, once for a content encoder."""
    path = args.out / "content_final.pt"
    stored = load_checkpoint(path)
    if "longer_sentences" in stored:
        return
    device = next(content.parameters()).device
    learnt = stage_words.learn_longer_sentences(content, config, texts, encoder, args.words, args.seed)
    distances = "  ".join(f"{name} {value:.3f}" for name, value in learnt.items())
    logs = args.out / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    (logs / "words.txt").write_text(
        f"step {args.words} of {args.words}, distances {distances}", encoding="utf-8"
    )
    save_checkpoint(path, stored | {"module": content.state_dict(), "longer_sentences": learnt})
    content.to(device)


def _sequence_scales(path: Path, table: FrameTable) -> dict[str, torch.Tensor]:
    """What the motion encoder's input was normalised by; a checkpoint that lacks it was trained on the same table."""
    stored: dict[str, torch.Tensor] | None = load_checkpoint(path).get("scales")
    return stored or stage_content.Sequences(table, torch.device("cpu")).scales


def _generator(path: Path, config: ModelConfig) -> Generator:
    module = Generator(config)
    module.load_state_dict(load_checkpoint(path)["module"])
    return module


def _notes(args: argparse.Namespace, table: FrameTable, history: History) -> dict[str, object]:
    return {
        "frames": len(table),
        "clips": len(table.styles),
        "styles": sorted(set(table.styles)),
        "steps": {stage: history.steps[stage] for stage in STAGES if stage in history.steps},
        "seed": args.seed,
        "licence": archives.licence_of(set(table.sources)),
    }


if __name__ == "__main__":
    from runtime.errors import run_command

    raise SystemExit(run_command("train", main))
