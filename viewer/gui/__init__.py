"""Theme, widgets, layout and the panels that belong to no room."""
