"""The wall: several characters side by side on one stick, to compare prompts, seeds and blends."""
