"""Feet on the ground: foot lock, leg IK and the measure of skating."""
