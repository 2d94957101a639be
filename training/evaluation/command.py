"""`sport evaluate`: models against captured motion (Sec. IV, Table I), on obstacle courses, and by their words."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from runtime.assets import model_folder
from runtime.errors import UsageError
from runtime.motion.motion_encoder import ExportedMotionEncoder
from training.evaluation.experiment import Arguments, Experiment, Setting, run
from training.evaluation.metrics.classifiers import StyleClassifier
from training.evaluation.metrics.features import has_encoder
from training.evaluation.motion.capture import Options, make_plan
from training.evaluation.motion.obstacles import (
    COURSES as OBSTACLE_COURSES,
)
from training.evaluation.motion.obstacles import (
    STYLES,
    ObstacleRun,
    by_name,
    runner_of,
    score_obstacles,
)
from training.evaluation.motion.scores import score_held_out, score_model, score_rollouts
from training.evaluation.motion.subject import Subject
from training.evaluation.report import courses, tables


def main(argv: Sequence[str] | None = None) -> int:
    """Evaluate; the exit code is 0 also where a model misses a bar: the tables say so."""
    words = list(sys.argv[1:] if argv is None else argv)
    if "--text" in words:  # does the motion do what the words say
        from training.evaluation.text.command import TEXT

        words.remove("--text")
        return run(TEXT, words, "sport evaluate --text")
    if "--courses" in words:  # how obstacles are crossed
        words.remove("--courses")
        return run(COURSES, words, "sport evaluate --courses")
    return run(MOTION, words, "sport evaluate")


# --- motion: distances, skating, diversity, times, recognition, terrain, transitions ---------------------------------


def motion(setting: Setting) -> dict[str, Any]:
    """All figures as plain data; with --figures the paper's Fig. 6, 7 and 8 too."""
    args = setting.args
    if args.figures is not None:
        from training.evaluation.report.figures import draw_figures

        args.figures.mkdir(parents=True, exist_ok=True)
        draw_figures(setting.clips, setting.folders[0], args.figures, args.seed, setting.report)
        if args.only_figures:
            return {}
    options = replace(Options.quick() if args.quick else Options(), seed=args.seed)
    if args.seconds is not None:
        options = replace(options, follow_seconds=args.seconds)
    plan = make_plan(setting.clips, args.styles, options, _encoder(setting), setting.report)
    held_out = score_held_out(plan, setting.report)
    models = [score_model(plan, Subject(folder, plan.texts), setting.report) for folder in setting.folders]
    for model in models:
        for bar in tables.check(model, held_out):
            setting.report(f"{model['name']}: {bar.name}: {bar.passed} ({bar.met} of {bar.cases})")
    return {
        "command": command_of("sport evaluate", args, clips=True),
        "options": vars(options),
        "feature_sets": plan.feature_sets,
        "styles": list(plan.groups),
        "held_out": held_out,
        "rollouts": score_rollouts(plan, setting.report),
        "models": models,
    }


def _encoder(setting: Setting) -> ExportedMotionEncoder | None:
    """The encoder of --features; without that option that of the first model, which may have none."""
    if setting.args.features is not None:
        return ExportedMotionEncoder(setting.args.features)
    first = setting.folders[0]
    if has_encoder(first):
        return ExportedMotionEncoder(first)
    setting.report(f"{first} has no motion.onnx: distances are taken over kinematic features alone")
    return None


def _check_motion(args: Arguments) -> None:
    if args.only_figures and args.figures is None:
        raise UsageError("--only-figures: there is no folder for them.", "Add --figures DIR.")
    if args.seconds is not None and not 3.0 <= args.seconds <= 3600.0:
        raise UsageError(f"--seconds {args.seconds}: expected 3 to 3600.", "Try 40.")


def command_of(program: str, args: Arguments, clips: bool = False) -> str:
    """The command in a form that names no folder of this machine."""
    words = [program] + (["--clips DIR"] if clips else [])
    for name, value in vars(args).items():
        option = f"--{name.replace('_', '-')}"
        if name in ("model", "features") and value:
            words += [f"{option} {_short(f)}" for f in (value if isinstance(value, list) else [value])]
        elif name in ("styles", "course", "only") and value:
            words.append(f"{option} {' '.join(value)}")
        elif name == "seconds" and value is not None:
            words.append(f"{option} {value:g}")
        elif (name == "quick" and value) or (name == "seed" and value):
            words.append(option if value is True else f"{option} {value}")
    return " ".join(words)


def _short(folder: Path) -> str:
    return folder.as_posix() if not folder.is_absolute() else "/".join(folder.parts[-2:])


SEED: tuple[str, dict[str, Any]] = ("--seed", {"type": int, "default": 0})

MOTION = Experiment(
    "Score models against captured motion by the paper's metrics; equal arguments give equal figures, but for the times.",
    motion,
    lambda results: tables.markdown(results) if results else "",
    tables.SECTION,
    clips=True,
    models=2,
    options=(
        (
            "--features",
            {
                "type": model_folder,
                "metavar": "DIR",
                "help": "model folder whose motion encoder serves all distances (default: the first model's)",
            },
        ),
        ("--figures", {"type": Path, "metavar": "DIR", "help": "draw the paper's Fig. 6, 7 and 8 into DIR"}),
        ("--only-figures", {"action": "store_true", "help": "draw the figures and score nothing"}),
        ("--styles", {"nargs": "+", "metavar": "STYLE", "help": "default: every style of the clips"}),
        (
            "--seconds",
            {"type": float, "metavar": "S", "help": "of followed paths per style (default: 40)"},
        ),
        ("--quick", {"action": "store_true", "help": "a trial: too little motion for figures to quote"}),
        (
            "--text",
            {"action": "store_true", "help": "score what prompts do instead; it has a help of its own"},
        ),
        ("--courses", {"action": "store_true", "help": "score how obstacles are crossed instead; likewise"}),
        SEED,
    ),
    check=_check_motion,
)

# --- courses: six obstacle courses by six styles, walking and jogging, before and after foot lock --------------------


def obstacle_courses(setting: Setting) -> dict[str, Any]:
    """All figures as plain data; pictures are drawn on the way."""
    args, runs = setting.args, []

    def draw(run: ObstacleRun) -> None:
        """Draw a course when the last style has walked over it."""
        if "walk" in run.motion.name:
            runs.append(run)
        if len(runs) == len(args.styles):
            courses.draw_courses(runs, args.pictures / f"{run.course.name}.png")
            runs.clear()

    if args.pictures is not None:
        args.pictures.mkdir(parents=True, exist_ok=True)
    results = score_obstacles(
        runner_of(setting.subject, args.seed),
        args.styles,
        by_name(args.course),
        _classifier(setting),
        setting.report,
        None if args.pictures is None else draw,
    )
    named = Arguments(**{**vars(args), "styles": [] if tuple(args.styles) == STYLES else args.styles})
    command = command_of("sport evaluate --courses", named, clips=args.clips is not None)
    return {"command": command, "model": setting.subject.name, **results}


def _classifier(setting: Setting) -> StyleClassifier | None:
    """Of all captured styles, as in `sport evaluate`; None without clips."""
    if setting.args.clips is None:
        return None
    return make_plan(setting.clips, None, Options(), None, setting.report).classifier


def _check_courses(args: Arguments) -> None:
    if args.seed < 0:
        raise UsageError(f"--seed {args.seed}: expected 0 or more.", "Try 0.")


COURSES = Experiment(
    "Lead a character over six obstacle courses and measure how it crosses them. Equal arguments give equal figures.",
    obstacle_courses,
    courses.markdown,
    courses.SECTION,
    clips=None,  # to tell whether styles are recognised
    options=(
        (
            "--styles",
            {
                "nargs": "+",
                "metavar": "STYLE",
                "default": list(STYLES),
                "help": f"default: {' '.join(STYLES)}",
            },
        ),
        (
            "--course",
            {
                "nargs": "+",
                "metavar": "NAME",
                "default": [],
                "choices": [c.name for c in OBSTACLE_COURSES],
                "help": "default: all six",
            },
        ),
        (
            "--pictures",
            {"type": Path, "metavar": "DIR", "help": "draw a contact sheet of each course into DIR"},
        ),
        SEED,
    ),
    check=_check_courses,
)
