"""The card above the list of takes: a session or takes that were cut off, to be taken up or discarded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.jobs import Slot
from viewer.takes.journals import Journals, describe

MAX_SHOWN = 1  # the list below needs the room


@dataclass(frozen=True)
class CutOffSession:
    """A session that was killed, with all of its takes."""

    text: str
    busy: bool  # it is being read
    reopen: Callable[[], None]
    discard: Callable[[], None]


def draw(journals: Journals, session: CutOffSession | None) -> None:
    """One offer for a session that was cut off, else one for each take, the oldest first; nothing without any."""
    cut_off = [] if session is not None else list(journals.state.cut_off)
    if session is not None:
        hint = "Put it on the desk, with what was being recorded"
        pressed = _offer(session.text, session.text, "Reopen", hint, session.busy)
        if pressed:
            (session.reopen if pressed == "take" else session.discard)()
    for i, found in enumerate(cut_off[:MAX_SHOWN]):
        imgui.push_id(f"cut off {i}")
        text = f"{found.header.name} was cut off: {describe(found)}"
        busy = journals.jobs.busy(Slot("recovery", found.path))
        pressed = _offer(text, f"{text}\n{found.header.terrain}", "Recover", "Put it into the list", busy)
        if pressed:
            (journals.recover if pressed == "take" else journals.discard)(found)
        imgui.pop_id()
    if len(cut_off) > MAX_SHOWN:
        widgets.muted(f"and {len(cut_off) - MAX_SHOWN} more")
    if cut_off or session is not None:
        imgui.separator()


def _offer(text: str, whole: str, take: str, hint: str, busy: bool) -> str:
    """What was cut off, and two buttons; "take", "discard" or "" for the one that was pressed."""
    width, pressed = imgui.get_content_region_avail().x, ""
    with widgets.color(imgui.Col_.text, theme.WARNING):
        imgui.text_unformatted(ICON.warning)
    imgui.same_line(0, px(5))
    imgui.text_unformatted(widgets.elided(text, width - px(26)))
    widgets.tooltip(whole)
    half = (width - px(4)) / 2
    imgui.begin_disabled(busy)
    if widgets.button(f"Reading…###{take}" if busy else f"{take}###{take}", half, hint, True):
        pressed = "take"
    imgui.same_line(0, px(4))
    if widgets.button("Discard", half, "Remove it for good"):
        pressed = "discard"
    imgui.end_disabled()
    return pressed
