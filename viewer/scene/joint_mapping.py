"""Mapping of a character's joints by hand: the guess, the user's choice, its file, and the window."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from runtime.character.character import joints_of
from runtime.character.guess import JointGuess
from runtime.character.joint_map import joint_map_path, save_joint_map, saved_joint_map
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
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages


@dataclass
class JointMapping:
    """The window for mapping joints by hand; `chosen` maps SPORT joints to joints of the file, "" for none. `load` loads a character."""

    messages: Messages
    jobs: Jobs
    load: Callable[[Path], None]  # with the map in the file's folder
    open: bool = False
    path: Path | None = None
    guess: JointGuess | None = None
    chosen: dict[str, str] = field(default_factory=dict)
    selected: str = ""  # the SPORT joint of the row used last
    problem: str = ""  # why it could not be applied

    def guessed(self, joint: str) -> str:
        """Return the file's joint guessed for a SPORT joint, or ""."""
        found = {} if self.guess is None else self.guess.found
        return self.guess.names[found[joint]] if self.guess is not None and joint in found else ""

    def plays(self, joint: str) -> str:
        """Return the file's joint in use for a SPORT joint, or ""."""
        return self.chosen.get(joint, self.guessed(joint))

    @property
    def missing(self) -> list[str]:
        """Required SPORT joints without a joint of the file."""
        return [joint for joint in NEEDED if not self.plays(joint)]

    @property
    def shown(self) -> Path | None:
        """The file whose joints are shown, or None while the window is closed."""
        return self.path if self.open else None

    def begin(self, path: Path) -> None:
        """Open the window for a character file."""
        self.jobs.submit(
            Slot("joints", path),
            lambda: (joints_of(path, {}), saved_joint_map(path)),
            lambda found: self._show(path, *found),
        )

    def _show(self, path: Path, guess: JointGuess, saved: dict[str, str]) -> None:
        known = {joint: name for joint, name in saved.items() if not name or name in guess.names}
        lost = len(saved) - len(known)
        self.open, self.path, self.guess, self.chosen = True, path, guess, known
        self.selected = self.problem = ""
        if lost:
            self.problem = f"{lost} names of {joint_map_path(path).name} are not in the skeleton."

    def choose(self, joint: str, name: str | None) -> None:
        """Map a SPORT joint to a joint of the file: "" for none, None for the guess.

        Each joint of the file maps to one SPORT joint only: another one that had it loses it.
        """
        chosen = {key: value for key, value in self.chosen.items() if key != joint}
        name = self.guessed(joint) if name is None else name
        if name != self.guessed(joint):
            chosen[joint] = name
        others = [key for key in SPORT_SKELETON.names if key != joint and name and self.plays(key) == name]
        chosen |= dict.fromkeys(others, "")
        self.chosen, self.selected, self.problem = chosen, joint, ""

    def guess_all(self) -> None:
        self.chosen, self.problem = {}, ""

    def apply(self) -> None:
        """Save the map next to the file and reload the character with it."""
        if self.path is None or self.missing:
            return
        path, chosen = self.path, dict(self.chosen)

        def keep() -> Path | None:
            if chosen:
                return save_joint_map(path, chosen)
            joint_map_path(path).unlink(missing_ok=True)
            return None

        def kept(written: Path | None) -> None:
            where = f"Joints of {path.name} kept in {written.name}." if written else "Joints as guessed."
            self.messages.note(where)
            self.load(path)

        self.jobs.submit(Slot("joints", path), keep, kept, self.refused, writing=f"the joints of {path.name}")

    def refused(self, error: Exception) -> None:
        """Show why the map could not be used or saved."""
        self.problem = str(error)

    def close(self) -> None:
        """Close the window without applying changes."""
        self.open = False


WIDTH_PX, HEIGHT_PX = 720.0, 560.0  # at scale 1
AROUND_LISTS_PX = 224.0  # part of the window's height: title, counts, buttons, margins
INDENT_PX = 9.0  # of a child in the trees
NAME_WIDTH_PX = 150.0  # of the SPORT joints


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
    path = printable("" if state.path is None else state.path.name)
    count = f"{len(guess.found)} of our {len(SPORT_SKELETON)} joints found by {guess.origin}"
    found = count if guess.found else "no joint found by names, hierarchy or rest pose"
    by_hand = f", {len(state.chosen)} by hand" if state.chosen else ""
    widgets.muted(widgets.elided(f"{path}: {found}{by_hand}", room))
    widgets.tooltip(printable(state.path))
    if state.missing:
        missing = ", ".join(state.missing)
        widgets.text(widgets.elided(f"Still missing: {missing}", room), theme.ERROR)
        widgets.tooltip(missing)
    else:
        widgets.muted("Nothing is missing. Unmapped joints follow their neighbours.")


def _file_joints(state: JointMapping, guess: JointGuess) -> None:
    played = {state.plays(joint): joint for joint in SPORT_SKELETON.names if state.plays(joint)}
    for k, depth in _ordered(guess):
        name, plays = printable(guess.names[k]), played.get(guess.names[k], "")
        imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + px(INDENT_PX) * min(depth, 12))
        lit = bool(plays) and plays == state.selected
        tint, room = (
            theme.ACCENT if lit else theme.TEXT if plays else theme.MUTED,
            imgui.get_content_region_avail().x,
        )
        widgets.text(widgets.elided(f"{name}  = {plays}" if plays else name, room), tint)
        widgets.tooltip(f"{name} plays {plays or 'none of our joints'}")


def _mapped_joint(state: JointMapping, guess: JointGuess, joint: int) -> None:
    name, x = SPORT_SKELETON.names[joint], imgui.get_cursor_pos_x()
    plays, by_hand = state.plays(name), name in state.chosen
    lost = name in NEEDED and not plays
    imgui.set_cursor_pos_x(x + px(INDENT_PX) * 0.8 * _depth(joint))
    imgui.align_text_to_frame_padding()
    widgets.text(name, theme.ERROR if lost else theme.TEXT if plays else theme.MUTED)
    imgui.same_line(x + px(NAME_WIDTH_PX))
    widgets.full_width()
    shown = f"{printable(plays)}  ({'by hand' if by_hand else 'guessed'})"
    if not plays:
        shown = "missing" if lost else "none (follows)"
    with widgets.color(imgui.Col_.text, theme.ERROR if lost else theme.ACCENT if by_hand else theme.TEXT):
        opened = imgui.begin_combo(f"##joint {name}", shown, imgui.ComboFlags_.height_large)
    if opened:
        _choices(state, guess, name, plays)
        imgui.end_combo()


@cache
def _depth(joint: int) -> int:
    """Return the number of ancestors of a SPORT joint."""
    parent = SPORT_SKELETON.parents[joint]
    return 0 if parent < 0 else 1 + _depth(parent)


def _choices(state: JointMapping, guess: JointGuess, name: str, plays: str) -> None:
    text = f"As guessed: {printable(state.guessed(name)) or 'none'}"
    if imgui.selectable(f"{text}##as guessed", name not in state.chosen)[0]:
        state.choose(name, None)
    if imgui.selectable("None##none", name in state.chosen and not plays)[0]:
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
        widgets.text(printable(state.problem), theme.ERROR, wrap=True)
    guess_all, apply = state.guess_all if state.chosen else None, None if state.missing else state.apply
    hint = "Saved next to the file, and used whenever it is opened"
    widgets.buttons(
        ("As guessed##guess all", "Discard all manual choices", guess_all),
        (f"{ICON.check} Apply##apply joints", hint, apply),
        primary=1,
    )


def _ordered(guess: JointGuess) -> list[tuple[int, int]]:
    """Return the joints of the file in hierarchical order, parents before children, with their depth."""
    tree, found = JointTree(guess.parents, guess.positions), []
    waiting = [(k, 0) for k in reversed(range(len(guess.parents))) if guess.parents[k] < 0]
    while waiting:
        k, depth = waiting.pop()
        found.append((k, depth))
        waiting.extend((child, depth + 1) for child in reversed(tree.children[k]))
    return found
