"""`sport generate --batch`: many clips from a list, on all cores, with a manifest."""
