"""The bar at the top of the view: session menu and name."""

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runtime.safe_read import printable
from runtime.session.lost import MAX_RECOVERED_TAKES
from viewer.exports.exporting import Exporting
from viewer.gl_bindings import imgui
from viewer.gui import widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import FIXED, Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.panels.guide import Guide
from viewer.panels.settings_panel import SettingsWindow
from viewer.prompt.prompt_field import pressed_undo
from viewer.session.sessions import Sessions, SessionSummary
from viewer.session.summaries import describe, time_text

POPUP = "session menu"
NAME_WIDTH_PX = 130.0  # including its icon, at scale 1
MENU_WIDTH_PX = 240.0
MARGIN_PX = 10.0
MAX_PICTURE_PX = 512  # pixels per side
MAX_LISTED_LOST = 30  # takes
MIN_VIEW_WIDTH_PX = 200.0  # a narrower view has no room for the bar
# integers, because Python 3.11.2 (Debian 12) raises when combining two of these keys as enumeration members
_CTRL, _SHIFT = int(imgui.Key.mod_ctrl), int(imgui.Key.mod_shift)
_SAVE, _OPEN, _EXPORT = (_CTRL | int(key) for key in (imgui.Key.s, imgui.Key.o, imgui.Key.e))
_SAVE_AS = _SHIFT | _SAVE


@dataclass
class SessionBar:
    sessions: Sessions
    exporting: Exporting
    guide: Guide
    settings_window: SettingsWindow
    ctx: Any  # OpenGL context
    _pictures: dict[Path, Any] = field(default_factory=dict)  # textures of recent sessions

    def panel(self) -> Panel:
        """Return the bar's panel, with the Ctrl shortcuts."""
        return Panel("Session", PanelPlace.VIEW, self.draw, keys=self.keys)

    def draw(self, view: Rect) -> None:
        """Draw the bar at the top left of the view, and its menus."""
        if view.width < px(MIN_VIEW_WIDTH_PX):
            return
        imgui.set_next_window_pos(imgui.ImVec2(view.x + px(MARGIN_PX), view.y + px(MARGIN_PX)))
        imgui.push_style_var(imgui.StyleVar_.window_padding, imgui.ImVec2(px(4), px(4)))
        imgui.begin(
            "Session", None, FIXED | imgui.WindowFlags_.no_scrollbar | imgui.WindowFlags_.always_auto_resize
        )
        self._buttons()
        imgui.pop_style_var()
        self._menu()
        imgui.end()

    def keys(self) -> None:
        """Handle Ctrl+S, Ctrl+Shift+S, Ctrl+O and Ctrl+E, and undo and redo outside text fields."""
        sessions = self.sessions
        for chord, act in (
            (_SAVE_AS, sessions.ask_save), (_SAVE, sessions.save), (_OPEN, sessions.ask_open),
            (_EXPORT, self.exporting.open),
        ):  # fmt: skip
            if imgui.is_key_chord_pressed(chord):
                act()
        if not imgui.get_io().want_text_input:
            undo, redo = pressed_undo()
            if undo or redo:
                (sessions.editor.undo if undo else sessions.editor.redo)()

    def _buttons(self) -> None:
        sessions = self.sessions
        file, cut_off = sessions.editor.file, sessions.cut_off is not None
        mark = f"  {ICON.warning}" if file.problem or cut_off else ""
        label = widgets.named(f"{ICON.folder} {sessions.name}", "#session", mark, NAME_WIDTH_PX)
        hint = "Session: open, save, recent ones. Every edit is saved at once."
        if sessions.path is not None:
            hint = f"{printable(sessions.path)}\nEvery edit is saved at once."
        if widgets.button(label, 0.0, file.problem or hint):
            imgui.open_popup(POPUP)
        widgets.same_line()
        if widgets.button(f"{ICON.gear}###settings", px(30), "Settings"):
            self.settings_window.toggle()

    def _menu(self) -> None:
        corner = imgui.get_window_pos()
        imgui.set_next_window_pos(imgui.ImVec2(corner.x, corner.y + imgui.get_window_height() + px(4)))
        low, high = imgui.ImVec2(px(MENU_WIDTH_PX), 0), imgui.ImVec2(px(420), px(2000))
        imgui.set_next_window_size_constraints(low, high)
        if not imgui.begin_popup(POPUP):
            return
        sessions, editor = self.sessions, self.sessions.editor
        undo, redo = editor.undo_label, editor.redo_label
        _items(("New session", "", sessions.new), ("Open…", "Ctrl+O", sessions.ask_open))
        if imgui.is_window_appearing():
            sessions.find_lost()
        self._recent()
        self._earlier()
        self._lost()
        imgui.separator()
        _items(
            ("Save" if sessions.path is None else "Saved as you work", "Ctrl+S", sessions.save),
            ("Save as…", "Ctrl+Shift+S", sessions.ask_save),
            ("Save a copy…", "", sessions.ask_copy),
            ("Revert to when it was opened", "", sessions.revert),
        )
        imgui.separator()
        _items(
            (f"Undo {printable(undo)}###undo", "Ctrl+Z", editor.undo if undo else None),
            (f"Redo {printable(redo)}###redo", "Ctrl+Y", editor.redo if redo else None),
        )
        imgui.separator()
        _items(
            ("Export the take…", "Ctrl+E", self.exporting.open),
            ("Settings…", "", self.settings_window.toggle),
            ("First minute", "", self.guide.begin),
        )
        imgui.end_popup()

    def _recent(self) -> None:
        sessions = self.sessions
        recent = [path for path in sessions.recent if path != sessions.path]
        if not recent:
            return
        if widgets.item(widgets.named(f"Reopen {recent[0].stem}", "reopen"), printable(recent[0])):
            sessions.open(recent[0])
        if len(recent) > 1 and imgui.begin_menu("Recent"):
            for number, path in enumerate(recent):
                if widgets.item(widgets.named(path.stem, number), printable(path)):
                    sessions.open(path)
            imgui.end_menu()

    def _earlier(self) -> None:
        sessions = self.sessions
        if not sessions.earlier or not imgui.begin_menu("Earlier sessions"):
            return
        for number, left in enumerate(list(sessions.earlier)):
            imgui.push_id(number)
            self._picture(left)
            text = describe(left) + ("" if left.ended else ", cut off")
            if widgets.item(widgets.named(text, "earlier", width=400.0)):
                sessions.open(left.path)
            if imgui.begin_popup_context_item("earlier"):
                if widgets.item("Discard"):
                    sessions.discard(left)
                imgui.end_popup()
            imgui.pop_id()
        imgui.end_menu()

    def _lost(self) -> None:
        sessions, lost = self.sessions, self.sessions.lost
        more = "+" * (len(lost) == MAX_RECOVERED_TAKES)
        if not lost or not imgui.begin_menu(f"Lost takes ({len(lost)}{more})###lost"):
            return
        if len(lost) > 1 and widgets.item(f"Recover the newest {len(lost)}" if more else "Recover all"):
            sessions.recover(*lost[::-1])
        for number, take in enumerate(lost[:MAX_LISTED_LOST]):
            about = f", {widgets.clock(take.seconds)}, {time_text(take.since_s)}"
            if widgets.item(widgets.named(take.name, number, about)):
                sessions.recover(take)
        if len(lost) > MAX_LISTED_LOST:
            widgets.muted(f"and {len(lost) - MAX_LISTED_LOST}{more} older ones")
        imgui.end_menu()

    def _picture(self, left: SessionSummary) -> None:
        if left.path not in self._pictures:
            self._pictures[left.path] = _texture(self.ctx, left.picture)
        texture = self._pictures[left.path]
        if texture is not None:
            imgui.image(imgui.ImTextureRef(texture.glo), imgui.ImVec2(px(64), px(36)))
            imgui.same_line(0, px(6))


def _items(*items: tuple[str, str, Callable[[], object] | None]) -> None:
    """Draw menu entries: text, key and action; one without an action is disabled."""
    for text, key, act in items:
        if imgui.menu_item(text, key, False, act is not None)[0] and act is not None:
            act()


def _texture(ctx: Any, png: bytes) -> Any:
    """Return a texture of a small picture; None if it is invalid."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(png)) as image:
            if max(image.size) > MAX_PICTURE_PX:
                return None
            small = image.convert("RGB")
    except (OSError, ValueError, SyntaxError):
        return None
    return ctx.texture(small.size, 3, small.tobytes(), alignment=1)
