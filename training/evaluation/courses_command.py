"""`sport evaluate --courses`: six obstacle courses by six styles, walking and jogging, before and after foot lock."""

from __future__ import annotations

import argparse
import json
import logging
from pathlib import Path
from typing import Any

from runtime.assets import model_folder
from runtime.atomic import check_target, write_atomic
from runtime.errors import UsageError
from training.evaluation.metrics.recognition import StyleClassifier
from training.evaluation.motion.obstacle_courses import COURSES, CourseRun
from training.evaluation.motion.plan import Options, make_plan, style_texts
from training.evaluation.motion.score_obstacles import STYLES, by_name, runner_of, score_obstacles
from training.evaluation.motion.subject import Subject
from training.evaluation.report.course_tables import SECTION, markdown
from training.evaluation.report.markers import check_section, write_section

log = logging.getLogger("sport.evaluate")


def build_parser() -> argparse.ArgumentParser:
    """Arguments of `sport evaluate --courses`."""
    parser = argparse.ArgumentParser(
        prog="sport evaluate --courses",
        description="Lead a character over six obstacle courses and measure how it crosses them. Equal arguments give equal figures.",
    )
    parser.add_argument(
        "--model",
        type=model_folder,
        metavar="DIR",
        help="folder of an exported model (default: the shipped one)",
    )
    parser.add_argument(
        "--clips",
        type=Path,
        metavar="DIR",
        help="folder of imported clips, to tell whether styles are recognised",
    )
    parser.add_argument(
        "--styles", nargs="+", metavar="STYLE", default=list(STYLES), help=f"default: {' '.join(STYLES)}"
    )
    parser.add_argument(
        "--course",
        nargs="+",
        metavar="NAME",
        default=[],
        choices=[c.name for c in COURSES],
        help="default: all six",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to FILE")
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help="write the tables between FILE's markers"
    )
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="draw a contact sheet of each course into DIR"
    )
    parser.add_argument("--seed", type=int, default=0)
    return parser


def main(argv: list[str]) -> int:
    """Evaluate; the exit code is 0 also where obstacles are not crossed: the tables say so."""
    args = build_parser().parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    if args.seed < 0:
        raise UsageError(f"--seed {args.seed}: expected 0 or more.", "Try 0.")
    if args.json is not None:
        check_target(args.json)
    if args.markdown is not None:
        check_section(args.markdown, SECTION)
    if args.pictures is not None:
        args.pictures.mkdir(parents=True, exist_ok=True)
    results = evaluate(args)
    print(markdown(results), end="")
    if args.json is not None:
        write_atomic(args.json, json.dumps(results, indent=1) + "\n")
    if args.markdown is not None:
        write_section(args.markdown, SECTION, markdown(results))
    return 0


def evaluate(args: argparse.Namespace) -> dict[str, Any]:
    """All figures as plain data; pictures are drawn on the way."""
    subject = Subject(args.model or model_folder(), style_texts(set(args.styles)))
    walks: list[CourseRun] = []
    keep = None if args.pictures is None else lambda run: _keep(walks, run, args)
    runner, courses = runner_of(subject, args.seed), by_name(args.course)
    results = score_obstacles(runner, args.styles, courses, _classifier(args), log.info, keep)
    return {"command": _command(args), "model": subject.name, **results}


def _keep(walks: list[CourseRun], run: CourseRun, args: argparse.Namespace) -> None:
    """Draw a course when the last style has walked over it."""
    from training.evaluation.report.course_pictures import draw_courses

    if "walk" in run.motion.name:
        walks.append(run)
    if len(walks) == len(args.styles):
        draw_courses(walks, args.pictures / f"{run.course.name}.png")
        walks.clear()


def _classifier(args: argparse.Namespace) -> StyleClassifier | None:
    """Of all captured styles, as in `sport evaluate`; None without clips."""
    if args.clips is None:
        return None
    return make_plan(args.clips, None, Options(), None, log.info).classifier


def _command(args: argparse.Namespace) -> str:
    """The command in a form that names no folder of this machine."""
    words = ["sport evaluate --courses"]
    words += ["--clips DIR"] if args.clips else []
    words += [f"--model {args.model.name}"] if args.model else []
    words += [f"--styles {' '.join(args.styles)}"] if tuple(args.styles) != STYLES else []
    words += [f"--course {' '.join(args.course)}"] if args.course else []
    words += [f"--seed {args.seed}"] if args.seed else []
    return " ".join(words)
