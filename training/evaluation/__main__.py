"""`python -m training.evaluation NAME`: one of the experiments by its name."""

from runtime.errors import run_command
from training.evaluation.experiment import main

if __name__ == "__main__":
    raise SystemExit(run_command("evaluation", main))
