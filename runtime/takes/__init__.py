"""Takes: clips, their recording and input, edits and loops."""
