"""`sport bench`: speed and memory on this machine."""

import argparse
from pathlib import Path

from runtime.errors import UsageError
from sport.commands.arguments import Subparsers, add_model


def add(commands: Subparsers) -> None:
    """Declare the arguments."""
    bench = commands.add_parser("bench", help="measure speed and memory on this machine")
    bench.set_defaults(command=run)
    bench.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")
    bench.add_argument("--frames", type=int, default=1000, metavar="N", help="frames to time (default: 1000)")
    add_model(bench)


def run(options: argparse.Namespace) -> int:
    """Print the figures, and write them where a file is named."""
    try:
        from benchmarks.bench import run
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "benchmarks":
            raise
        raise UsageError(
            "sport bench: the benchmarks are not part of an installed package.",
            "Run it in a clone of the repository.",
        ) from error
    return run(options.json, options.frames, options.model)
