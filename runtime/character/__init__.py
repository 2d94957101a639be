"""Skinned characters: glTF input and output, and the mapping of their joints to the SPORT skeleton."""
