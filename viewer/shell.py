"""The panels of one frame in their places, with the status line and the help."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from runtime.safe_read import printable
from viewer.edit.resimulation import Resimulation
from viewer.gl_bindings import imgui
from viewer.gui import help, status, theme, widgets
from viewer.gui.defects import Defects, safe_panel
from viewer.gui.focus import OVER, Focus, Use, is_drawn
from viewer.gui.layout import Layout, Rect, arrange, framing
from viewer.gui.panels import FIXED, Panel, PanelPlace, draw_centred, draw_tabs, draw_titled, draw_window
from viewer.gui.system_fonts import SystemFonts
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px
from viewer.input.bindings import Action
from viewer.input.devices import KEYBOARD
from viewer.jobs import Jobs
from viewer.messages import Level, Messages
from viewer.scene.scene import Scene
from viewer.settings import Settings

_STATUS = FIXED | imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.no_scroll_with_mouse
_KEYS = "keys"  # topic of messages
_COLUMNS = (PanelPlace.LEFT, PanelPlace.RIGHT_TOP, PanelPlace.RIGHT_BOTTOM)


@dataclass
class ShellState:
    stats: status.Stats = field(default_factory=status.Stats)
    device: str = KEYBOARD  # or the name of the gamepad
    crouching: bool = False  # the toggle is on
    help_open: bool = False
    panels_open: bool = True
    clocked: bool = True  # shows wall-clock timings, which mean nothing without a display
    bare: bool = False  # no status line either: frames saved without panels


@dataclass
class Shell:
    state: ShellState
    settings: Settings
    messages: Messages
    jobs: Jobs
    scene: Scene
    editing: Resimulation
    panels: Sequence[Panel]
    texts: Callable[[], Iterable[str]]  # typed texts, which need fonts
    fonts: Fonts
    defects: Defects
    focus: Focus = field(default_factory=Focus)
    _system_fonts: SystemFonts = field(init=False)
    _scale: float = 0.0
    _layout: Layout = field(default_factory=lambda: arrange(64.0, 64.0, 1.0))
    _windows: list[str] = field(default_factory=list)  # of panels, in keyboard order

    def __post_init__(self) -> None:
        self._system_fonts = SystemFonts(self.fonts.regular)
        state, takes = self.state, self.editing.takes
        text = f"{ICON.person} Crouching (C stands up)"
        self.panels = [
            *self.panels,
            Panel(
                "Crouching", PanelPlace.SIGN, lambda view: widgets.sign(view, text, theme.TEXT),
                shown=lambda: state.crouching and not takes.recording,
            ),
            Panel(
                "Controls", PanelPlace.WINDOW, lambda _: help.draw(self.fonts, self.settings), ICON.help,
                lambda: state.help_open, help.WIDTH_PX, close=partial(self._toggle, "help_open"), modal=True, light=True,
            ),
        ]  # fmt: skip
        self.panels = [safe_panel(panel, self.defects) for panel in self.panels]

    @property
    def actions(self) -> dict[Action, Callable[[], None]]:
        return {
            Action.HELP: partial(self._toggle, "help_open"),
            Action.PANELS: partial(self._toggle, "panels_open"),
            Action.PROMPT: self.focus_prompt,
            Action.NEXT_PANEL: self._next_panel,
        }

    def _toggle(self, name: str) -> None:
        setattr(self.state, name, not getattr(self.state, name))

    def focus_prompt(self) -> None:
        self.state.panels_open = True
        for panel in self.panels:
            if panel.begin_typing is not None and panel.shown():
                panel.begin_typing()

    @property
    def modal(self) -> bool:
        """Whether a modal window is open, which blocks keys for everything behind it."""
        return any(panel.modal and panel.shown() for panel in self.panels)

    def _next_panel(self) -> None:
        """Focus the next panel, and after the last one the view; cycles through the windows above everything, if any."""
        drawn = [name for name in self.focus.windows or self._windows if is_drawn(name)]
        after = drawn.index(self.focus.holder) + 1 if self.focus.holder in drawn else 0
        first = drawn[0] if self.focus.windows else ""
        self.focus.give_to(drawn[after] if after < len(drawn) else first)

    def _cancel(self) -> None:
        """Close the front window, else unfocus a panel, else close what is open in the view."""
        if self.focus.windows:
            front = self.focus.windows[-1].removesuffix(OVER)
            self._close_first(panel for panel in self.panels if panel.name == front)
        elif self.focus.holder:
            self.focus.give_to("")
        else:
            self._close_first(p for p in reversed(self.panels) if p.place is not PanelPlace.WINDOW)

    def _close_first(self, panels: Iterable[Panel]) -> None:
        """Close the first of some panels that is shown and can be closed."""
        for panel in panels:
            if panel.close is not None and panel.shown():
                panel.close()
                return

    def refuse_key(self) -> None:
        """Show which window has the keyboard focus."""
        who = self.focus.holder.removesuffix(OVER) if self.focus.holder in self.focus.windows else "A panel"
        self.messages.post(
            f"{who} has keyboard focus: Esc or a click on the view returns it.", Level.NOTE, _KEYS
        )

    def arrange(self, scale: float) -> None:
        """Place the panels for a UI scale; call before `draw`, within an ImGui frame."""
        if scale != self._scale:
            theme.apply_style(scale)
            self._scale = scale
        imgui.get_style().font_scale_main = self.settings.text_size
        size, playing = imgui.get_io().display_size, self.editing.playback is not None
        self._layout = arrange(size.x, size.y, scale, self.state.panels_open, playing)

    def draw_at(self, scale: float) -> None:
        """Place and draw every panel, for a pass that only handles input."""
        self.arrange(scale)
        self.draw()

    @property
    def framing(self) -> tuple[float, float, float]:
        """Return the area of the view free of panels, see `layout.framing`."""
        over = self._shown(PanelPlace.VIEW)
        covered = max((panel.covers(self._layout.view) for panel in over), default=0.0)
        return framing(self._layout, covered if self.state.panels_open else 0.0)

    @property
    def aspect(self) -> float:
        """Width of the free view divided by the window's height."""
        size = imgui.get_io().display_size
        return self._layout.view.width / max(size.y, 1.0)

    def draw(self) -> None:
        """Draw every panel, and handle Esc if ImGui has not."""
        if imgui.is_key_pressed(imgui.Key.escape, False):
            if self.focus.use is not Use.OPEN:
                self._cancel()
            # otherwise a mouse over a menu's entry would reopen it
            imgui.get_current_context().nav_highlight_item_under_nav = True
        layout, view = self._layout, self._layout.view
        self._cover_scripts()
        self._windows = []
        for panel in self.panels:
            if panel.keys is not None and not self.modal:
                panel.keys()
        self._draw_over(PanelPlace.SIGN, view)
        self._draw_columns(layout)
        height = self._draw_below(layout)
        if not self.state.bare:
            self._status(layout)
        if self.state.panels_open:
            self._windows += [panel.name for panel in self._shown(PanelPlace.VIEW)]
            self._draw_over(PanelPlace.VIEW, replace(view, height=height))
        self._draw_over(PanelPlace.WINDOW, view)
        self.focus.update()
        if self.focus.in_view:
            self.messages.settle(_KEYS)

    def _draw_below(self, layout: Layout) -> float:
        """Draw the panel under the view; return the remaining height of the view."""
        if layout.transport is None:
            return layout.view.height
        for panel in self._shown(PanelPlace.BELOW):
            self._window(panel.name, layout.transport, partial(panel.draw, layout.transport))
        return max(layout.transport.y - layout.view.y, 0.0)

    def _shown(self, *places: PanelPlace) -> list[Panel]:
        return [p for place in places for p in self.panels if p.place is place and p.shown()]

    def _draw_over(self, place: PanelPlace, rect: Rect) -> None:
        """Draw the panels that lie over the view or over everything."""
        for panel in self.panels:
            if panel.place is place and panel.shown():
                draw_centred(panel, rect, self.fonts) if panel.width else panel.draw(rect)

    def _draw_columns(self, layout: Layout) -> None:
        """Draw the side panels: in windows of their own, or as tabs if several share a place."""
        shown, right = self._shown(*_COLUMNS), self._shown(*_COLUMNS[1:])
        rects = dict(zip(_COLUMNS, (layout.prompt, layout.scene, layout.clips), strict=True))
        for panel in shown:
            rect = rects[panel.place]
            if rect is not None:
                self._window(panel.name, rect, partial(draw_titled, panel, rect, self.fonts))
        for name, tabs, rect in (("Right", right, layout.right_tabs), ("Tabs", shown, layout.tabs)):
            if rect is not None:
                self._window(name, rect, partial(draw_tabs, tabs, rect))

    def _window(self, name: str, rect: Rect, contents: Callable[[], None]) -> None:
        self._windows.append(name)
        draw_window(name, rect, contents)

    def _cover_scripts(self) -> None:
        """Load fonts for the texts, or report characters without a font."""
        missing = self._system_fonts.cover([*self.texts(), *(said.text for said in self.messages.recent)])
        if missing:
            codes = ", ".join(f"U+{ord(c):04X}" for c in missing[:4])
            self.messages.warn(
                f"No font of this system has {codes}: they show as “?”. Install one that does, such as Noto Sans CJK."
            )

    def _status(self, layout: Layout) -> None:
        imgui.push_style_var(imgui.StyleVar_.window_rounding, 0.0)
        imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(px(14), px(6)))
        draw_window("Status", layout.status, self._status_line, _STATUS)

    def _status_line(self) -> None:
        doing, cancel = self.jobs.shown()
        if status.draw(self.messages, self._facts(), printable(doing), cancel is not None) and cancel:
            cancel()
        imgui.pop_style_var(2)

    def _facts(self) -> list[tuple[str, str]]:
        """Return facts about model, speed and device with explanations, the most important last."""
        stats, scene, device = self.state.stats, self.scene, self.state.device
        icon = ICON.keyboard if device == KEYBOARD else ICON.gamepad
        model = f"{ICON.chip} {scene.model_name or 'no model'}  {scene.provider}".rstrip()
        driven_by = (f"{icon} {device[:24]}", "The device that drives the character")
        keyed = scene.simulation.keyed
        if keyed:
            hint = "Legs and hips are keyframed over this obstacle"
            driven_by = f"{ICON.walk} keyed: {keyed}", hint
        if not self.state.clocked:
            return [(model, "The motion model and its execution provider"), driven_by]
        memory = [(f"{stats.memory_mb:.0f} MB", "Memory of the program, with all takes")]
        return [
            *(memory if stats.memory_mb else ()),
            (model, "The motion model and its execution provider"),
            (f"model {scene.simulation.model_ms:.1f} ms", "Time of one step of the model, with foot lock"),
            (f"frame {stats.frame_ms:.0f} ms", "Time to prepare one displayed frame"),
            (f"{stats.fps:.0f} fps", "Displayed frames per second"),
            (
                f"sim {stats.steps_per_s:.0f} Hz",
                "Simulation steps per second; 60 is real time",
            ),
            driven_by,
        ]
