"""Panels of the session and its surroundings."""
