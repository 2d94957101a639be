"""The joints window: the character's joint tree on the left, our joints with what plays them on the right."""

from __future__ import annotations

from runtime.character.guess import JointGuess
from runtime.character.joints import NEEDED
from runtime.character.tree import JointTree
from runtime.safe_read import printable
from runtime.skeleton import SPORT_SKELETON
from viewer.gl_bindings import imgui
from viewer.gui import overlay, theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON, Fonts
from viewer.gui.widgets import px
from viewer.scene.joint_mapping import JointMapping

WIDTH, HEIGHT = 720.0, 560.0  # pixels at scale 1
AROUND = 224.0  # of the window's height: title, counts, buttons, margins
INDENT = 9.0  # of a child in the trees
NAME_WIDTH = 150.0  # of our joints


def panel(mapping: JointMapping, fonts: Fonts) -> Panel:
    """The joints window."""

    def close() -> bool:
        was_open = mapping.open
        mapping.close()
        return was_open

    return Panel("Joints", PanelPlace.WINDOW, lambda _: draw(mapping, fonts), close=close)


def draw(mapping: JointMapping, fonts: Fonts) -> None:
    """The window, when it is open."""
    state = mapping
    if not state.open or state.guess is None or state.path is None:
        return
    with overlay.window(fonts, "Joints", ICON.person, WIDTH) as closed:
        room = imgui.get_content_region_avail().x
        _found(state, room)
        height = max(min(px(HEIGHT), imgui.get_io().display_size.y) - px(AROUND), px(80))
        left, x = 0.42 * room, imgui.get_cursor_pos_x()
        widgets.label("Joints of the file")
        imgui.same_line(x + left + px(8))
        widgets.label("Joint mapping")
        if imgui.begin_child("file joints", imgui.ImVec2(left, height)):
            _file_joints(state, state.guess)
        imgui.end_child()
        imgui.same_line(0, px(8))
        if imgui.begin_child("our joints", imgui.ImVec2(0, height)):
            for joint in range(len(SPORT_SKELETON)):
                _our_joint(mapping, state.guess, joint)
        imgui.end_child()
        _end(mapping)
    if closed[0]:
        mapping.close()


def _found(state: JointMapping, room: float) -> None:
    guess, missing = state.guess, state.missing
    if guess is None or state.path is None:
        return
    count = f"{len(guess.found)} of our {len(SPORT_SKELETON)} joints found by {guess.origin}"
    found = count if guess.found else "no joint found by names, tree or rest pose"
    by_hand = f", {len(state.chosen)} by hand" if state.chosen else ""
    text = f"{printable(state.path.name)}: {found}{by_hand}"
    widgets.muted(widgets.elided(text, room))
    widgets.tooltip(printable(state.path))
    if missing:
        with widgets.color(imgui.Col_.text, theme.ERROR):
            imgui.text_unformatted(widgets.elided(f"Still missing: {', '.join(missing)}", room))
        widgets.tooltip(", ".join(missing))
    else:
        widgets.muted("Nothing is missing. Joints without a partner follow their neighbours.")


def _file_joints(state: JointMapping, guess: JointGuess) -> None:
    """The tree of the file; what a joint plays stands beside it."""
    played = {state.plays(joint): joint for joint in SPORT_SKELETON.names if state.plays(joint)}
    for k, depth in _ordered(guess):
        name, x = guess.names[k], imgui.get_cursor_pos_x()
        imgui.set_cursor_pos_x(x + px(INDENT) * min(depth, 12))
        ours = played.get(name, "")
        lit = bool(ours) and ours == state.selected
        tint = theme.ACCENT if lit else theme.TEXT if ours else theme.MUTED
        room = imgui.get_content_region_avail().x
        with widgets.color(imgui.Col_.text, tint):
            text = f"{printable(name)}  = {ours}" if ours else printable(name)
            imgui.text_unformatted(widgets.elided(text, room))
        widgets.tooltip(f"{printable(name)} plays {ours or 'none of our joints'}")


def _our_joint(mapping: JointMapping, guess: JointGuess, joint: int) -> None:
    """One of our joints with the list of those that may play it."""
    state, name = mapping, SPORT_SKELETON.names[joint]
    depth, k = 0, SPORT_SKELETON.parents[joint]
    while k >= 0:
        depth, k = depth + 1, SPORT_SKELETON.parents[k]
    x, needed, plays = imgui.get_cursor_pos_x(), name in NEEDED, state.plays(name)
    imgui.set_cursor_pos_x(x + px(INDENT) * 0.8 * depth)
    imgui.align_text_to_frame_padding()
    lost = needed and not plays
    with widgets.color(imgui.Col_.text, theme.ERROR if lost else theme.TEXT if plays else theme.MUTED):
        imgui.text_unformatted(name)
    imgui.same_line(x + px(NAME_WIDTH))
    widgets.full_width()
    origin = "by hand" if name in state.chosen else "guessed"
    shown = f"{printable(plays)}  ({origin})" if plays else "missing" if lost else "none: follows"
    tint = theme.ERROR if lost else theme.ACCENT if name in state.chosen else theme.TEXT
    imgui.push_style_color(imgui.Col_.text, imgui.ImVec4(*tint))
    opened = imgui.begin_combo(f"##joint {name}", shown, imgui.ComboFlags_.height_large)
    imgui.pop_style_color()
    if opened:
        _choices(mapping, guess, name, plays)
        imgui.end_combo()


def _choices(mapping: JointMapping, guess: JointGuess, name: str, plays: str) -> None:
    state = mapping
    guessed = state.guessed(name)
    text = f"As guessed: {printable(guessed)}" if guessed else "As guessed: none"
    if imgui.selectable(f"{text}##as guessed", name not in state.chosen)[0]:
        mapping.choose(name, None)
    if imgui.selectable("None of them##none", name in state.chosen and not plays)[0]:
        mapping.choose(name, "")
    imgui.separator()
    for k, depth in _ordered(guess):
        label = f"{'  ' * min(depth, 12)}{printable(guess.names[k])}##{k}"
        chosen = guess.names[k] == plays
        if imgui.selectable(label, chosen)[0]:
            mapping.choose(name, guess.names[k])
        if chosen and imgui.is_window_appearing():
            imgui.set_scroll_here_y(0.5)


def _end(mapping: JointMapping) -> None:
    state = mapping
    if state.problem:
        with widgets.color(imgui.Col_.text, theme.ERROR):
            imgui.text_wrapped(printable(state.problem))
    half = (imgui.get_content_region_avail().x - px(4)) / 2
    imgui.begin_disabled(not state.chosen)
    if widgets.button("As guessed##guess all", half, "Drops everything that was chosen by hand"):
        mapping.guess_all()
    imgui.end_disabled()
    imgui.same_line(0, px(4))
    imgui.begin_disabled(bool(state.missing))
    hint = "Kept beside the file, and used whenever it is opened"
    if widgets.button(f"{ICON.check} Apply##apply joints", half, hint, primary=True):
        mapping.apply()
    imgui.end_disabled()


def _ordered(guess: JointGuess) -> list[tuple[int, int]]:
    """Joints of the file in the order of their tree, children under their parents, with their depth."""
    tree, found = JointTree(guess.parents, guess.positions), []
    waiting = [(k, 0) for k in reversed(range(len(guess.parents))) if guess.parents[k] < 0]
    while waiting:
        k, depth = waiting.pop()
        found.append((k, depth))
        waiting.extend((child, depth + 1) for child in reversed(tree.children[k]))
    return found
