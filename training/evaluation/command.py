"""`sport evaluate`: scores models against captured motion (Sec. IV, Table I), on obstacle courses, and by prompts."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from runtime.errors import UsageError
from runtime.motion.model import ExportedMotionEncoder
from training.evaluation import experiment as experiments
from training.evaluation import log
from training.evaluation.experiment import PLAN, Arguments, Experiment, Setting, command_of, option
from training.evaluation.metrics.features import has_encoder
from training.evaluation.motion import tables
from training.evaluation.motion.capture import EvaluationPlan, Options, make_plan
from training.evaluation.motion.evaluated_model import EvaluatedModel
from training.evaluation.motion.scores import score_held_out, score_model


def main(argv: Sequence[str] | None = None) -> int:
    """Evaluate; the exit code is 0 even if a model fails a criterion, which the tables show."""
    words = list(sys.argv[1:] if argv is None else argv)
    for name in ("text", "courses"):  # adherence to prompts; crossing of obstacles
        if f"--{name}" in words:
            words.remove(f"--{name}")
            return experiments.run(experiments.experiment(name), words, f"sport evaluate --{name}")
    return experiments.run(MOTION, words, "sport evaluate")


def motion(setting: Setting) -> dict[str, Any]:
    """Return all figures as plain data."""
    plan = plan_of(setting)
    held_out = score_held_out(plan)
    models = [score_model(plan, EvaluatedModel(folder, plan.texts)) for folder in setting.folders]
    for model in models:
        for bar in tables.check(model, held_out):
            log.info(f"{model['name']}: {bar.name}: {bar.passed} ({bar.met} of {bar.cases})")
    return {
        "command": command_of("sport evaluate", setting.args),
        "feature_sets": plan.feature_sets,
        "held_out": held_out,
        "models": models,
    }


def plan_of(setting: Setting, seed: int | None = None, **amounts: int) -> EvaluationPlan:
    """Make the plan of --quick, --seconds, --seed (or `seed`), --styles and --features; `amounts` replace its `Options`.

    Without --features the encoder is that of the first model with one.
    """
    args = setting.args
    options = replace(Options.quick() if args.quick else Options(), seed=args.seed if seed is None else seed)
    if not args.quick:
        options = replace(options, **amounts)
    if args.seconds is not None:
        options = replace(options, follow_seconds=args.seconds)
    folder = args.features or next((f for f in setting.folders if has_encoder(f)), None)
    if folder is None:
        log.info("no model has a motion.onnx: distances use kinematic features only")
    encoder = None if folder is None else ExportedMotionEncoder(folder)
    return make_plan(setting.args.clips, args.styles, options, encoder)


def check_seconds(args: Arguments) -> None:
    """Raise UsageError for an invalid length of paths."""
    if args.seconds is not None and not 3.0 <= args.seconds <= 3600.0:
        raise UsageError(f"--seconds {args.seconds}: expected 3 to 3600.", "Try 40.")


MOTION = Experiment(
    "Score models against captured motion by the paper's metrics; equal arguments give equal figures, except times.",
    motion,
    tables.markdown,
    tables.SECTION,
    needs=("clips",),
    options=(
        "clips",
        "models",
        *PLAN,
        "seed",
        "seconds",
        option("--text", action="store_true", help="evaluate prompts instead; has its own --help"),
        option("--courses", action="store_true", help="evaluate obstacle courses instead; also has --help"),
    ),
    check=check_seconds,
)
