"""Ground: height maps, the ready terrains and terrain files."""
