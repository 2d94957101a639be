"""`sport bench`: speed and memory on this machine."""

from __future__ import annotations

import argparse
from pathlib import Path

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
    from sport.benchmarks.bench import run

    return run(options.json, options.frames, options.model)
