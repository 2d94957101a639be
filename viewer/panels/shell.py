"""All panels of one frame, each in its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from viewer.actions import Actions
from viewer.gl_bindings import imgui
from viewer.panels import clips, help, prompt, scene, status, theme, transport, widgets
from viewer.panels.layout import Layout, Rect, arrange
from viewer.panels.theme import ICON, Fonts
from viewer.panels.widgets import px
from viewer.state import AppState

_FIXED = (
    imgui.WindowFlags_.no_title_bar
    | imgui.WindowFlags_.no_resize
    | imgui.WindowFlags_.no_move
    | imgui.WindowFlags_.no_collapse
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_bring_to_front_on_focus
)
_STATUS = _FIXED | imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse


@dataclass
class Shell:
    """Fonts, style and the windows around the panels."""

    state: AppState
    actions: Actions
    fonts: Fonts = field(init=False)
    _scale: float = 0.0
    _scene_height: float = 0.0

    def __post_init__(self) -> None:
        self.fonts = theme.load_fonts()

    def draw(self, scale: float) -> None:
        """Draw every panel for a UI scale."""
        if scale != self._scale:
            theme.apply_style(scale)
            self._scale, self._scene_height = scale, 0.0
        state, actions, fonts = self.state, self.actions, self.fonts
        size = imgui.get_io().display_size
        playing = state.clips.playback is not None
        layout = arrange(size.x, size.y, scale, state.panels_open, playing, self._scene_height)

        def draw_prompt() -> None:
            prompt.draw(state, actions.prompting)

        def draw_scene() -> None:
            scene.draw(state, actions)
            # the contents end one spacing above the cursor; the next frame fits the window to them
            spacing, padding = imgui.get_style().item_spacing.y, imgui.get_style().window_padding.y
            self._scene_height = imgui.get_cursor_pos_y() + imgui.get_scroll_y() - spacing + padding

        def draw_clips() -> None:
            clips.draw(state, actions.takes)

        self._panel("Prompt", ICON.prompt, layout.prompt, draw_prompt)
        self._panel("Scene", ICON.scene, layout.scene, draw_scene)
        self._panel("Clips", ICON.clips, layout.clips, draw_clips)
        right = (("Scene", draw_scene), ("Clips", draw_clips))
        _window("Right", layout.right_tabs, lambda: _tabs(right))
        _window("Tabs", layout.tabs, lambda: _tabs((("Prompt", draw_prompt), *right)))
        _window("Transport", layout.transport, lambda: transport.draw(state, actions.takes, fonts))
        self._status(layout)
        _badge(state, layout)
        if state.help_open:
            help.draw(state, fonts)

    def _panel(self, name: str, icon: str, rect: Rect | None, contents: Callable[[], None]) -> None:
        def titled() -> None:
            widgets.heading(self.fonts, icon, name)
            contents()

        _window(name, rect, titled)

    def _status(self, layout: Layout) -> None:
        imgui.push_style_var(imgui.StyleVar_.window_rounding, 0.0)
        imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(px(14), px(6)))
        _window("Status", layout.status, lambda: status.draw(self.state, self.fonts), _STATUS)
        imgui.pop_style_var(2)


def _window(name: str, rect: Rect | None, contents: Callable[[], None], flags: int = _FIXED) -> None:
    if rect is None or rect.width < 1 or rect.height < 1:
        return
    imgui.set_next_window_pos(imgui.ImVec2(rect.x, rect.y))
    imgui.set_next_window_size(imgui.ImVec2(rect.width, rect.height))
    imgui.begin(name, None, flags)
    try:
        contents()
    finally:
        imgui.end()


def _tabs(panels: Sequence[tuple[str, Callable[[], None]]]) -> None:
    """Several panels in one place."""
    if not imgui.begin_tab_bar("panels"):
        return
    for name, contents in panels:
        if imgui.begin_tab_item(name)[0]:
            imgui.dummy(imgui.ImVec2(0, px(2)))
            contents()
            imgui.end_tab_item()
    imgui.end_tab_bar()


def _badge(state: AppState, layout: Layout) -> None:
    """A sign over the view while something is recorded, or the crouch toggle is on."""
    text, tint = f"{ICON.record} REC {widgets.clock(state.clips.recorded_s)}", theme.RECORD
    if not state.clips.recording:
        text, tint = f"{ICON.person} Crouching (C stands up)", theme.TEXT
        if not state.crouching:
            return
    drawing, view = imgui.get_foreground_draw_list(), layout.view
    size, pad = imgui.calc_text_size(text), px(10)
    x, y = view.x + (view.width - size.x) / 2, view.y + px(16)
    low, high = imgui.ImVec2(x - pad, y - pad / 2), imgui.ImVec2(x + size.x + pad, y + size.y + pad / 2)
    drawing.add_rect_filled(low, high, imgui.get_color_u32(imgui.ImVec4(*theme.PANEL)), px(14))
    drawing.add_text(imgui.ImVec2(x, y), imgui.get_color_u32(imgui.ImVec4(*tint)), text)
