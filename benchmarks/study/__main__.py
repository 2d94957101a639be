"""`python -m benchmarks.study`: handles termination signals, then imports what its parts need."""

from runtime.interrupts import run_process


def main() -> int:
    """Run the command line; returns the exit code."""
    from benchmarks.study.command import main as run

    return run()


if __name__ == "__main__":
    run_process("study", main)
