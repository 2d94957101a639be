"""Fonts and colours of the interface: dark, quiet, one accent."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.errors import DisplayError
from viewer.gl_bindings import imgui

Color = tuple[float, float, float, float]

FONT_SIZE_PX = 15.0  # pixels at scale 1


def _hex(code: str, alpha: float = 1.0) -> Color:
    r, g, b = (int(code[i : i + 2], 16) / 255.0 for i in (0, 2, 4))
    return r, g, b, alpha


ACCENT = _hex("4FC3A1")
ACCENT_HOVER = _hex("66D4B4")
ACCENT_DIM = _hex("4FC3A1", 0.22)
ACCENT_FILL = _hex("4FC3A1", 0.36)
ACCENT_LOCKED = _hex("20322F")
ON_ACCENT = _hex("0C1613")
TEXT = _hex("E8EAED")
MUTED = _hex("9BA3AD")
RECORD = _hex("EF5B5B")
WARNING = _hex("F0B65A")
ERROR = _hex("FF8278")
PANEL = _hex("16191E", 0.95)
POPUP = _hex("1C2027", 0.98)
FIELD = _hex("242931")
FIELD_HOVER = _hex("2D343E")
FIELD_ACTIVE = _hex("36404C")
LINE = _hex("FFFFFF", 0.08)
CLEAR: Color = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Icons:
    """The FontAwesome 6 glyphs used by the panels."""

    prompt: str = "\uf075"
    scene: str = "\uf6fc"
    clips: str = "\uf008"
    play: str = "\uf04b"
    pause: str = "\uf04c"
    stop: str = "\uf04d"
    start: str = "\uf048"
    back: str = "\uf053"
    on: str = "\uf054"
    plus: str = "\u002b"
    walk: str = "\uf554"
    loop: str = "\uf363"
    record: str = "\uf111"
    history: str = "\uf1da"
    save: str = "\uf56e"
    trash: str = "\uf1f8"
    search: str = "\uf002"
    gamepad: str = "\uf11b"
    keyboard: str = "\uf11c"
    help: str = "\uf059"
    error: str = "\uf06a"
    warning: str = "\uf071"
    note: str = "\uf05a"
    check: str = "\uf00c"
    close: str = "\uf00d"
    more: str = "\uf141"
    reset: str = "\uf2f9"
    wand: str = "\uf0d0"
    chip: str = "\uf2db"
    clock: str = "\uf017"
    person: str = "\uf183"
    undo: str = "\uf2ea"
    redo: str = "\uf2f9"
    lock: str = "\uf023"
    unlock: str = "\uf09c"
    folder: str = "\uf07c"
    gear: str = "\uf013"
    exchange: str = "\uf0ec"
    original: str = "\uf0e2"
    star: str = "\uf005"
    sort: str = "\uf0dc"
    text: str = "\uf249"


ICON = Icons()


@dataclass(frozen=True)
class Fonts:
    """The panels' fonts, with the icons merged in."""

    regular: Any
    bold: Any


def load_fonts() -> Fonts:
    """Load Roboto with FontAwesome from imgui-bundle; DisplayError if they are missing."""
    import imgui_bundle

    root = Path(imgui_bundle.__file__).parent / "assets" / "fonts"
    icons = root / "Font_Awesome_6_Free-Solid-900.otf"
    atlas = imgui.get_io().fonts

    def load(name: str) -> Any:
        for path in (root / name, icons):
            if not path.is_file():
                raise DisplayError(f"{path}: this font is missing.", "Install imgui-bundle again.")
        font = atlas.add_font_from_file_ttf(str(root / name), FONT_SIZE_PX)
        merge = imgui.ImFontConfig()
        merge.merge_mode = True
        merge.glyph_min_advance_x = FONT_SIZE_PX * 1.25  # icons of equal width line up
        merge.glyph_offset = imgui.ImVec2(0.0, 1.0)
        atlas.add_font_from_file_ttf(str(icons), FONT_SIZE_PX * 0.86, merge)
        return font

    regular = load("Roboto/Roboto-Regular.ttf")  # the first one is the default
    return Fonts(regular, load("Roboto/Roboto-Bold.ttf"))


_LENGTHS: dict[str, float | tuple[float, float]] = {  # pixels at scale 1
    "window_padding": (14, 12), "frame_padding": (9, 6), "item_spacing": (8, 7), "item_inner_spacing": (7, 5),
    "cell_padding": (6, 4), "indent_spacing": 18, "scrollbar_size": 10, "scrollbar_padding": 2, "grab_min_size": 12,
    "window_rounding": 10, "child_rounding": 6, "frame_rounding": 6, "popup_rounding": 8, "grab_rounding": 6,
    "scrollbar_rounding": 6, "tab_rounding": 6, "window_min_size": (16, 16), "display_safe_area_padding": (3, 3),
    "tab_bar_overline_size": 2, "separator_size": 1,
}  # fmt: skip


def apply_style(scale: float) -> None:
    """Set spacing, rounding and colours; call again when the scale changes."""
    # not Style.scale_all_sizes: it multiplies the present values, so a second change of scale would accumulate
    style = imgui.get_style()
    imgui.style_colors_dark()
    for name, length in _LENGTHS.items():
        if isinstance(length, tuple):
            setattr(style, name, imgui.ImVec2(length[0] * scale, length[1] * scale))
        else:
            setattr(style, name, length * scale)
    style.window_border_size = style.popup_border_size = style.tab_bar_border_size = 1.0
    style.frame_border_size = 0.0
    style.disabled_alpha = 0.45
    style.font_size_base = FONT_SIZE_PX
    style.font_scale_dpi = scale
    _set_colors(style)


def _set_colors(style: Any) -> None:
    c = imgui.Col_
    table = {
        c.text: TEXT, c.text_disabled: MUTED, c.window_bg: PANEL, c.child_bg: CLEAR,
        c.popup_bg: POPUP, c.border: LINE, c.frame_bg: FIELD, c.frame_bg_hovered: FIELD_HOVER,
        c.frame_bg_active: FIELD_ACTIVE, c.title_bg: PANEL, c.title_bg_active: PANEL,
        c.scrollbar_bg: CLEAR, c.scrollbar_grab: _hex("FFFFFF", 0.14),
        c.scrollbar_grab_hovered: _hex("FFFFFF", 0.24), c.scrollbar_grab_active: _hex("FFFFFF", 0.32),
        c.check_mark: ACCENT, c.slider_grab: ACCENT, c.slider_grab_active: ACCENT_HOVER,
        c.button: FIELD, c.button_hovered: FIELD_ACTIVE, c.button_active: _hex("414D5B"),
        c.header: ACCENT_DIM, c.header_hovered: _hex("FFFFFF", 0.08), c.header_active: _hex("FFFFFF", 0.12),
        c.separator: LINE, c.tab: CLEAR, c.tab_hovered: FIELD_HOVER, c.tab_selected: FIELD,
        c.tab_selected_overline: ACCENT, c.text_selected_bg: _hex("4FC3A1", 0.35),
        c.input_text_cursor: ACCENT, c.nav_cursor: ACCENT, c.modal_window_dim_bg: _hex("000000", 0.55),
        c.drag_drop_target: ACCENT, c.plot_histogram: _hex("2F6B5B"),
    }  # fmt: skip
    for role, color in table.items():
        style.set_color_(role, imgui.ImVec4(*color))
