"""Ground: height maps, built-in terrains and terrain files."""
