"""`python -m training.baselines NAME`: makes a model folder of another method."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Sequence
from importlib import import_module

from runtime.errors import run_command
from training.presets import METHODS

log = logging.getLogger("sport.train")


def main(argv: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m training.baselines", description=__doc__)
    kinds = parser.add_subparsers(dest="method", required=True)
    for name, module in METHODS.items():
        method = import_module(module)
        method.add_arguments(kinds.add_parser(name, description=method.__doc__))
    args = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    print(import_module(METHODS[args.method]).main(args, log.info))
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("baselines", main))
