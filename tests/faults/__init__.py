"""Faults of process, display and disk, made for real: `python -m tests.faults --times 20`."""
