"""Measures of the body: one table, and how each is computed from a motion."""
