"""The panel of the compare view, in the place of the prompt: the prompt and the seed of each variant."""

from __future__ import annotations

from runtime.session.prompt_blend import Side
from runtime.session.session import Variant
from viewer.compare.compare_view import FEWEST, MOST, CompareView
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt.prompt_field import is_active, undo_keys

SEED_WIDTH = 112.0  # pixels at scale 1


def panel(compare: CompareView) -> Panel:
    """The panel, in the place of the prompt while the compare view is open."""

    def close() -> bool:
        was_open = compare.open
        compare.close()
        return was_open

    return Panel(
        "Compare", PanelPlace.LEFT, lambda _: draw(compare), ICON.exchange, shown=lambda: compare.open,
        actions=compare.actions, begin_typing=lambda: _begin_typing(compare), close=close,
    )  # fmt: skip


def _begin_typing(compare: CompareView) -> None:
    compare.focus_requested = True


def draw(compare: CompareView) -> None:
    """Contents of the panel."""
    _lineups(compare)
    kept = removed = -1
    height = -2 * imgui.get_frame_height_with_spacing()
    if imgui.begin_child("variants", imgui.ImVec2(0, min(height, -1.0))):
        for i, variant in enumerate(compare.variants):
            imgui.push_id(str(variant.number))
            keep, remove = _row(compare, i, variant)
            kept, removed = (i if keep else kept), (i if remove else removed)
            imgui.pop_id()
    imgui.end_child()
    compare.focus_requested = False
    _buttons(compare)
    if kept >= 0:
        compare.keep(kept)
    elif removed >= 0:
        compare.remove(removed)


def _lineups(compare: CompareView) -> None:
    """What to compare."""
    widgets.muted("One stick drives all. Click one to keep it.", wrap=True)
    third = (imgui.get_content_region_avail().x - 2 * px(4)) / 3
    if widgets.button("Seeds", third, "The live prompt, with a seed for each"):
        compare.seeds()
    imgui.same_line(0, px(4))
    imgui.begin_disabled(compare.prompting.prompt.b is None)
    if widgets.button("Blend", third, "From prompt A to prompt B in equal steps"):
        compare.blends()
    imgui.end_disabled()
    imgui.same_line(0, px(4))
    imgui.begin_disabled(len(compare.settings.prompt_history) < FEWEST)
    if widgets.button("Prompts", third, "The live prompt and the last ones before it"):
        compare.last_prompts()
    imgui.end_disabled()


def _row(compare: CompareView, index: int, variant: Variant) -> tuple[bool, bool]:
    """One character; whether it is to be kept, and to be removed."""
    lit = index == compare.hovered
    imgui.align_text_to_frame_padding()
    widgets.label(f"{index + 1}", theme.ACCENT if lit else theme.MUTED)
    imgui.same_line(px(22), 0)
    if compare.focus_requested and index == 0:
        imgui.set_keyboard_focus_here()
    _prompt(compare, index, variant)
    imgui.dummy(imgui.ImVec2(0, 0))
    imgui.same_line(px(22), 0)
    imgui.set_next_item_width(px(SEED_WIDTH))
    changed, seed = imgui.input_int("##seed", variant.seed)
    widgets.tooltip("A different seed gives a variation")
    if changed and seed >= 0:
        compare.reseed(index, seed)
    imgui.same_line(0, px(4))
    rest = imgui.get_content_region_avail().x - imgui.get_frame_height() - px(4)
    keep = widgets.button(
        f"{ICON.check} Keep", rest, "This one becomes the live character, its prompt the live one"
    )
    imgui.same_line(0, px(4))
    more = len(compare.variants) > FEWEST
    remove = widgets.icon_button(ICON.close, "remove", "Remove this one", theme.MUTED, more)
    return keep, remove


def _prompt(compare: CompareView, index: int, variant: Variant) -> None:
    """The field; what is typed stays in it until it is asked."""
    name, prompt = "##variant prompt", variant.prompt.prompt(Side.A)
    field_id = imgui.get_id(name)
    if is_active(field_id):
        undo_keys(field_id, variant.number not in compare.texts, compare.editor)
    widgets.full_width()
    entered, text = imgui.input_text_with_hint(
        name,
        "A prompt, then Enter",
        compare.texts.get(variant.number, prompt),
        imgui.InputTextFlags_.enter_returns_true,
    )
    compare.texts[variant.number] = text
    if text == prompt and variant.number not in compare.asked:
        del compare.texts[variant.number]
    if entered and text.strip():
        compare.ask(index, text)


def _buttons(compare: CompareView) -> None:
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    imgui.begin_disabled(len(compare.variants) >= MOST)
    if widgets.button(f"{ICON.plus} Add", half, "One more, with the live prompt and the next seed"):
        compare.add()
    imgui.end_disabled()
    imgui.same_line(0, px(4))
    if widgets.button("Line up", half, "In a line again, across the view (Home)"):
        compare.line_up()
    if widgets.button(f"{ICON.close} Close", -1, "Back to the live character (Escape)"):
        compare.close()
