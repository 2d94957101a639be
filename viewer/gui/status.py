"""The status line: message on the left, with a list of recent ones; facts about the machine on the right."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.messages import Level, Message, Messages

_LOOKS = {
    Level.NOTE: (ICON.note, theme.ACCENT),
    Level.WARNING: (ICON.warning, theme.WARNING),
    Level.ERROR: (ICON.error, theme.ERROR),
}
MIN_MESSAGE_WIDTH_PX = 260.0
SHOW = "Show in folder"
ICON_WIDTH_PX = 26.0  # left of a message
LIST, LIST_WIDTH_PX = "messages", 620.0
DRIVE_HINT = "W A S D or the left stick to move,  F1 for all controls"
FPS_HALF_LIFE_S = 0.5


@dataclass
class Stats:
    frame_ms: float = 0.0  # working time per frame
    fps: float = 0.0  # displayed frames per second
    steps_per_s: float = 0.0  # simulation steps per second; 60 is real time
    memory_mb: float = 0.0  # in use by the program; 0 if unknown

    def add(self, work_s: float, interval_s: float, steps: int) -> None:
        """Add a frame to the statistics: working time and interval since the last frame (seconds), and simulation steps."""
        if interval_s <= 0.0:
            return
        fraction = 1.0 if self.fps == 0.0 else 1.0 - 0.5 ** (interval_s / FPS_HALF_LIFE_S)
        self.frame_ms += (work_s * 1e3 - self.frame_ms) * fraction
        self.fps += (1.0 / interval_s - self.fps) * fraction
        self.steps_per_s += (steps / interval_s - self.steps_per_s) * fraction


def draw(messages: Messages, facts: list[tuple[str, str]], doing: str, can_end: bool) -> bool:
    """Draw the status line: the message on the left, facts with hints on the right; return whether the job's button was pressed.

    Facts are dropped from the left if the message needs room, except the last. `doing` is the running job, with a
    button if it `can_end`.
    """
    message = messages.current
    width, gap = imgui.get_content_region_avail().x, px(18)
    text = DRIVE_HINT if message is None else message.text
    wanted = max(imgui.calc_text_size(text).x + px(ICON_WIDTH_PX) + gap, px(MIN_MESSAGE_WIDTH_PX))
    widths = [imgui.calc_text_size(text).x + gap for text, _ in facts]
    while len(widths) > 1 and sum(widths) - gap > width - wanted:
        widths.pop(0)
    begin, room, cancelled = imgui.get_cursor_pos_x(), width - sum(widths), False
    if doing:
        cancelled = _doing(doing, room / 2 if message else room, can_end)
        imgui.same_line(0, gap)
        room -= imgui.get_cursor_pos_x() - begin
    if message or not doing:
        _message(message, room, messages.show_in_folder)
    _list(messages)
    imgui.same_line(width - sum(widths) + gap + imgui.get_style().window_padding.x)
    for text, hint in facts[-len(widths) :]:
        widgets.muted(text)
        widgets.tooltip(hint)
        imgui.same_line(0, gap)
    return cancelled


def _doing(text: str, width: float, can_end: bool) -> bool:
    room = width - imgui.calc_text_size("Cancel").x - px(60)
    imgui.text_unformatted(f"{ICON.clock} {widgets.elided(f'{text}…', room)}")
    if not can_end:
        return False
    imgui.same_line(0, px(10))
    return imgui.small_button("Cancel##doing")


def _message(message: Message | None, width: float, show: Callable[[Path], None]) -> None:
    if message is None:
        imgui.begin_group()
        widgets.muted(widgets.elided(f"{ICON.help} {DRIVE_HINT}", width))
        imgui.end_group()
        _opens_list()
        return
    icon, color = _LOOKS[message.level]
    widgets.text(icon, color)
    imgui.same_line(0, px(5))
    width -= imgui.calc_text_size(SHOW).x + px(24) if message.path else 0.0
    shown = widgets.elided(message.text, width - px(ICON_WIDTH_PX))
    widgets.text(shown, theme.TEXT if message.level is Level.NOTE else color)
    _opens_list("" if shown == message.text else message.text)
    if message.path is not None:
        imgui.same_line(0, px(10))
        if imgui.small_button(f"{SHOW}##show in folder"):
            show(message.path)


def _opens_list(text: str = "") -> None:
    """Open the list of messages when the previous item is clicked."""
    if imgui.is_item_hovered():
        widgets.tooltip(f"{text}\nClick for recent messages".lstrip())
        if imgui.is_mouse_clicked(0):
            imgui.open_popup(LIST)


def _list(messages: Messages) -> None:
    corner = imgui.get_window_pos()
    width, space = min(px(LIST_WIDTH_PX), imgui.get_window_width() - px(20)), imgui.get_io().display_size.y
    imgui.set_next_window_pos(
        imgui.ImVec2(corner.x + px(10), corner.y - px(6)), imgui.Cond_.always, imgui.ImVec2(0, 1)
    )
    imgui.set_next_window_size_constraints(imgui.ImVec2(width, 0), imgui.ImVec2(width, 0.6 * space))
    if not imgui.begin_popup(LIST):
        return
    if not messages.recent:
        widgets.muted("No messages yet.")
    for number, message in enumerate(reversed(messages.recent)):
        imgui.push_id(number)
        _entry(message, messages.show_in_folder)
        imgui.pop_id()
    imgui.end_popup()


def _entry(message: Message, show: Callable[[Path], None]) -> None:
    icon, color = _LOOKS[message.level]
    over = message.settled or message.level is Level.NOTE
    widgets.muted(message.told_at)
    imgui.same_line(0, px(10))
    widgets.text(ICON.check if message.settled else icon, theme.MUTED if message.settled else color)
    imgui.same_line(0, px(8))
    imgui.begin_group()
    widgets.text(
        message.problem + (" It is over." if message.settled else ""),
        theme.TEXT if over else color,
        wrap=True,
    )
    if message.remedy and not message.settled:
        widgets.muted(message.remedy, wrap=True)
    if message.path is not None and imgui.small_button(f"{SHOW}##of message"):
        show(message.path)
    imgui.end_group()
