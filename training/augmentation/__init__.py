"""Widening the captured styles: parametric edits of body parts with exact descriptions, and parts of other styles."""
