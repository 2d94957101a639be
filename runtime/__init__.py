"""Motion without a window: skeleton, features, networks, controller, terrain, prompts, clips and file formats."""
