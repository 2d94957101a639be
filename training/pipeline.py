"""`sport train`: from motion capture to an exported model, in one command or stage by stage.

| stage | does | writes into --out |
| --- | --- | --- |
| import, layer | retargets the archives' clips; edits copies; writes descriptions | clips/ |
| phase | stage 0: the periodic autoencoder, then the phases of all frames | phase_final.pt, phase.npy |
| content, words | stage 1: the content encoder; then its text network on longer sentences | content_final.pt |
| stage2 | motion encoder, modulator and E_d | scales.pt, stage2_final.pt |
| stage3 | the denoiser | stage3_final.pt |
| ground | with --course-minutes: encoder, modulator and E_d on courses the model has crossed | courses/, ground_final.pt |
| export | ONNX graphs, 8-bit weights, metadata, model card | model/ |

Each stage reads the output of earlier ones, and resumes from its own checkpoint (`NAME.pt`).
"""

import argparse
import json
import logging
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from runtime.atomic import write_atomic
from runtime.errors import FileError, UsageError
from runtime.motion.features import OUTPUT_SIZE
from training import courses, parallel
from training.arguments import STAGES, build_parser, log_progress
from training.augmentation.build import LAYERS, build_layers
from training.batches import FrameTensors
from training.data import sources
from training.data.importer import unpack
from training.export.calibrate import calibrate, phase_signs
from training.export.graph import store_model_in_half
from training.export.model import Trained, export_model
from training.export.pace import rest_rhythm, start_state, style_speeds
from training.export.quantize import quantize_model
from training.export.swings import fit_swings
from training.export.traversals import measure_traversals
from training.frames import load_frames
from training.networks.diffusion import Schedule, reverse_steps
from training.packed_run import History
from training.presets import OPEN, ModelConfig, preset
from training.run import Run
from training.session import load_checkpoint, save_checkpoint
from training.stages import content as stage_content
from training.stages import diffusion as stage_diffusion
from training.stages import ground as stage_ground
from training.stages import motion as stage_motion
from training.stages import phase as stage_phase
from training.stages import words as stage_words

log = logging.getLogger("sport.train")

PHASE_BATCH, CONTENT_BATCH = 128, 64
WRITING_FRACTION = 0.01  # of --minutes, reserved for the last checkpoint


def main(argv: list[str] | None = None) -> int:
    """Run one stage or all of them."""
    args = build_parser().parse_args(argv)
    args.ends = (
        None if args.minutes is None else time.monotonic() + 60.0 * (1.0 - WRITING_FRACTION) * args.minutes
    )
    log_progress()
    wanted = _wanted(args)
    stages = [stage for stage in wanted if stage in TRAINING]
    if stages:
        _refuse_table_one(preset(args.preset))  # before the import, which takes hours
    args.out.mkdir(parents=True, exist_ok=True)
    for stage in wanted:
        if stage in PREPARATION:
            PREPARATION[stage](args)
    if stages:
        _train(args, stages)
    return 0


def _wanted(args: argparse.Namespace) -> tuple[str, ...]:
    if args.stage != "all":
        return (args.stage,)
    return STAGES if args.minutes is None else STAGES[: STAGES.index("ground")]


def _train(args: argparse.Namespace, stages: list[str]) -> None:
    run = Run.of(args)
    for stage in stages:
        if args.processes > 1 and stage in parallel.STAGES:
            _train_together(run, stage)
        else:
            TRAINING[stage](run)


def import_clips(args: argparse.Namespace) -> None:
    """Import the clips of the archives in --data, once, unless --clips is given."""
    from training.data.importer import import_all

    if args.clips is not None:
        return
    if args.data is None:
        raise FileError("--data: missing.", "Give the folder of the motion data archives.")
    if not (args.out / "report.json").exists():  # written last
        import_all(args.data, args.out, free_only=args.preset == OPEN)


def edit_and_describe(args: argparse.Namespace) -> None:
    """Make clips with edited parts, and captions measured on captured ones, once (stage layer)."""
    from training.styles import CAPTIONS
    from training.text.clip_measures import write_clip_captions

    clips = args.clips or args.out / "clips"
    if args.layers and not (clips / LAYERS).exists():
        build_layers(clips, clips, args.layers, args.seed)
    if not (clips / CAPTIONS).exists():
        write_clip_captions(clips, clips / CAPTIONS)


def train_phase(run: Run) -> None:
    """Train stage 0, once."""
    if not run.final("phase").exists():
        stage_phase.run(run.session, run.config, run.table, run.weights, run.length("phase", PHASE_BATCH))


def train_content(run: Run) -> None:
    """Train stage 1, once."""
    if not run.config.content_encoder or run.final("content").exists():
        return
    measured = None
    if run.config.measures:
        measured = stage_content.Measured.read(run.clips, run.table, run.weights, run.session.device)
    data = stage_content.ContentData(run.table, run.frames, run.weights, run.texts, measured)
    stage_content.run(run.session, run.config, data, run.length("content", CONTENT_BATCH))


def train_words(run: Run) -> None:
    """Train the text network on longer sentences, once per content encoder."""
    content = run.content
    if content is None or not run.config.longer_sentences:
        return
    stored = load_checkpoint(run.final("content"))
    if "longer_sentences" in stored:
        return
    length = run.length("words", stage_words.BATCH)
    learnt = stage_words.learn_longer_sentences(
        content, run.config, run.texts, run.encoder, length, run.args.seed
    )
    steps = round(learnt.pop("steps"))
    distances = "  ".join(f"{name} {value:.3f}" for name, value in learnt.items())
    (run.out / "logs").mkdir(parents=True, exist_ok=True)
    (run.out / "logs" / "words.txt").write_text(
        f"step {steps} of {steps}, distances {distances}", encoding="utf-8"
    )
    save_checkpoint(
        run.final("content"), stored | {"module": content.state_dict(), "longer_sentences": learnt}
    )
    content.to(run.session.device)


def train_stage2(run: Run) -> None:
    """Train or resume stage 2."""
    stage_motion.run_stage2(run.session, run.config, run.data, run.length("stage2"))


def train_stage3(run: Run) -> None:
    """Train or resume stage 3."""
    generator = stage_diffusion.run_stage3(
        run.session, run.data, run.generator("stage2"), run.length("stage3")
    )
    save_checkpoint(run.final("stage3"), {"module": generator.state_dict()})


def train_ground(run: Run) -> None:
    """Train the generator on courses that the run's own model crossed; does nothing without --course-minutes."""
    if not _learns_courses(run):
        return
    data, generator = course_data(run), run.generator("stage3")
    generator = stage_ground.run_ground(
        run.session, run.data, data, generator, run.neutral, run.length("ground")
    )
    save_checkpoint(run.final("ground"), {"module": generator.state_dict()})


def _learns_courses(run: Run) -> bool:
    return bool(run.args.course_minutes) and run.is_played


def course_data(run: Run) -> stage_motion.MotionData:
    """Return the courses of stage ground; of several processes the first makes them, once."""
    normal = run.data.normal  # this synchronises the processes, before the first continues alone
    if parallel.rank():
        parallel.wait()
    folder = run.out / "courses"
    clips = folder / "clips"
    if not (folder / "report.json").exists():  # written last
        model = run.out / "model-before-ground"
        export_model(trained(run, "stage3", "diffusion"), model)
        minutes, seed, count = run.args.course_minutes, run.args.seed, run.args.processes
        seen = courses.make_all(model, clips, minutes, seed, count)
        write_atomic(folder / "report.json", json.dumps(seen, indent=1) + "\n")
    table = load_frames(clips, folder / "frames")
    phase = stage_phase.course_phases(run.session, run.config, table, (run.table, run.phase), folder)
    if not parallel.rank():
        parallel.wait()
    z = stage_content.style_table(run.content, run.texts_of(table, None), *run.style_scale)
    weights = np.ones(len(table))
    weights[table.start[:-1]] = 0.0
    frames = FrameTensors.of(table, phase, run.session.device)
    return stage_motion.MotionData(frames, normal, z, weights / weights.sum())


def export(run: Run) -> None:
    """Write graphs, metadata and card; for a playable model also 8-bit weights and its measured response to words and obstacles."""
    mixture = run.args.decoder == "mixture"
    folder = run.out / ("model-mixture" if mixture else "model")
    stage = "stage2" if mixture else "ground" if run.final("ground").exists() else "stage3"
    write_model(trained(run, stage, run.args.decoder), run, folder)
    # codes can be mirrored only if every sentence is encoded as for the left side
    if run.content is not None and run.config.one_sided_words and run.is_played:
        signs = phase_signs(run.table, run.phase)
        if signs is None:
            log.warning("%s: not calibrated, because no clip has a mirror image", folder)
        else:
            calibrate(folder, signs, None, run.args.text_encoder, run.args.processes)
        measure_traversals(folder)
        if run.args.data is not None:
            fit_swings(folder, unpack(run.args.data, run.out / "unpacked"))


def trained(run: Run, stage: str, decoder: str) -> Trained:
    """Collect the inputs of the export after a stage."""
    generator = run.generator(stage)
    config, data, table, content = run.config, run.data, run.table, run.content
    sigma = np.zeros(config.inference_steps)
    if decoder == "diffusion":
        sigma = stage_diffusion.estimate_variance(run.session, data, generator)
    schedule = Schedule.linear(config.diffusion_steps)
    # from Z^t: walking and jogging speed, then amplitude and rate of each phase channel at rest
    speeds = style_speeds(table, data.style, run.texts.of_pace()), rest_rhythm(table, run.phase, data.style)
    history = History.of_run(run.out)
    return Trained(
        config=config,
        content=content,
        generator=generator,
        normal=data.normal,
        style_centre=run.style_scale[0],
        style_deviation=run.style_scale[1],
        speeds=torch.as_tensor(np.concatenate(speeds, axis=1)),
        steps=reverse_steps(schedule, schedule.subsequence(config.inference_steps), sigma),
        sigma_bar_squared=sigma,
        start=start_state(table, run.phase),
        credits=sources.credits_of(set(table.sources)),
        notes={
            "frames": len(table),
            "clips": len(table.styles),
            "styles": sorted(set(table.styles)),
            "steps": {stage: history.steps[stage] for stage in STAGES if stage in history.steps},
            "seed": run.args.seed,
            "licence": sources.licence_of(set(table.sources)),
        },
        curves=history.losses,
        neutral=run.neutral,
        sequence_scales={} if content is None else load_checkpoint(run.final("content"))["scales"],
        decoder=decoder,
    )


def write_model(model: Trained, run: Run, folder: Path) -> None:
    """Write the model's folder, with weights in half precision."""
    export_model(model, folder)
    if run.is_played:
        quantize_model(folder, text_encoder=run.args.text_encoder)
    store_model_in_half(folder)
    log.info("exported to %s", folder)


PREPARATION = {"import": import_clips, "layer": edit_and_describe}
TRAINING: dict[str, Callable[[Run], None]] = {
    "phase": train_phase,
    "content": train_content,
    "words": train_words,
    "stage2": train_stage2,
    "stage3": train_stage3,
    "ground": train_ground,
    "export": export,
}


def _train_together(run: Run, stage: str) -> None:
    """Train a stage in several processes; files that all of them read are written first."""
    _ = run.phase
    if stage == "ground" and _learns_courses(run):
        course_data(run)
    parallel.run_together(run.args.processes, _train_one_of_several, run.args, stage)


def _train_one_of_several(args: argparse.Namespace, stage: str) -> None:
    log_progress()
    TRAINING[stage](Run.of(argparse.Namespace(**vars(args) | {"stage": stage})))


def _refuse_table_one(config: ModelConfig) -> None:
    """Raise UsageError for a preset whose output layout differs from the training frames: it serves parameter counts only."""
    if config.output_size != OUTPUT_SIZE:
        raise UsageError(
            f"--preset {config.name}: has {config.output_size} outputs, but training frames have {OUTPUT_SIZE}; it"
            " only serves the parameter counts of Table I.",
            "Train paper-rotations, which is the same with joint rotations.",
        )


if __name__ == "__main__":
    from runtime.errors import run_command

    raise SystemExit(run_command("train", main))
