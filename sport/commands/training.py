"""`sport train` and `sport evaluate`: their modules need the extra packages of `[train]` and parse their own arguments."""

import importlib
from collections.abc import Sequence

from runtime.errors import UsageError

COMMANDS = {
    "train": ("training.pipeline", "train the networks from motion data"),
    "evaluate": ("training.evaluation.command", "score models against captured motion"),
}


def run(command: str, arguments: Sequence[str]) -> int:
    """Run a command of `COMMANDS` with its arguments; UsageError names a package that is not installed."""
    module = COMMANDS[command][0]
    if command == "train" and {"-h", "--help"} & set(arguments):
        from training.arguments import build_parser  # needs no torch

        build_parser().parse_args(["--help"])
    try:
        entry = importlib.import_module(module)
    except ModuleNotFoundError as error:
        missing = error.name or module
        if missing.split(".")[0] in ("training", "runtime"):
            raise UsageError(
                f"sport {command}: this installation has no module {missing}.", "Update it."
            ) from error
        raise UsageError(
            f"sport {command}: the Python package '{missing}' is not installed.",
            "Run pip install -e '.[train]'.",
        ) from error
    result = entry.main(arguments)
    return int(result or 0)
