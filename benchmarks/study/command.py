"""A user study as an offline page, and the report on its answers: python -m benchmarks.study make | report."""

import argparse
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from runtime.assets import model_folder
from runtime.errors import UsageError


def main(argv: Sequence[str] | None = None) -> int:
    """Run one of the two parts; returns the exit code."""
    study = argparse.ArgumentParser(prog="python -m benchmarks.study", description=__doc__)
    parts = study.add_subparsers(title="parts", metavar="make | report", required=True)
    make = parts.add_parser("make", help="draw the films and write the page")
    make.set_defaults(command=run_make, needs=("sklearn",))
    make.add_argument("out", type=Path, metavar="DIR", help="new folder for index.html and key.json")
    make.add_argument(
        "--model",
        action="append",
        metavar="NAME=DIR",
        help="name of a method in the report and its model folder; repeatable (default: ours=the shipped model)",
    )
    make.add_argument("--clips", type=Path, metavar="DIR", help="imported capture, as a further method")
    make.add_argument("--seconds", type=float, default=5.0, help="length of a film (default: 5)")
    report = parts.add_parser("report", help="counts, means and tests of downloaded answers")
    report.set_defaults(command=run_report, needs=("statsmodels", "scipy"))
    report.add_argument("answers", type=Path, nargs="+", metavar="JSON", help="downloaded answer files")
    report.add_argument("--key", type=Path, required=True, metavar="FILE", help="key.json of the study")
    report.add_argument("--figures", type=Path, metavar="DIR", help="draw Fig. 10 and 11 into DIR")
    report.add_argument(
        "--synthetic", action="store_true", help="accept answers that are marked as synthetic"
    )
    options = study.parse_args(argv)
    for package in options.needs:
        if find_spec(package) is None:
            raise UsageError(
                f"study: the Python package '{package}' is not installed.", "Run pip install -e '.[study]'."
            )
    options.command(options)
    return 0


def run_make(options: argparse.Namespace) -> None:
    """Write the page, and print how to use it."""
    from benchmarks.study import make

    if not 2.0 <= options.seconds <= 20.0:
        raise UsageError(f" {options.seconds:g}: expected 2 to 20.", "Try 5.", "seconds")
    methods = dict(_named(text) for text in options.model or ["ours=compact"])
    page = make.make(options.out, methods, options.clips, options.seconds, report=print)
    print(f"{page}: give this file to participants; keep {page.parent / make.KEY} to yourself.")


def run_report(options: argparse.Namespace) -> None:
    """Print the report and draw the figures."""
    from benchmarks.study import report

    answers = report.read_answers(options.answers, options.key, options.synthetic)
    print(report.markdown(answers), end="")
    if options.figures is not None:
        for path in report.draw_bars(answers, options.figures):
            print(path)


def _named(text: str) -> tuple[str, Path]:
    name, _, folder = text.rpartition("=")
    return name or Path(folder).name, model_folder(folder)
