"""The wall's panel, in the place of the prompt: who is compared, and the prompt and the seed of each."""

from __future__ import annotations

from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.wall.state import FEWEST, MOST, Candidate
from viewer.wall.wall import Wall

SEED_WIDTH = 112.0  # pixels at scale 1


def panel(wall: Wall) -> Panel:
    """The panel, in the place of the prompt while the wall is open."""

    def close() -> bool:
        was_open = wall.state.open
        wall.close()
        return was_open

    return Panel(
        "Compare", PanelPlace.LEFT, lambda _: draw(wall), ICON.exchange, shown=lambda: wall.state.open,
        actions=wall.actions, begin_typing=lambda: _begin_typing(wall), close=close,
    )  # fmt: skip


def _begin_typing(wall: Wall) -> None:
    wall.state.focus_requested = True


def draw(wall: Wall) -> None:
    """Contents of the panel."""
    _lineups(wall)
    kept = removed = -1
    height = -2 * imgui.get_frame_height_with_spacing()
    if imgui.begin_child("candidates", imgui.ImVec2(0, min(height, -1.0))):
        for i, candidate in enumerate(tuple(wall.state.candidates)):
            imgui.push_id(str(candidate.number))
            keep, remove = _row(wall, i, candidate)
            kept, removed = (i if keep else kept), (i if remove else removed)
            imgui.pop_id()
    imgui.end_child()
    wall.state.focus_requested = False
    _buttons(wall)
    if kept >= 0:
        wall.keep(kept)
    elif removed >= 0:
        wall.remove(removed)


def _lineups(wall: Wall) -> None:
    """What to compare."""
    widgets.muted("One stick drives all. Click one to keep it.", wrap=True)
    third = (imgui.get_content_region_avail().x - 2 * px(4)) / 3
    if widgets.button("Seeds", third, "The prompt that holds, with a seed for each"):
        wall.variants()
    imgui.same_line(0, px(4))
    imgui.begin_disabled(wall.prompting.state.edit.b is None)
    if widgets.button("Blend", third, "From prompt A to prompt B in equal steps"):
        wall.blends()
    imgui.end_disabled()
    imgui.same_line(0, px(4))
    imgui.begin_disabled(len(wall.settings.prompt_history) < FEWEST)
    if widgets.button("Prompts", third, "The prompt that holds and the last ones before it"):
        wall.last_prompts()
    imgui.end_disabled()


def _row(wall: Wall, index: int, candidate: Candidate) -> tuple[bool, bool]:
    """One character; whether it is to be kept, and to be removed."""
    lit = index == wall.state.hovered
    imgui.align_text_to_frame_padding()
    widgets.label(f"{index + 1}", theme.ACCENT if lit else theme.MUTED)
    imgui.same_line(px(22), 0)
    if wall.state.focus_requested and index == 0:
        imgui.set_keyboard_focus_here()
    widgets.full_width()
    entered, candidate.text = imgui.input_text_with_hint(
        "##wall prompt", "A prompt, then Enter", candidate.text, imgui.InputTextFlags_.enter_returns_true
    )
    if entered and candidate.text.strip():
        wall.ask(candidate, candidate.text)
    imgui.dummy(imgui.ImVec2(0, 0))
    imgui.same_line(px(22), 0)
    imgui.set_next_item_width(px(SEED_WIDTH))
    changed, seed = imgui.input_int("##seed", candidate.seed)
    widgets.tooltip("The seed: another one moves otherwise to the same words")
    if changed and seed >= 0:
        wall.reseed(candidate, seed)
    imgui.same_line(0, px(4))
    rest = imgui.get_content_region_avail().x - imgui.get_frame_height() - px(4)
    keep = widgets.button(
        f"{ICON.check} Keep", rest, "This one becomes the walker, its prompt the current one"
    )
    imgui.same_line(0, px(4))
    more = len(wall.state.candidates) > FEWEST
    remove = widgets.icon_button(ICON.close, "remove", "Remove this one", theme.MUTED, more)
    return keep, remove


def _buttons(wall: Wall) -> None:
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    imgui.begin_disabled(len(wall.state.candidates) >= MOST)
    if widgets.button(f"{ICON.plus} Add", half, "One more, with the prompt that holds and the next seed"):
        wall.add()
    imgui.end_disabled()
    imgui.same_line(0, px(4))
    if widgets.button("Line up", half, "Side by side again, across the view (Home)"):
        wall.line_up()
    if widgets.button(f"{ICON.close} Leave", -1, "Back to the walker (Escape)"):
        wall.close()
