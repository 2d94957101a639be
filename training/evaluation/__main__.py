"""`python -m training.evaluation NAME`: one of the experiments by its name."""

from runtime.interrupts import run_process


def main() -> int:
    """Run the command line; the exit code."""
    from training.evaluation.experiment import main as run

    return run()


if __name__ == "__main__":
    run_process("evaluation", main)
