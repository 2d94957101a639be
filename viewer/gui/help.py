"""The help overlay: every control, for both devices."""

from __future__ import annotations

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.focus import OVER
from viewer.gui.panels import FITTED, dim_behind
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px
from viewer.input.bindings import BUTTONS, HELP, KEYS, help_text
from viewer.settings import Settings

COLUMNS = (190.0, 190.0, 170.0)  # what, keyboard and mouse, gamepad; pixels at scale 1


def draw(fonts: Fonts, settings: Settings) -> bool:
    """Draw the help in the middle, above everything, with the keys and buttons of the settings.

    Returns whether it was closed by its button or a click outside.
    """
    size = imgui.get_io().display_size
    closed = dim_behind("Controls")
    imgui.set_next_window_pos(
        imgui.ImVec2(size.x / 2, size.y / 2), imgui.Cond_.always, imgui.ImVec2(0.5, 0.5)
    )
    imgui.set_next_window_size_constraints(
        imgui.ImVec2(0, 0), imgui.ImVec2(max(size.x - px(20), 32), max(size.y - px(20), 32))
    )
    imgui.push_style_color(imgui.Col_.window_bg, imgui.ImVec4(*theme.PANEL[:3], 1.0))
    imgui.push_style_var(imgui.StyleVar_.cell_padding, imgui.ImVec2(px(6), px(1.5)))
    imgui.begin(f"Controls{OVER}", None, FITTED)
    closed |= _title(fonts)
    _table(fonts, settings)
    imgui.end()
    imgui.pop_style_var()
    imgui.pop_style_color()
    return closed


def _title(fonts: Fonts) -> bool:
    top = imgui.get_cursor_pos()
    close_width = imgui.get_frame_height()
    imgui.set_cursor_pos_x(top.x + px(sum(COLUMNS)) + 6 * px(6) - close_width)
    closed = widgets.button(ICON.close, close_width, "Close (F1)")
    imgui.set_cursor_pos(top)
    widgets.heading(fonts, ICON.help, "Controls")
    imgui.dummy(imgui.ImVec2(0, px(2)))
    return closed


def _table(fonts: Fonts, settings: Settings) -> None:
    if not imgui.begin_table("controls", 3, imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.row_bg):
        return
    for name, width in zip(("", "Keyboard and mouse", "Gamepad"), COLUMNS, strict=True):
        imgui.table_setup_column(name, imgui.TableColumnFlags_.width_fixed, px(width))
    imgui.table_next_row()
    for i, text in enumerate(("", f"{ICON.keyboard} Keyboard and mouse", f"{ICON.gamepad} Gamepad")):
        imgui.table_set_column_index(i)
        widgets.muted(text)
    for title, rows in HELP:
        imgui.table_next_row()
        imgui.table_set_column_index(0)
        imgui.push_font(fonts.bold, theme.FONT_SIZE_PX)
        with widgets.color(imgui.Col_.text, theme.ACCENT):
            imgui.text_unformatted(title)
        imgui.pop_font()
        for what, keys, pad in rows:
            imgui.table_next_row()
            keys = help_text(keys, KEYS, settings.keys)
            for i, text in enumerate((what, keys, help_text(pad, BUTTONS, settings.pad_buttons))):
                imgui.table_set_column_index(i)
                imgui.text_unformatted(text)
    imgui.end_table()
