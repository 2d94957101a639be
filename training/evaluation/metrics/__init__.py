"""Metrics of the evaluation, one file each."""
