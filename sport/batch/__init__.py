"""`sport generate --batch`: many clips from a list, on all cores or a Ray cluster, and a manifest of what was made."""
