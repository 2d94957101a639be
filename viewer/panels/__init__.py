"""Panels that show the session and what lies around it."""
