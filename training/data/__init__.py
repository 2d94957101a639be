"""Motion data: from archives of BVH files to retargeted clips of the SPORT skeleton at 60 Hz."""
