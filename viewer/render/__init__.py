"""Drawing of terrain, characters and overlays with OpenGL 3.3."""
