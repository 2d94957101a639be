"""Exports of a take from the window."""
