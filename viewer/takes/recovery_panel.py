"""The card above the list of takes: takes of a run that was cut off, to be recovered or discarded."""

from __future__ import annotations

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.takes.journals import Journals, describe

MAX_SHOWN = 1  # the list below needs the room


def draw(journals: Journals) -> None:
    """Cards of the takes that were cut off, the oldest first; nothing without any."""
    cut_off = list(journals.state.cut_off)
    for i, found in enumerate(cut_off[:MAX_SHOWN]):
        imgui.push_id(f"cut off {i}")
        width = imgui.get_content_region_avail().x
        with widgets.color(imgui.Col_.text, theme.WARNING):
            imgui.text_unformatted(ICON.warning)
        imgui.same_line(0, px(5))
        text = f"{found.header.name} was cut off: {describe(found)}"
        imgui.text_unformatted(widgets.elided(text, width - px(26)))
        widgets.tooltip(f"{text}\n{found.header.terrain}")
        half = (width - px(4)) / 2
        busy = journals.jobs.busy(f"recovery {found.path.name}")
        imgui.begin_disabled(busy)
        if widgets.button(
            "Reading…###recover" if busy else "Recover###recover", half, "Put it into the list", True
        ):
            journals.recover(found)
        imgui.same_line(0, px(4))
        if widgets.button("Discard", half, "Remove it for good"):
            journals.discard(found)
        imgui.end_disabled()
        imgui.pop_id()
    if len(cut_off) > MAX_SHOWN:
        widgets.muted(f"and {len(cut_off) - MAX_SHOWN} more")
    if cut_off:
        imgui.separator()
