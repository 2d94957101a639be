"""Obstacles that are crossed by keyed motion: bars, gaps, walls, drops."""
