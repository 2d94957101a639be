"""`python -m training.evaluation NAME`: one of the experiments by its name."""

from runtime.interrupts import run_process
from training.evaluation.experiment import main

if __name__ == "__main__":
    run_process("evaluation", main)
