"""Builds the shipped mannequin from an implicit surface: `python -m sport.training.character.build --out FILE.glb`."""
