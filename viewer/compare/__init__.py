"""The compare view: several characters side by side, controlled by one stick, to compare prompts, seeds and blends."""
