"""One file for each metric of the evaluation."""
