"""Obstacles that are crossed by keyframed motion: bars, gaps, walls, drops."""
