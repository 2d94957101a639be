"""The character in motion: controller, trajectory, phase, features, networks, noise, and stabilisation of the pose."""
