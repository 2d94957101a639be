"""`python -m benchmarks.study`: takes the signals that end it, then imports what its parts need."""

from runtime.interrupts import run_process


def main() -> int:
    """Run the command line; the exit code."""
    from benchmarks.study.command import main as run

    return run()


if __name__ == "__main__":
    run_process("study", main)
