"""The scene: ground, character, model, simulation and camera."""
