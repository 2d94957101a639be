"""`sport generate --batch`: many clips from a list, on all cores, and a manifest of what was made."""
