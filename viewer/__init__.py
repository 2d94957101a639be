"""The desktop application: window, input, camera, renderer, panels, capture."""
