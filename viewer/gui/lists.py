"""Open lists and popups: Escape closes the innermost."""

from __future__ import annotations

from viewer.gl_bindings import imgui


def close_innermost() -> bool:
    """Close the list or popup that was opened last; whether there was one."""
    depth = len(imgui.get_current_context().open_popup_stack)
    if depth == 0:
        return False
    imgui.internal.close_popup_to_level(depth - 1, True)
    return True
