"""The compare view: several characters next to each other on one stick, to compare prompts, seeds and blends."""
