"""Generated motion along paths, scored against capture."""
