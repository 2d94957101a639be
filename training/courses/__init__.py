"""Courses: made ground, crossings of a model on it, and what a crossing has to pass."""
