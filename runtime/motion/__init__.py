"""The character in motion: controller, trajectory, phase, features, networks, noise and what keeps them steady."""
