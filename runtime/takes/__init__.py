"""Takes: clips, BVH, and what a take was made with."""
