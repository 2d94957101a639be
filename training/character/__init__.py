"""Builds the shipped mannequin from an implicit surface: `python -m training.character.build --out FILE.glb`."""
