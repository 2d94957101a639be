"""Measures of the body: one table of what it is measured by, and how each is read off a motion."""
