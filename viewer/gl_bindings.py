"""Imports the native window libraries, here only, in the one order that works.

imgui-bundle carries its own glfw library and points the `glfw` package at it, so it must come first; in the other
order two glfw libraries are loaded and the ImGui backend fails under Wayland.
"""

# ruff: noqa: I001  (the order of these imports is the subject of this file)
from runtime.errors import DisplayError

try:
    from imgui_bundle import imgui, implot
    from imgui_bundle.imguizmo import im_guizmo
    import glfw
    import moderngl
except ImportError as error:  # a missing shared library of the system surfaces as ImportError too
    raise DisplayError(
        f"The window libraries cannot be loaded: {error}.",
        "Install libgl1, libegl1, libx11-6 and libxext6 (apt) or your system's OpenGL, and `pip install sport-viewer` again.",
    ) from error

__all__ = ["glfw", "im_guizmo", "imgui", "implot", "moderngl"]
