"""A user study as a page without a network, and the report on its answers: python -m benchmarks.study make | report."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from runtime.assets import model_folder
from runtime.atomic import check_target, write_atomic
from runtime.errors import UsageError, run_command


def main(argv: Sequence[str] | None = None) -> int:
    """Run one of the two parts; the exit code."""
    study = argparse.ArgumentParser(prog="python -m benchmarks.study", description=__doc__)
    parts = study.add_subparsers(title="parts", metavar="make | report", required=True)
    make = parts.add_parser("make", help="draw the films and write the page")
    make.set_defaults(command=run_make)
    make.add_argument("out", type=Path, metavar="DIR", help="new folder for index.html and key.json")
    make.add_argument(
        "--model",
        action="append",
        metavar="NAME=DIR",
        help="a method: its name in the report and its model folder; several (default: ours=the shipped one)",
    )
    make.add_argument(
        "--clips", type=Path, metavar="DIR", help="imported capture, as a method to compare with"
    )
    make.add_argument("--styles", nargs="*", metavar="STYLE", help="default: six")
    make.add_argument("--obstacles", nargs="*", metavar="NAME", help="default: all six courses")
    make.add_argument("--seconds", type=float, default=5.0, help="of a film (default: 5)")
    report = parts.add_parser("report", help="counts, means and tests of downloaded answers")
    report.set_defaults(command=run_report)
    report.add_argument(
        "answers", type=Path, nargs="+", metavar="JSON", help="files that participants downloaded"
    )
    report.add_argument("--key", type=Path, required=True, metavar="FILE", help="key.json of the study")
    report.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")
    report.add_argument("--markdown", type=Path, metavar="FILE", help="write the report to FILE")
    report.add_argument(
        "--figures", type=Path, metavar="DIR", help="draw the bars of Fig. 10 and 11 into DIR"
    )
    report.add_argument(
        "--synthetic", action="store_true", help="accept answers that are marked as synthetic"
    )
    options = study.parse_args(argv)
    return int(options.command(options))


def run_make(options: argparse.Namespace) -> int:
    """Draw, write, and say how the page is used."""
    _needs("sklearn")
    from benchmarks.study import make
    from training.evaluation.motion.obstacles import COURSES

    if not 2.0 <= options.seconds <= 20.0:
        raise UsageError(f" {options.seconds:g}: expected 2 to 20.", "Try 5.", "seconds")
    known = [c.name for c in COURSES]
    unknown = sorted(set(options.obstacles or ()) - set(known))
    if unknown:
        raise UsageError(
            f" {unknown[0]}: there is no such course.", f"Choose {', '.join(known)}.", "obstacles"
        )
    page = make.make(
        options.out,
        dict(_named(text) for text in options.model or ["ours=compact"]),
        options.clips,
        make.STYLES if options.styles is None else options.styles,
        known if options.obstacles is None else options.obstacles,
        options.seconds,
        report=print,
    )
    print(f"{page}: give this file to participants; keep {page.parent / make.KEY} to yourself.")
    return 0


def run_report(options: argparse.Namespace) -> int:
    """Print the report, write the files."""
    _needs("statsmodels", "scipy")
    from benchmarks.study import report

    for target in (options.json, options.markdown):
        if target is not None:
            check_target(target)
    found = report.analyse(report.read_answers(options.answers, options.key, options.synthetic))
    text = report.markdown(found)
    print(text, end="")
    if options.json is not None:
        write_atomic(options.json, json.dumps(found, indent=1) + "\n")
    if options.markdown is not None:
        write_atomic(options.markdown, text)
    if options.figures is not None:
        for path in report.draw_bars(found, options.figures):
            print(path)
    return 0


def _named(text: str) -> tuple[str, Path]:
    name, _, folder = text.rpartition("=")
    return name or Path(folder).name, model_folder(folder)


def _needs(*packages: str) -> None:
    from importlib.util import find_spec

    for package in packages:
        if find_spec(package) is None:
            raise UsageError(
                f"study: the Python package '{package}' is not installed.",
                "Run pip install -e '.[study]'.",
            )


if __name__ == "__main__":
    raise SystemExit(run_command("study", main))
