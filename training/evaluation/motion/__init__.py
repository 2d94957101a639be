"""Motion led along paths and scored against capture."""
