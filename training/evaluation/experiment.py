"""Runner of experiments and benchmarks.

An `Experiment` is a record of measurement, inputs and table. `run` adds the common arguments, checks files before
measuring, prints the table, and writes figures and table: `python -m training.evaluation NAME --help`.
"""

import argparse
import json
import logging
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

from runtime.assets import model_folder
from runtime.atomic import check_target, write_atomic
from runtime.errors import UsageError, run_command
from training.data.readers import read_json
from training.evaluation.motion.evaluated_model import EvaluatedModel, style_texts
from training.markdown import check_section, write_section

Figures = Any  # plain data, as in JSON
Arguments = argparse.Namespace

# module and variable of each record; modules are imported when their experiment runs
EXPERIMENTS = {
    "motion": "training.evaluation.command:MOTION",
    "courses": "training.evaluation.on_obstacles:OBSTACLES",
    "text": "training.evaluation.text.command:TEXT",
    "animators": "training.evaluation.text.animators:ANIMATORS",
    "table1": "training.table1:TABLE1",
    "distances": "training.table1:DISTANCES",
    "gait": "training.evaluation.on_straight_walks:GAIT",
    "moments": "training.evaluation.on_moments:MOMENTS",
}

Option = tuple[str, dict[str, Any]]


def option(name: str, **settings: Any) -> Option:
    """Return an option of an experiment: arguments of `add_argument`."""
    return name, settings


_FOLDER: dict[str, Any] = {"type": model_folder, "metavar": "DIR"}
# options of several experiments
OPTIONS = {
    "clips": option("--clips", type=Path, metavar="DIR", help="folder of imported clips"),
    "model": option("--model", **_FOLDER, help="folder of an exported model; default: the shipped one"),
    "models": option(
        "--model", **_FOLDER, action="append", help="folder of an exported model; several can be given"
    ),
    "data": option("--data", type=Path, metavar="DIR", help="folder of the unpacked source files"),
    "seed": option("--seed", type=int, default=0),
    "seconds": option("--seconds", type=float, metavar="S", help="length of paths per style (default: 40)"),
    "features": option("--features", **_FOLDER, help="model whose motion encoder is used for all"),
    "styles": option("--styles", nargs="+", metavar="STYLE", help="default: every style of the clips"),
    "quick": option(
        "--quick", action="store_true", help="quick trial: too little motion for quotable figures"
    ),
}
PLAN = ("features", "styles", "quick")  # options of the amount of motion and of its features
_KEEP = "Save the figures with --json FILE first."
_OUTPUTS = (
    option("--json", type=Path, metavar="FILE", help="write all figures to FILE"),
    option("--known", type=Path, metavar="FILE", help="make the table from figures saved by --json"),
    option("--markdown", type=Path, metavar="FILE", help="write the table between the markers of FILE"),
)


@dataclass(frozen=True)
class Setting:
    """Arguments of one run, and the models that they name."""

    args: Arguments

    @cached_property
    def folders(self) -> list[Path]:
        """Model folders, by default the shipped one."""
        given = self.args.model or model_folder()
        return list(given) if isinstance(given, list) else [given]

    @cached_property
    def models(self) -> list[EvaluatedModel]:
        """The models with the descriptions of every style."""
        return [EvaluatedModel(folder, style_texts()) for folder in self.folders]


@dataclass(frozen=True)
class Experiment:
    """An experiment: its title, measurement, options and table."""

    question: str
    figures: Callable[[Setting], Figures]
    table: Callable[[Figures], str]
    section: str | Callable[[Arguments], str]  # of a document: name of the markers around the table
    options: tuple[str | Option, ...] = ()  # names in `OPTIONS`, and its own options
    needs: tuple[str, ...] = ()  # required options, except with --known
    check: Callable[[Arguments], None] = lambda args: None  # raises UsageError before measuring
    failed: Callable[[Figures], bool] = lambda figures: False  # if true, the exit code is 1

    def parser(self, program: str) -> argparse.ArgumentParser:
        """Return a parser of its own and the common arguments."""
        parser = argparse.ArgumentParser(prog=program, description=self.question)
        for own in (*self.options, *_OUTPUTS):
            name, settings = OPTIONS[own] if isinstance(own, str) else own
            parser.add_argument(name, **settings)
        return parser


def run(experiment: Experiment, argv: Sequence[str], program: str) -> int:
    """Measure, print the table and write the files; returns the exit code, 0 even if a model fails a criterion."""
    args = experiment.parser(program).parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    section = experiment.section if isinstance(experiment.section, str) else experiment.section(args)
    if args.json is not None:
        check_target(args.json)
    if args.markdown is not None:
        check_section(args.markdown, section)
    _check(experiment, args)
    figures = experiment.figures(Setting(args)) if args.known is None else read_json(args.known, _KEEP)
    text = experiment.table(figures)
    print(text.rstrip("\n"))
    if args.json is not None:
        write_atomic(args.json, json.dumps(figures, indent=1, ensure_ascii=False) + "\n")
    if args.markdown is not None:
        write_section(args.markdown, section, text)
    return int(experiment.failed(figures))


def _check(experiment: Experiment, args: Arguments) -> None:
    missing = [name for name in experiment.needs if args.known is None and getattr(args, name) is None]
    if missing:
        raise UsageError(f"--{missing[0]} is not given.", f"Add --{missing[0]} DIR.")
    for name, seeds in (("seed", [getattr(args, "seed", 0)]), ("seeds", getattr(args, "seeds", [0]))):
        if min(seeds) < 0:
            raise UsageError(f"--{name} {min(seeds)}: expected 0 or more.", "Try 0.")
    experiment.check(args)


def command_of(program: str, args: Arguments) -> str:
    """Return the command without local folders."""
    words = [program] + (["--clips DIR"] if args.clips is not None else [])
    for name in ("model", "features", "styles", "only", "seconds", "quick", "seed"):
        value = getattr(args, name, None)
        if not value:
            continue
        shown = [_short(v) for v in (value if isinstance(value, list) else [value])]
        words += [f"--{name} {v}" for v in shown] if name == "model" else [f"--{name}", *shown]
    return " ".join(word for word in words if word)


def _short(value: Any) -> str:
    if isinstance(value, Path):
        return "/".join(value.parts[-2:]) if value.is_absolute() else value.as_posix()
    return "" if value is True else f"{value:g}" if isinstance(value, float) else str(value)


def run_alone(experiment: Experiment, name: str) -> int:
    """Run a benchmark that is an experiment; returns the exit code."""
    return run_command(name, lambda: run(experiment, sys.argv[1:], f"python -m benchmarks.{name}"))


def main(argv: Sequence[str] | None = None) -> int:
    """Run `python -m training.evaluation NAME`."""
    words = list(sys.argv[1:] if argv is None else argv)
    name = words[0] if words else ""
    if name in ("-h", "--help"):
        print("python -m training.evaluation NAME --help\n\n" + "\n".join(f"  {n}" for n in EXPERIMENTS))
        return 0
    if name not in EXPERIMENTS:
        raise UsageError(f"experiment {name!r}: unknown.", f"Choose one of {', '.join(EXPERIMENTS)}.")
    return run(experiment(name), words[1:], f"python -m training.evaluation {name}")


def experiment(name: str) -> Experiment:
    """Return the record of one of `EXPERIMENTS`."""
    module, record = EXPERIMENTS[name].split(":")
    found: Experiment = getattr(import_module(module), record)
    return found
