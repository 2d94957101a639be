"""The `sport` command: installs the signal handlers, then imports what its subcommand needs."""

from __future__ import annotations

import sys

from runtime.interrupts import leave, take_signals

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

NEW_OBJECTS = 20_000  # between garbage collections: Python's 700 cost a tenth of the start-up


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code: 0, 1 for a failed check, 2 when the user can correct what is wrong.

    Without `argv` the command is this whole process: a signal ends it, and it does not return.
    """
    if argv is None:
        take_signals("sport")
        leave(run(sys.argv[1:]))
    return run(list(argv))


def run(arguments: Sequence[str]) -> int:
    """Run the command with its arguments, `view` without any, and return the exit code."""
    import gc

    gc.set_threshold(NEW_OBJECTS)
    from runtime.errors import run_command

    def command() -> int:
        from sport.parser import run

        return run([*arguments] or ["view"])

    return run_command("sport", command)


if __name__ == "__main__":
    main()
