"""The desk around the work: the project's menu, settings, and the first minute."""
