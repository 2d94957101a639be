"""Projects in the viewer: saving, opening, autosave, and their menu."""
