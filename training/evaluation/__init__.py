"""Evaluation (Sec. IV) of generated and captured motion by the same code."""

import logging

log = logging.getLogger("sport.evaluate")  # progress of every experiment
