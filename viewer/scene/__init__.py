"""What is on stage: ground, character, model, simulation and camera."""
