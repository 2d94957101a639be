"""The joints window: the joints of the character's file on the left, the project's with what plays them on the right."""

from __future__ import annotations

from functools import cache

from runtime.character.guess import JointGuess
from runtime.character.joints import NEEDED
from runtime.character.tree import JointTree
from runtime.safe_read import printable
from runtime.skeleton import SPORT_SKELETON
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.scene.joint_mapping import JointMapping

WIDTH_PX, HEIGHT_PX = 720.0, 560.0  # pixels at scale 1
AROUND_LISTS_PX = 224.0  # of the window's height: title, counts, buttons, margins
INDENT_PX = 9.0  # of a child in the trees
NAME_WIDTH_PX = 150.0  # of the project's joints


def panel(mapping: JointMapping) -> Panel:

    def draw(_: Rect) -> None:
        if mapping.guess is None:
            return
        room = imgui.get_content_region_avail().x
        _found(mapping, mapping.guess, room)
        height = max(min(px(HEIGHT_PX), imgui.get_io().display_size.y) - px(AROUND_LISTS_PX), px(80))
        left, x = 0.42 * room, imgui.get_cursor_pos_x()
        widgets.label("Joints of the file")
        imgui.same_line(x + left + px(8))
        widgets.label("Joint mapping")
        if imgui.begin_child("file joints", imgui.ImVec2(left, height)):
            _file_joints(mapping, mapping.guess)
        imgui.end_child()
        imgui.same_line(0, px(8))
        if imgui.begin_child("our joints", imgui.ImVec2(0, height)):
            for joint in range(len(SPORT_SKELETON)):
                _mapped_joint(mapping, mapping.guess, joint)
        imgui.end_child()
        _end(mapping)

    return Panel(
        "Joints", PanelPlace.WINDOW, draw, ICON.person, lambda: mapping.open, WIDTH_PX, close=mapping.close
    )


def _found(state: JointMapping, guess: JointGuess, room: float) -> None:
    """How many joints have a partner, and which ones still need one."""
    path = printable("" if state.path is None else state.path.name)
    count = f"{len(guess.found)} of our {len(SPORT_SKELETON)} joints found by {guess.origin}"
    found = count if guess.found else "no joint found by names, tree or rest pose"
    by_hand = f", {len(state.chosen)} by hand" if state.chosen else ""
    widgets.muted(widgets.elided(f"{path}: {found}{by_hand}", room))
    widgets.tooltip(printable(state.path))
    if state.missing:
        missing = ", ".join(state.missing)
        with widgets.color(imgui.Col_.text, theme.ERROR):
            imgui.text_unformatted(widgets.elided(f"Still missing: {missing}", room))
        widgets.tooltip(missing)
    else:
        widgets.muted("Nothing is missing. Joints without a partner follow their neighbours.")


def _file_joints(state: JointMapping, guess: JointGuess) -> None:
    played = {state.plays(joint): joint for joint in SPORT_SKELETON.names if state.plays(joint)}
    for k, depth in _ordered(guess):
        name, plays = printable(guess.names[k]), played.get(guess.names[k], "")
        imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + px(INDENT_PX) * min(depth, 12))
        lit = bool(plays) and plays == state.selected
        tint = theme.ACCENT if lit else theme.TEXT if plays else theme.MUTED
        room = imgui.get_content_region_avail().x
        with widgets.color(imgui.Col_.text, tint):
            imgui.text_unformatted(widgets.elided(f"{name}  = {plays}" if plays else name, room))
        widgets.tooltip(f"{name} plays {plays or 'none of our joints'}")


def _mapped_joint(state: JointMapping, guess: JointGuess, joint: int) -> None:
    """One of the project's joints with the list of those that may play it."""
    name, x = SPORT_SKELETON.names[joint], imgui.get_cursor_pos_x()
    plays, by_hand = state.plays(name), name in state.chosen
    lost = name in NEEDED and not plays
    imgui.set_cursor_pos_x(x + px(INDENT_PX) * 0.8 * _depth(joint))
    imgui.align_text_to_frame_padding()
    with widgets.color(imgui.Col_.text, theme.ERROR if lost else theme.TEXT if plays else theme.MUTED):
        imgui.text_unformatted(name)
    imgui.same_line(x + px(NAME_WIDTH_PX))
    widgets.full_width()
    shown = f"{printable(plays)}  ({'by hand' if by_hand else 'guessed'})"
    if not plays:
        shown = "missing" if lost else "none: follows"
    with widgets.color(imgui.Col_.text, theme.ERROR if lost else theme.ACCENT if by_hand else theme.TEXT):
        opened = imgui.begin_combo(f"##joint {name}", shown, imgui.ComboFlags_.height_large)
    if opened:
        _choices(state, guess, name, plays)
        imgui.end_combo()


@cache
def _depth(joint: int) -> int:
    """Return how many joints are above one of the project's."""
    parent = SPORT_SKELETON.parents[joint]
    return 0 if parent < 0 else 1 + _depth(parent)


def _choices(state: JointMapping, guess: JointGuess, name: str, plays: str) -> None:
    text = f"As guessed: {printable(state.guessed(name)) or 'none'}"
    if imgui.selectable(f"{text}##as guessed", name not in state.chosen)[0]:
        state.choose(name, None)
    if imgui.selectable("None of them##none", name in state.chosen and not plays)[0]:
        state.choose(name, "")
    imgui.separator()
    for k, depth in _ordered(guess):
        label = f"{'  ' * min(depth, 12)}{printable(guess.names[k])}##{k}"
        chosen = guess.names[k] == plays
        if imgui.selectable(label, chosen)[0]:
            state.choose(name, guess.names[k])
        if chosen and imgui.is_window_appearing():
            imgui.set_scroll_here_y(0.5)


def _end(state: JointMapping) -> None:
    if state.problem:
        with widgets.color(imgui.Col_.text, theme.ERROR):
            imgui.text_wrapped(printable(state.problem))
    guess_all, apply = state.guess_all if state.chosen else None, None if state.missing else state.apply
    hint = "Saved next to the file, and used whenever it is opened"
    widgets.buttons(
        ("As guessed##guess all", "Discard all choices made by hand", guess_all),
        (f"{ICON.check} Apply##apply joints", hint, apply),
        primary=1,
    )


def _ordered(guess: JointGuess) -> list[tuple[int, int]]:
    """Return the joints of the file in the order of their tree, children under their parents, with their depth."""
    tree, found = JointTree(guess.parents, guess.positions), []
    waiting = [(k, 0) for k in reversed(range(len(guess.parents))) if guess.parents[k] < 0]
    while waiting:
        k, depth = waiting.pop()
        found.append((k, depth))
        waiting.extend((child, depth + 1) for child in reversed(tree.children[k]))
    return found
