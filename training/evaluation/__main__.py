"""`python -m training.evaluation NAME`: one of the experiments by its name."""

from training.evaluation.experiment import command, main

__all__ = ["main"]

if __name__ == "__main__":
    raise SystemExit(command())
