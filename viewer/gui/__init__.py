"""Theme, widgets, layout and general panels."""
