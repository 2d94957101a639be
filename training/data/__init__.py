"""Motion data: archives of BVH files, retargeted to clips of the SPORT skeleton at 60 Hz."""
