"""One runner for every experiment: what is generated and measured, from which inputs, in which table.

An `Experiment` is a record. `run` gives it the common arguments, checks the files before anything is measured,
prints the table, and writes figures and table: `python -m training.evaluation NAME --help`.
"""

from __future__ import annotations

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
from runtime.errors import FileError, UsageError
from training.evaluation.motion.evaluated_model import EvaluatedModel, style_texts
from training.markdown import check_section, write_section

log = logging.getLogger("sport.evaluate")

Figures = Any  # plain data, as JSON holds it
Arguments = argparse.Namespace

# where the record of each name stands; modules are imported when their experiment is run
EXPERIMENTS = {
    "motion": "training.evaluation.command:MOTION",
    "courses": "training.evaluation.on_obstacles:OBSTACLES",
    "text": "training.evaluation.text.command:TEXT",
    "animators": "training.evaluation.text.animators:ANIMATORS",
    "table1": "training.evaluation.compared_models:TABLE1",
    "distances": "training.evaluation.compared_models:DISTANCES",
    "gait": "training.evaluation.on_straight_walks:GAIT",
    "moments": "training.evaluation.on_moments:MOMENTS",
}

Option = tuple[str, dict[str, Any]]


def option(name: str, **settings: Any) -> Option:
    """An option of one experiment, as `add_argument` takes it."""
    return name, settings


SEED = option("--seed", type=int, default=0)
STYLES = option("--styles", nargs="+", metavar="STYLE", help="default: every style of the clips")
SECONDS = option("--seconds", type=float, metavar="S", help="of followed paths per style (default: 40)")
QUICK = option("--quick", action="store_true", help="a trial: too little motion for figures to quote")
FEATURES = option(
    "--features", type=model_folder, metavar="DIR", help="model whose motion encoder serves all"
)
PLAN = (FEATURES, STYLES, QUICK, SEED)  # of how much is generated, and what it is compared by


@dataclass(frozen=True)
class Setting:
    """The arguments of one run, and what is loaded by them."""

    args: Arguments

    @property
    def clips(self) -> Path:
        """The folder of imported clips."""
        return Path(self.args.clips)

    @cached_property
    def folders(self) -> list[Path]:
        """Model folders, the shipped one where none is given."""
        given = self.args.model or model_folder()
        return list(given) if isinstance(given, list) else [given]

    @cached_property
    def models(self) -> list[EvaluatedModel]:
        """The models with the descriptions of every style."""
        return [EvaluatedModel(folder, style_texts()) for folder in self.folders]

    @property
    def model(self) -> EvaluatedModel:
        """The one model."""
        return self.models[0]

    def report(self, line: str) -> None:
        """Log progress."""
        log.info(line)


@dataclass(frozen=True)
class Experiment:
    """What is generated and measured, from which inputs, and which table shows it."""

    question: str
    figures: Callable[[Setting], Figures]
    table: Callable[[Figures], str]
    section: str  # of a document, between whose markers the table goes
    clips: bool | None = False  # whether a folder of imported clips is needed; None: it can be given
    many: bool = False  # whether several models can be given
    options: tuple[Option, ...] = ()  # its own
    check: Callable[[Arguments], None] = lambda args: None  # UsageError before anything is measured

    def parser(self, program: str) -> argparse.ArgumentParser:
        """The common arguments, and its own."""
        parser = argparse.ArgumentParser(prog=program, description=self.question)
        if self.clips is not False:
            parser.add_argument("--clips", type=Path, metavar="DIR", help="folder of imported clips")
        words = "several can be given" if self.many else "default: the shipped one"
        parser.add_argument(
            "--model",
            type=model_folder,
            metavar="DIR",
            action="append" if self.many else "store",
            help=f"folder of an exported model; {words}",
        )
        for name, settings in self.options:
            parser.add_argument(name, **settings)
        parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to FILE")
        parser.add_argument(
            "--known", type=Path, metavar="FILE", help="make the table of the figures that --json kept"
        )
        parser.add_argument(
            "--markdown", type=Path, metavar="FILE", help="write the table between FILE's markers"
        )
        return parser


def run(experiment: Experiment, argv: Sequence[str], program: str) -> int:
    """Measure, print the table, write the files; the exit code, 0 also where a model misses a bar."""
    args = experiment.parser(program).parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    if args.json is not None:
        check_target(args.json)
    if args.markdown is not None:
        check_section(args.markdown, experiment.section)
    if experiment.clips and args.known is None and args.clips is None:
        raise UsageError("--clips: no folder of imported clips is given.", "Add --clips DIR.")
    if getattr(args, "seed", 0) < 0:
        raise UsageError(f"--seed {args.seed}: expected 0 or more.", "Try 0.")
    experiment.check(args)
    figures = experiment.figures(Setting(args)) if args.known is None else read_json(args.known)
    text = experiment.table(figures)
    print(text.rstrip("\n"))
    if args.json is not None:
        write_atomic(args.json, json.dumps(figures, indent=1, ensure_ascii=False) + "\n")
    if args.markdown is not None:
        write_section(args.markdown, experiment.section, text)
    return 0


def command_of(program: str, args: Arguments) -> str:
    """The command in a form that names no folder of this machine."""
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


def read_json(path: Path) -> Figures:
    """What --json or --store kept; FileError where it cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(
            f"{path}: not a readable JSON file.", "Keep the figures with --json FILE first."
        ) from error


def main(argv: Sequence[str] | None = None) -> int:
    """`python -m training.evaluation NAME`."""
    words = list(sys.argv[1:] if argv is None else argv)
    if not words or words[0] not in EXPERIMENTS:
        if words and words[0] in ("-h", "--help"):
            print("python -m training.evaluation NAME --help\n\n" + "\n".join(f"  {n}" for n in EXPERIMENTS))
            return 0
        raise UsageError(
            f"experiment {words[0] if words else ''!r}: unknown.", f"Choose one of {', '.join(EXPERIMENTS)}."
        )
    module, record = EXPERIMENTS[words[0]].split(":")
    found: Experiment = getattr(import_module(module), record)
    return run(found, words[1:], f"python -m training.evaluation {words[0]}")
