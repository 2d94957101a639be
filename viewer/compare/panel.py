"""The compare view's panel, in place of the prompt panel, and the names above its characters."""

import math

import numpy as np

from runtime.session.prompt_blend import Side
from runtime.session.session import Variant
from runtime.skeleton import SPORT_SKELETON
from viewer.compare.compare_view import MAX_CHARACTERS, MIN_CHARACTERS, CompareView
from viewer.compare.lineup import MAX_ROW_CHARACTERS, names, weight_of
from viewer.edit.handles import on_screen
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.prompt.prompt_field import is_active, undo_keys

SEED_WIDTH_PX = 112.0  # pixels at scale 1


def panel(compare: CompareView) -> Panel:
    """Return the compare view's panel, which replaces the prompt panel."""

    return Panel(
        "Compare", PanelPlace.LEFT, lambda _: draw(compare), ICON.exchange, shown=lambda: compare.open,
        actions=compare.actions, begin_typing=compare.begin_typing, close=compare.close,
    )  # fmt: skip


def draw(compare: CompareView) -> None:
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
    add = compare.add if len(compare.variants) < MAX_CHARACTERS else None
    widgets.buttons(
        (f"{ICON.plus} Add", "Add a character: the live prompt, the next seed", add),
        ("Line up", "Line them up again (Home)", compare.line_up),
    )
    widgets.buttons((f"{ICON.close} Close", "Back to the live character (Escape)", compare.close))
    if kept >= 0:
        compare.keep(kept)
    elif removed >= 0:
        compare.remove(removed)


def _lineups(compare: CompareView) -> None:
    widgets.muted("One stick drives all. Click one to keep it.", wrap=True)
    blends = compare.blends if compare.prompting.prompt.b else None
    enough = len(compare.settings.prompt_history) >= MIN_CHARACTERS
    widgets.buttons(
        ("Seeds", "The live prompt, with a seed for each", compare.seeds),
        ("Blend", "From prompt A to prompt B in equal steps", blends),
        ("Prompts", "The live prompt and the last ones before it", compare.last_prompts if enough else None),
    )


def _row(compare: CompareView, index: int, variant: Variant) -> tuple[bool, bool]:
    """Draw one character; return whether to keep it, and whether to remove it."""
    lit = index == compare.hovered
    imgui.align_text_to_frame_padding()
    widgets.label(f"{index + 1}", theme.ACCENT if lit else theme.MUTED)
    imgui.same_line(px(22), 0)
    if compare.focus_requested and index == 0:
        imgui.set_keyboard_focus_here()
    _prompt(compare, index, variant)
    imgui.dummy(imgui.ImVec2(0, 0))
    imgui.same_line(px(22), 0)
    imgui.set_next_item_width(px(SEED_WIDTH_PX))
    changed, seed = imgui.input_int("##seed", variant.seed)
    widgets.tooltip("A different seed gives a variation")
    if changed and seed >= 0:
        compare.reseed(index, seed)
    widgets.same_line()
    rest = imgui.get_content_region_avail().x - imgui.get_frame_height() - px(4)
    keep = widgets.button(f"{ICON.check} Keep", rest, "Make this the live character, with its prompt")
    widgets.same_line()
    more = len(compare.variants) > MIN_CHARACTERS
    remove = widgets.icon_button(ICON.close, "remove", "Remove this character", theme.MUTED, more)
    return keep, remove


def _prompt(compare: CompareView, index: int, variant: Variant) -> None:
    """Draw the prompt's field, which keeps its text until Enter."""
    name, prompt = "##variant prompt", variant.prompt.prompt(Side.A)
    field_id = imgui.get_id(name)
    if is_active(field_id):
        undo_keys(field_id, variant.number not in compare.texts, compare.editor)
    weight = weight_of(variant.prompt)
    imgui.set_next_item_width(-imgui.calc_text_size(weight).x - px(8) if weight else -1)
    typed = compare.texts.get(variant.number, prompt)
    entered, text = widgets.input_text(name, typed, "A prompt, then Enter")
    if weight:
        imgui.same_line(0, px(8))
        imgui.align_text_to_frame_padding()
        widgets.muted(weight)
        widgets.tooltip(f"Prompt B: {variant.prompt.prompt(Side.B) or 'own words'}")
    compare.texts[variant.number] = text
    if text == prompt and variant.number not in compare.pending:
        del compare.texts[variant.number]
    if entered and text.strip():
        compare.ask(index, text)


Place = tuple[float, float]  # on the screen
HEAD = SPORT_SKELETON.index("Head")
OVER_HEAD = np.array([0.0, 0.34, 0.0])  # metres
HALF_WIDTH_M = 0.4  # clickable half width of a character
MAX_NAME_PX, MIN_NAME_PX = 190.0, 60.0  # pixels at scale 1
NAME_PADDING_PX, MIN_WORDS_PX = 6.0, 56.0
NAMES_FROM_PX = 110.0  # minimum room for a name


def names_panel(compare: CompareView) -> Panel:
    """Return the panel with the names of the characters; clicking a character keeps it."""

    def draw_names(view: Rect) -> None:
        camera, size = compare.scene.camera.current, imgui.get_io().display_size
        heads = [on_screen(camera, pose.positions[HEAD] + OVER_HEAD, size) for pose in compare.poses]
        feet = [on_screen(camera, np.asarray(pose.root_position, float), size) for pose in compare.poses]
        free = not imgui.get_io().want_capture_mouse
        compare.hovered = _under_mouse(heads, feet) if free else -1
        width = _name_width([head for head in heads if head is not None])
        for index, head in enumerate(heads):
            if head is not None and view.x <= head[0] <= view.x + view.width:
                _draw_name(compare, index, head, feet[index], width, view)
        if compare.hovered >= 0:
            imgui.set_mouse_cursor(imgui.MouseCursor_.hand)
            if imgui.is_mouse_clicked(0):
                compare.keep(compare.hovered)

    return Panel("Names", PanelPlace.SIGN, draw_names, shown=lambda: compare.open)


def _draw_name(
    compare: CompareView, index: int, head: Place, foot: Place | None, width: float, view: Rect
) -> None:
    """Draw the number and name of a character at a screen position, as wide as there is room."""
    hovered, count = index == compare.hovered, len(compare.poses)
    if width < px(NAMES_FROM_PX) and not hovered:  # the panel shows the names
        text = f"{index + 1}"
    else:
        name = _name_of(compare, index, hovered)
        text = _fitted(
            f"{index + 1}", *name, (px(MAX_NAME_PX) if hovered else width) - 2 * px(NAME_PADDING_PX)
        )
    # names of the front row go below the feet: above the heads they would cover the back row
    if foot is not None and index < (count + 1) // 2 and count > MAX_ROW_CHARACTERS:
        head = foot[0], foot[1] + 2.0 * imgui.get_text_line_height()
    _label(text, head, hovered, view)


def _name_of(compare: CompareView, index: int, whole: bool) -> tuple[str, str]:
    """Return its prompt and what differs; "" for a prompt shared by all, unless the `whole` name is requested."""
    if compare.variants[index].number in compare.pending:
        return "…", ""
    found = names(compare.variants)
    prompt, rest = found[index]
    alike = len({one for one, _ in found}) == 1
    return ("" if alike and rest and not whole else prompt), rest


def _name_width(heads: list[Place]) -> float:
    """Return the width in pixels for one name, so that neighbours at similar height do not overlap."""
    line = 1.5 * imgui.get_text_line_height()
    gaps = [abs(a[0] - b[0]) for k, a in enumerate(heads) for b in heads[:k] if abs(a[1] - b[1]) < line]
    return min(max(min(gaps, default=px(MAX_NAME_PX)) - px(6), px(MIN_NAME_PX)), px(MAX_NAME_PX))


def _under_mouse(heads: list[Place | None], feet: list[Place | None]) -> int:
    """Return the nearest character whose box or name is under the mouse; -1 for none."""
    mouse, best = imgui.get_io().mouse_pos, (math.inf, -1)
    for i, (head, foot) in enumerate(zip(heads, feet, strict=True)):
        if head is None or foot is None:
            continue
        height = foot[1] - head[1]
        half = max(HALF_WIDTH_M / 2.0 * height, px(10))
        aside = abs(mouse.x - head[0])
        if aside < half and head[1] - px(14) < mouse.y < foot[1] + 0.05 * height:
            best = min(best, (aside, i))
    return best[1]


def _fitted(number: str, name: str, rest: str, width: float) -> str:
    """Return the name shortened to a width; the part that distinguishes it stays complete."""
    room = width - imgui.calc_text_size(rest).x
    if not name or room < px(MIN_WORDS_PX):
        return widgets.elided(f"{number}  {rest.lstrip(', ') or name}", width)
    return widgets.elided(f"{number}  {name}", room) + rest


def _label(text: str, head: Place, hovered: bool, view: Rect) -> None:
    drawing, pad = imgui.get_background_draw_list(), px(NAME_PADDING_PX)
    size = imgui.calc_text_size(text)
    left = min(max(head[0] - size.x / 2, view.x + pad), view.x + view.width - size.x - pad)
    low = imgui.ImVec2(left - pad, head[1] - size.y - px(3))
    high = imgui.ImVec2(left + size.x + pad, head[1] + px(3))
    drawing.add_rect_filled(low, high, widgets.packed(theme.ACCENT if hovered else theme.PANEL), px(5))
    tint = theme.ON_ACCENT if hovered else theme.TEXT
    drawing.add_text(imgui.ImVec2(left, low.y + px(3)), widgets.packed(tint), text)
