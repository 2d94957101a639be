"""Evaluation (Sec. IV): what generated motion is worth beside captured motion, scored by the same code."""
