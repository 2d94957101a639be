"""Evaluation (Sec. IV): generated and captured motion, scored by the same code."""
