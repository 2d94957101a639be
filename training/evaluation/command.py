"""`sport evaluate`: scores models against captured motion (Sec. IV, Table I), and draws the figures."""

from __future__ import annotations

import argparse
import json
import logging
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from runtime.assets import model_folder
from runtime.atomic import check_target, write_atomic
from runtime.errors import UsageError
from runtime.motion.motion_encoder import MotionEncoder
from training.evaluation.metrics.encoder_features import has_encoder
from training.evaluation.motion.plan import Options, Plan, make_plan
from training.evaluation.motion.score_capture import score_held_out, score_rollouts
from training.evaluation.motion.score_model import score_model
from training.evaluation.motion.subject import Subject
from training.evaluation.report.bars import check
from training.evaluation.report.markers import check_section, write_section
from training.evaluation.report.tables import SECTION, markdown

log = logging.getLogger("sport.evaluate")


def build_parser() -> argparse.ArgumentParser:
    """Arguments of `sport evaluate`."""
    parser = argparse.ArgumentParser(
        prog="sport evaluate",
        description="Score models against captured motion by the paper's metrics; equal arguments give equal figures, "
        "but for the times. `sport evaluate --text --help` tells of the evaluation of words.",
    )
    parser.add_argument("--clips", type=Path, required=True, metavar="DIR", help="folder of imported clips")
    parser.add_argument(
        "--model",
        type=model_folder,
        action="append",
        required=True,
        metavar="DIR",
        help="folder of an exported model; can be given several times",
    )
    parser.add_argument(
        "--features",
        type=Path,
        metavar="DIR",
        help="model folder whose motion encoder serves all distances (default: the first model's)",
    )
    _add_outputs(parser)
    _add_options(parser)
    return parser


def _add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--styles", nargs="+", metavar="STYLE", help="default: every style of the clips")
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="of followed paths per style (default: 40)"
    )
    parser.add_argument(
        "--quick", action="store_true", help="a trial: too little motion for figures to quote"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--text",
        action="store_true",
        help="score what prompts do instead; see `sport evaluate --text --help`",
    )
    parser.add_argument(
        "--courses",
        action="store_true",
        help="score how obstacles are crossed instead; see `sport evaluate --courses --help`",
    )


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to FILE")
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help="write the tables between FILE's markers"
    )
    parser.add_argument(
        "--figures", type=Path, metavar="DIR", help="draw the paper's Fig. 6, 7 and 8 into DIR"
    )
    parser.add_argument("--only-figures", action="store_true", help="draw the figures and score nothing")


def main(argv: list[str] | None = None) -> int:
    """Evaluate; the exit code is 0 also where a model misses a bar: the tables say so."""
    words = list(sys.argv[1:] if argv is None else argv)
    if "--text" in words:  # does the motion do what the words say
        from training.evaluation.text import command as text_main

        words.remove("--text")
        return text_main.main(words)
    if "--courses" in words:  # how obstacles are crossed
        from training.evaluation import courses_command

        words.remove("--courses")
        return courses_command.main(words)
    args = build_parser().parse_args(words)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    if args.only_figures and args.figures is None:
        raise UsageError("--only-figures: there is no folder for them.", "Add --figures DIR.")
    if args.json is not None:
        check_target(args.json)
    if args.markdown is not None:
        check_section(args.markdown, SECTION)
    if args.figures is not None:
        from training.evaluation.report.figures import draw_figures

        args.figures.mkdir(parents=True, exist_ok=True)
        draw_figures(args.clips, args.model[0], args.figures, args.seed, log.info)
    if not args.only_figures:
        results = evaluate(args)
        print(markdown(results), end="")
        if args.json is not None:
            write_atomic(args.json, json.dumps(results, indent=1) + "\n")
        if args.markdown is not None:
            write_section(args.markdown, SECTION, markdown(results))
    return 0


def evaluate(args: argparse.Namespace) -> dict[str, Any]:
    """All figures as plain data."""
    options = replace(Options.quick() if args.quick else Options(), seed=args.seed)
    if args.seconds is not None:
        if not 3.0 <= args.seconds <= 3600.0:
            raise UsageError(f"--seconds {args.seconds}: expected 3 to 3600.", "Try 40.")
        options = replace(options, follow_seconds=args.seconds)
    plan = make_plan(args.clips, args.styles, options, _encoder(args), log.info)
    begin = time.perf_counter()
    held_out = score_held_out(plan, log.info)
    rollouts = score_rollouts(plan, log.info)
    models = [_score(plan, folder) for folder in args.model]
    log.info("generated and scored in %.0f s", time.perf_counter() - begin)
    for model in models:
        for bar in check(model, held_out):
            log.info("%s: %s: %s (%d of %d)", model["name"], bar.name, bar.passed, bar.met, bar.cases)
    return {
        "command": _command(args),
        "options": vars(options),
        "feature_sets": plan.feature_sets,
        "styles": [g for g in plan.groups],
        "held_out": held_out,
        "rollouts": rollouts,
        "models": models,
    }


def _score(plan: Plan, folder: Path) -> dict[str, Any]:
    return score_model(plan, Subject(folder, plan.texts), log.info)


def _encoder(args: argparse.Namespace) -> MotionEncoder | None:
    """The encoder of --features; without that option that of the first model, which may have none."""
    if args.features is not None:
        return MotionEncoder(args.features)
    if has_encoder(args.model[0]):
        return MotionEncoder(args.model[0])
    log.warning("%s has no motion.onnx: distances are taken over kinematic features alone", args.model[0])
    return None


def _command(args: argparse.Namespace) -> str:
    """The command in a form that names no folder of this machine."""
    words = ["sport evaluate --clips DIR"] + [f"--model {_short(f)}" for f in args.model]
    words += [f"--features {_short(args.features)}"] if args.features else []
    words += [f"--styles {' '.join(args.styles)}"] if args.styles else []
    words += [f"--seconds {args.seconds:g}"] if args.seconds is not None else []
    words += ["--quick"] if args.quick else []
    words += [f"--seed {args.seed}"] if args.seed else []
    return " ".join(words)


def _short(folder: Path) -> str:
    return folder.as_posix() if not folder.is_absolute() else "/".join(folder.parts[-2:])
