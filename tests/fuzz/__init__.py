"""Damaged inputs for every reader: `python -m tests.fuzz --count 100000`; a few of each are part of the tests."""
