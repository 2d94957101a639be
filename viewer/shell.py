"""All panels of one frame, each in its place, with the status line and the help."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from runtime.safe_read import printable
from viewer.desk import bar, guide, settings_panel
from viewer.desk.desk import Desk
from viewer.exports import panel as exports_panel
from viewer.gl_bindings import imgui
from viewer.gui import help, lists, status, theme, widgets
from viewer.gui.layout import Layout, Rect, arrange, framing
from viewer.gui.system_fonts import SystemFonts
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px
from viewer.input.bindings import Action
from viewer.input.devices import KEYBOARD
from viewer.messages import Messages
from viewer.prompt import field_panel
from viewer.prompt import panel as prompt_panel
from viewer.prompt.room import PromptRoom
from viewer.prompt.style_edit import Side
from viewer.stage import joint_panel
from viewer.stage import panel as scene_panel
from viewer.stage.stage import Stage
from viewer.takes import panel as clips_panel
from viewer.takes import transport, words_panel
from viewer.takes.editing import TakeEditing
from viewer.takes.takes import Takes
from viewer.wall import labels
from viewer.wall import panel as wall_panel
from viewer.wall.wall import Wall

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
class _Contents:
    """One panel: its name, its icon, what draws it, and buttons beside its title."""

    name: str
    icon: str
    draw: Callable[[], None]
    tools: Callable[[], None] | None = None
    tools_width: float = 0.0  # pixels at scale 1


@dataclass
class ShellState:
    """What lies around the panels."""

    stats: status.Stats = field(default_factory=status.Stats)
    device: str = KEYBOARD  # or the name of the gamepad
    crouching: bool = False  # the toggle is on
    help_open: bool = False
    panels_open: bool = True
    clocked: bool = True  # times by the clock are shown; they say nothing of a run without a display
    bare: bool = False  # no status line either: frames that are saved without panels


@dataclass
class Shell:
    """Fonts, style and the windows around the panels."""

    state: ShellState
    messages: Messages
    prompt: PromptRoom
    stage: Stage
    takes: Takes
    editing: TakeEditing
    desk: Desk
    wall: Wall
    open_files: Callable[[list[Path]], None]
    fonts: Fonts = field(default_factory=theme.load_fonts)
    _system_fonts: SystemFonts = field(init=False)
    _scale: float = 0.0
    _scene_height: float = 0.0
    _removals: int = 0  # takes that can be brought back
    _top_then: object = None  # the prompt's last change when the last of them was removed
    _layout: Layout = field(default_factory=lambda: arrange(64.0, 64.0, 1.0))

    def __post_init__(self) -> None:
        self._system_fonts = SystemFonts(self.fonts.regular)

    @property
    def actions(self) -> dict[Action, Callable[[], None]]:
        """What keys and buttons do here."""
        return {
            Action.HELP: self._toggle_help,
            Action.PANELS: self._toggle_panels,
            Action.PROMPT: self.focus_prompt,
            Action.CANCEL: self._cancel,
        }

    def _toggle_help(self) -> None:
        self.state.help_open = not self.state.help_open

    def _toggle_panels(self) -> None:
        self.state.panels_open = not self.state.panels_open

    def focus_prompt(self) -> None:
        """Begin to type a prompt."""
        self.state.panels_open = True
        if self.takes.state.playback is not None:
            self.takes.state.timeline.focus_requested = True
        elif self.wall.state.open:
            self.wall.state.focus_requested = True
        else:
            self.prompt.state.boxes[Side.A].focus_requested = True

    def _cancel(self) -> None:
        """Leave the innermost thing that is open."""
        if lists.close_innermost():
            return
        if self.state.help_open:
            self.state.help_open = False
        elif self.wall.state.open:
            self.wall.close()
        elif not self.desk.cancel():
            self.takes.close_playback()

    def arrange(self, scale: float) -> None:
        """Fit the panels to the window for a UI scale; call before `draw`, within an ImGui frame."""
        if scale != self._scale:
            theme.apply_style(scale)
            self._scale, self._scene_height = scale, 0.0
        imgui.get_style().font_scale_main = self.desk.settings.text_size
        size, playing = imgui.get_io().display_size, self.takes.state.playback is not None
        parts = self.takes.state.timeline.part_tracks
        panels = self.state.panels_open
        self._layout = arrange(size.x, size.y, scale, panels, playing, self._scene_height, parts)

    def draw_at(self, scale: float) -> None:
        """Fit and draw every panel, for a pass that only takes input."""
        self.arrange(scale)
        self.draw()

    @property
    def framing(self) -> tuple[float, float, float]:
        """Where the panels leave the view free, see `layout.framing`."""
        return framing(self._layout)

    @property
    def aspect(self) -> float:
        """Width of the free view over the height of the window."""
        size = imgui.get_io().display_size
        return self._layout.view.width / max(size.y, 1.0)

    def draw(self) -> None:
        """Draw every panel."""
        layout = self._layout
        self._cover_scripts()
        if self.wall.state.open:
            clicked = labels.draw(self.wall.state, self.wall.poses, self.stage.camera.current, layout.view)
            if clicked >= 0:
                self.wall.keep(clicked)
        self._undo_keys()
        one = self._words()
        two = _Contents("Scene", ICON.scene, self._draw_scene)
        three = _Contents("Clips", ICON.clips, lambda: clips_panel.draw(self.takes, self.desk.exporting.open))
        for panel, rect in ((one, layout.prompt), (two, layout.scene), (three, layout.clips)):
            _window(panel.name, rect, partial(self._titled, panel))
        _window("Right", layout.right_tabs, lambda: _tabs((two, three)))
        _window("Tabs", layout.tabs, lambda: _tabs((one, two, three)))
        _window("Transport", layout.transport, lambda: transport.draw(self.editing))
        if not self.state.bare:
            self._status(layout)
        if self.state.panels_open:
            bar.draw(self.desk, layout.view)
            if not self.wall.state.open:  # the card would cover a character
                guide.draw(self.desk.guide, _above(layout.view, layout.transport))
        settings_panel.draw(self.desk, self.fonts)
        exports_panel.draw(self.desk.exporting, self.fonts)
        joint_panel.draw(self.stage.joints, self.fonts)
        self.desk.dialogs.draw()
        self._badge(layout.view)
        if self.state.help_open and help.draw(self.fonts):
            self.state.help_open = False

    def _cover_scripts(self) -> None:
        """Have a font for what is typed and said, or say that there is none."""
        prompt, said = self.prompt.state, self.messages.current
        texts = [*(box.text for box in prompt.boxes), *prompt.parts.values(), said.text if said else ""]
        missing = self._system_fonts.cover(texts)
        if missing:
            codes = ", ".join(f"U+{ord(c):04X}" for c in missing[:4])
            self.messages.warn(
                f"No font of this system has {codes}: they show as “?”. Install one that does, such as Noto Sans CJK."
            )

    def _words(self) -> _Contents:
        """The live prompt, or that of the take that plays."""
        if self.takes.state.playback is not None:
            return _Contents("Prompt", ICON.prompt, lambda: words_panel.draw(self.editing))
        if self.wall.state.open:
            return _Contents("Compare", ICON.exchange, lambda: wall_panel.draw(self.wall))
        one = _Contents("Prompt", ICON.prompt, lambda: prompt_panel.draw(self.prompt))
        one.tools, one.tools_width = lambda: prompt_panel.tools(self.prompt), prompt_panel.TOOLS_WIDTH
        return one

    def _draw_scene(self) -> None:
        scene_panel.draw(self.stage, self.open_files, lambda: self.desk.ask_file(self.open_files))
        # the contents end one spacing above the cursor; the next frame fits the window to them
        spacing, padding = imgui.get_style().item_spacing.y, imgui.get_style().window_padding.y
        self._scene_height = imgui.get_cursor_pos_y() + imgui.get_scroll_y() - spacing + padding

    def _undo_keys(self) -> None:
        """Ctrl+Z and Ctrl+Y wherever nothing is typed; a text field sees to its own."""
        bar.keys(self.desk)
        removed, top = self.takes.state.removed, self.prompt.prompting.history.top
        if len(removed) > self._removals:
            self._top_then = top
        self._removals = len(removed)
        if imgui.get_io().want_text_input:
            return
        undo, redo = field_panel.pressed_undo()
        of = self.editing if self.takes.state.playback is not None else self.prompt.prompting
        if undo and removed and of is not self.editing and top is self._top_then:
            self.takes.restore()  # nothing was done since a take was removed
        elif undo:
            of.undo()
        elif redo:
            of.redo()

    def _titled(self, panel: _Contents) -> None:
        top, start = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
        widgets.heading(self.fonts, panel.icon, panel.name)
        _tools(panel, imgui.ImVec2(top.x, top.y - px(3)), start)
        panel.draw()

    def _status(self, layout: Layout) -> None:
        imgui.push_style_var(imgui.StyleVar_.window_rounding, 0.0)
        imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(px(14), px(6)))
        _window("Status", layout.status, self._status_line, _STATUS)

    def _status_line(self) -> None:
        if status.draw(self.messages.current, self._facts(), printable(self.stage.jobs.reading())):
            self.stage.jobs.cancel()
        imgui.pop_style_var(2)

    def _facts(self) -> list[tuple[str, str]]:
        """What is known about model, speed and device with its explanation, the most important last."""
        stats, stage, device = self.state.stats, self.stage.state, self.state.device
        icon = ICON.keyboard if device == KEYBOARD else ICON.gamepad
        model = f"{ICON.chip} {stage.model_name or 'no model'}  {stage.provider}".rstrip()
        driven_by = (f"{icon} {device[:24]}", "The device that drives the character")
        if not self.state.clocked:
            return [(model, "The motion model and what runs it"), driven_by]
        return [
            (model, "The motion model and what runs it"),
            (f"model {stage.simulation.model_ms:.1f} ms", "Time of one step of the model, with foot lock"),
            (f"frame {stats.frame_ms:.0f} ms", "Work of one displayed frame"),
            (f"{stats.fps:.0f} fps", "Frames shown a second, by the clock"),
            (
                f"sim {stats.steps_per_s:.0f} Hz",
                "Steps of the simulation a second, by the clock; 60 is real time",
            ),
            driven_by,
        ]

    def _badge(self, view: Rect) -> None:
        """A sign over the view while something is recorded, or the crouch toggle is on."""
        text, tint = f"{ICON.record} REC {widgets.clock(self.takes.state.recorded_s)}", theme.RECORD
        if not self.takes.state.recording:
            text, tint = f"{ICON.person} Crouching (C stands up)", theme.TEXT
            if not self.state.crouching:
                return
        drawing = imgui.get_foreground_draw_list()
        size, pad = imgui.calc_text_size(text), px(10)
        x, y = view.x + (view.width - size.x) / 2, view.y + px(16)
        low, high = imgui.ImVec2(x - pad, y - pad / 2), imgui.ImVec2(x + size.x + pad, y + size.y + pad / 2)
        drawing.add_rect_filled(low, high, widgets.packed(theme.PANEL), px(14))
        drawing.add_text(imgui.ImVec2(x, y), widgets.packed(tint), text)


def _above(view: Rect, bar: Rect | None) -> Rect:
    """What a bar leaves of the view over it."""
    return view if bar is None else Rect(view.x, view.y, view.width, max(bar.y - view.y, 0.0))


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


def _tabs(panels: Sequence[_Contents]) -> None:
    """Several panels in one place."""
    top, width = imgui.get_cursor_pos(), imgui.get_content_region_avail().x
    if not imgui.begin_tab_bar("panels"):
        return
    for panel in panels:
        if widgets.tab(panel.name):
            imgui.dummy(imgui.ImVec2(0, px(2)))
            _tools(panel, top, width)
            panel.draw()
            imgui.end_tab_item()
    imgui.end_tab_bar()


def _tools(panel: _Contents, top: imgui.ImVec2, width: float) -> None:
    """A panel's own buttons at the right end of its title or tabs."""
    if panel.tools is None or width < px(panel.tools_width):
        return
    after = imgui.get_cursor_pos()
    imgui.set_cursor_pos(imgui.ImVec2(top.x + width - px(panel.tools_width), top.y))
    panel.tools()
    imgui.set_cursor_pos(after)
