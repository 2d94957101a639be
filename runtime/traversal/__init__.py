"""Obstacles that are traversed with keyframed motion: bars, gaps, walls, drops."""
