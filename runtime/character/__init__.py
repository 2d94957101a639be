"""Skinned characters: glTF in and out, and which of their joints plays which of ours."""
