"""Data augmentation of captured styles: parametric edits of body parts, with exact descriptions."""
