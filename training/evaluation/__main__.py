"""`python -m training.evaluation NAME`: runs an experiment by name."""

from runtime.interrupts import run_process


def main() -> int:
    """Run the command line; returns the exit code."""
    from training.evaluation.experiment import main as run

    return run()


if __name__ == "__main__":
    run_process("evaluation", main)
