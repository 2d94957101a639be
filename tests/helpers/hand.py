"""User input to the application's window: mouse, wheel, text, and changes of the window."""

from viewer.gl_bindings import glfw, imgui
from viewer.window import KEY_CODES, Window


def mouse(window: Window, x: float, y: float, button: int | None = None, down: bool = False) -> None:
    """Move the mouse to x, y (screen units), and change a button there."""
    imgui.backends.glfw_cursor_enter_callback(window.address, 1)
    imgui.backends.glfw_cursor_pos_callback(window.address, x, y)
    if button is not None and window._injected:
        # the backend would query modifiers from the real keyboard
        window._on_mouse_button(None, button, int(down), 0)
        imgui.get_io().add_mouse_button_event(button, down)
    elif button is not None:
        imgui.backends.glfw_mouse_button_callback(window.address, button, int(down), 0)


def wheel(window: Window, steps: float) -> None:
    """Turn the wheel; positive is away from the user."""
    imgui.backends.glfw_scroll_callback(window.address, 0.0, steps)


def text(window: Window, text: str) -> None:
    """Type text."""
    for character in text:
        imgui.backends.glfw_char_callback(window.address, ord(character))


def repeat(window: Window, name: str) -> None:
    """Repeat a key that is down."""
    imgui.backends.glfw_key_callback(window.address, KEY_CODES[name], 0, glfw.REPEAT, 0)


def focus(window: Window, focused: bool) -> None:
    """Give or take the window's focus."""
    imgui.backends.glfw_window_focus_callback(window.address, int(focused))


def resize(window: Window, width: int, height: int) -> None:
    """Resize the window, in screen units."""
    glfw.set_window_size(window.handle, width, height)
