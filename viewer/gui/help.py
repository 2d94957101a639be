"""The help window's table of all controls, for both devices."""

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px
from viewer.input.bindings import BUTTONS, HELP, KEYS, help_text
from viewer.settings import Settings

COLUMNS_PX = (190.0, 190.0, 170.0)  # what, keyboard and mouse, gamepad; at scale 1
WIDTH_PX = sum(COLUMNS_PX) + 66.0


def draw(fonts: Fonts, settings: Settings) -> None:
    """Draw the table of all controls, with the keys and buttons from the settings."""
    imgui.push_style_var(imgui.StyleVar_.cell_padding, imgui.ImVec2(px(6), px(1.5)))
    shown = imgui.begin_table("controls", 3, imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.row_bg)
    imgui.pop_style_var()  # a table keeps the style it began with
    if not shown:
        return
    for name, width in zip(("", "Keyboard and mouse", "Gamepad"), COLUMNS_PX, strict=True):
        imgui.table_setup_column(name, imgui.TableColumnFlags_.width_fixed, px(width))
    imgui.table_next_row()
    for i, text in enumerate(("", f"{ICON.keyboard} Keyboard and mouse", f"{ICON.gamepad} Gamepad")):
        imgui.table_set_column_index(i)
        widgets.muted(text)
    for title, rows in HELP:
        imgui.table_next_row()
        imgui.table_set_column_index(0)
        imgui.push_font(fonts.bold, theme.FONT_SIZE_PX)
        widgets.text(title, theme.ACCENT)
        imgui.pop_font()
        for what, keys, pad in rows:
            imgui.table_next_row()
            keys = help_text(keys, KEYS, settings.keys)
            for i, text in enumerate((what, keys, help_text(pad, BUTTONS, settings.pad_buttons))):
                imgui.table_set_column_index(i)
                imgui.text_unformatted(text)
    imgui.end_table()
