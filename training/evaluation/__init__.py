"""Evaluation (Sec. IV): generated and captured motion, scored by the same code."""

import logging

log = logging.getLogger("sport.evaluate")  # of the progress of every experiment
