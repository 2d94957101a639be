"""The bar under the view while a take plays: buttons, and the timeline with the tracks of all tools."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from runtime.controls import REQUESTS
from runtime.skeleton import PART_NAMES
from runtime.takes.pins import Pin, Pinned
from viewer.edit.camera_keys import CameraKeys
from viewer.edit.cutting import Cutting
from viewer.edit.graph_editor import GraphEditor
from viewer.edit.item_kinds import (
    CAMERA_KEYS,
    FOOTPLANTS,
    POSE_KEYS,
    camera_items,
    item_kinds,
    pin_items,
    pose_items,
)
from viewer.edit.pins import Pins
from viewer.edit.posing import Posing
from viewer.edit.reference_card import ReferenceCard
from viewer.edit.resimulation import Resimulation
from viewer.edit.selection import Selection
from viewer.edit.timeline import Timeline
from viewer.edit.timeline_look import Track
from viewer.edit.tracks import PINS, Item, Mark, Tracks, lanes, mark_at
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.theme import ICON
from viewer.gui.widgets import px
from viewer.input.bindings import Action
from viewer.prompt.prompt_field import undo_buttons
from viewer.session.playback import Playback

SPEED_RANGE = (0.1, 2.0)
WIDE_PX = 520.0  # at scale 1: wide enough for words next to the icons
GAP_PX, TOOL_PADDING_PX = 4.0, 11.0  # between two buttons, and beside the words of one
TINY_PX = 400.0  # in a narrower bar only actions without another access remain
CUT_HINT = "Split, cut, repeat the take, or join another one to it"
NEW_PIN_HINT = "Hold a hand, a foot, the look or the pose from this frame on, or key the camera here"
PROMPTS_PX, ROW_PX, FEET_PX = 21.0, 15.0, 8.0  # minimum heights at scale 1
PROMPT_TINTS = (theme.ACCENT_FILL, (0.36, 0.55, 0.78, 0.42))
GAIT_TINT, GROUND_TINT = (0.78, 0.62, 0.34, 0.42), (0.55, 0.58, 0.62, 0.35)
POSE_TINT = (0.62, 0.78, 0.40, 1.0)
PART_TINT, PIN_TINT = (0.36, 0.55, 0.78, 0.28), (0.86, 0.48, 0.62, 0.45)
NEW_FOOTPLANT_FRAMES = 8
CAMERA_HINT = "Views of the camera, for a film by “keyed”.\nDrag keys; Delete removes the selection"
PIN_HINT = "A click shows the pin's fields; drag it or its ends"
POSING_HINT = "Pose joints by hand over the motion: click one in the view and drag its handles"
CURVES_HINT = "Curves of the pose and camera keys"
POSE_HINT = "Keys of the pose layer.\nDrag keys; Delete removes the selection"
FEET_HINT = (
    "Footplants: the left foot above, the right foot below.\n"
    "Drag a footplant or its ends; right-click adds one, Delete removes the selection"
)


class TakeTracks:
    """Collects the timeline tracks of all tools, and caches them until something changes."""

    def __init__(self, editing: Resimulation, pins: Pins, selection: Selection) -> None:
        self.editing, self.pins, self.selection = editing, pins, selection
        self._state: tuple[Any, ...] = ()
        self._rows: list[Track] = []

    def rows(self, tracks: Tracks, playback: Playback) -> list[Track]:
        editing, frame = self.editing, playback.frame
        fixed, lit = bool(editing.fixed), (mark_at(tracks.prompts, frame), mark_at(tracks.gaits, frame))
        state = tracks, playback.take, playback.shown, editing.part_tracks, fixed, lit
        if state != self._state:  # parts are compared only if the state differs
            self._state, self._rows = state, [*self._of_motion(tracks, lit, fixed), *self._of_edits(playback)]
        return self._rows

    def _of_motion(self, tracks: Tracks, lit: tuple[int, int], fixed: bool) -> list[Track]:
        editing = self.editing
        parts = [
            Track(
                f"track {part}", part.replace("_", " ").capitalize(), ROW_PX, tracks.parts[part], (PART_TINT,)
            )
            for part in (PART_NAMES if editing.part_tracks else ())
        ]
        return [
            Track(
                "prompts", "Prompts", PROMPTS_PX, tracks.prompts, PROMPT_TINTS, lit=lit[0], adjacent=True,
                fixed=fixed,
            ),
            *parts,
            Track(
                "gaits", "Gait", ROW_PX, tracks.gaits, (GAIT_TINT,), lit=lit[1], adjacent=True, fixed=fixed,
            ),
            # a single ground says the least
            Track(
                "grounds", "Ground", ROW_PX, tracks.grounds, (GROUND_TINT,), fixed=True,
                optional=len(tracks.grounds) == 1,
            ),
        ]  # fmt: skip

    def _of_edits(self, playback: Playback) -> list[Track]:
        """Return tracks of footplants, keys and pins, also empty ones, so that rows do not move when items appear."""
        take, pins = playback.take, pin_items(playback.take)
        rows = [self._feet(0), self._feet(1)]
        for kind, items, name, tint, hint in (
            (CAMERA_KEYS, camera_items(take), "Camera", theme.ACCENT, CAMERA_HINT),
            (POSE_KEYS, pose_items(take), "Pose", POSE_TINT, POSE_HINT),
        ):
            rows.append(Track(kind, name, ROW_PX, _marks(items), (tint,), hint))
        for number, lane in enumerate(lanes(take.poses.pins) or [[]]):
            marks = _marks([pins[index] for index in lane])
            rows.append(
                Track(f"pins {number}", "" if number else "Pins", ROW_PX, marks, (PIN_TINT,), PIN_HINT)
            )
        return rows

    def _feet(self, foot: int) -> Track:
        items = [Item(first, end, FOOTPLANTS, None, foot) for first, end in self.pins.footplants(foot)]
        half, selection = NEW_FOOTPLANT_FRAMES // 2, self.selection

        def plant(frame: int) -> None:
            new = Item(frame - half, frame + half, FOOTPLANTS, None, foot)
            selection.replace("addition", [], [new])

        return Track(
            f"foot {foot}", "" if foot else "Feet", FEET_PX, _marks(items), (theme.ACCENT,), FEET_HINT,
            fixed=bool(self.pins.fixed), more=(("Plant the foot here", plant),),
        )  # fmt: skip


def _marks(items: Sequence[Item]) -> list[Mark]:
    return [Mark(item.start, item.end, _text(item.value), item=item) for item in items]


def _text(value: Any) -> str:
    """Return the text on the mark of a pin."""
    if not isinstance(value, Pin):
        return ""
    return f"{value.what}{' on a rail' if value.rail else ' along' if value.along else ''}".capitalize()


@dataclass(frozen=True)
class Tool:
    """A button of the bar, which becomes a menu entry in a narrow window; higher `folds` move there first.

    It calls `act` or opens `menu`. `why` is the reason if it is disabled, else "".
    """

    text: str
    hint: str
    folds: int
    why: str = ""
    act: Callable[[], object] | None = None
    menu: Callable[[], None] | None = None
    lit: bool = False

    @property
    def width(self) -> float:
        return imgui.calc_text_size(self.text).x + px(TOOL_PADDING_PX)

    def draw(self) -> None:
        padding = imgui.ImVec2(px(TOOL_PADDING_PX / 2), imgui.get_style().frame_padding.y)
        imgui.push_style_var(imgui.StyleVar_.frame_padding, padding)
        with widgets.disabled(self.why):
            pressed = widgets.toggle(self.text, self.lit, self.width, self.why or self.hint) != self.lit
        imgui.pop_style_var()
        if pressed and self.act is not None:
            self.act()
        elif pressed:
            imgui.open_popup(f"{self.text} menu")
        if self.menu is not None and imgui.begin_popup(f"{self.text} menu"):
            self.menu()
            imgui.end_popup()

    def draw_entry(self) -> None:
        if self.menu is not None:
            if imgui.begin_menu(self.text, not self.why):
                self.menu()
                imgui.end_menu()
        elif widgets.item(self.text, self.why or self.hint, self.lit, not self.why) and self.act is not None:
            self.act()


def _draw_tools(tools: Sequence[Tool], room: float) -> None:
    """Draw the tools in one line; those that do not fit go to a menu at its end."""
    gap, more = px(GAP_PX), Tool("…", "More tools", 0)
    shown = _fitting(tools, room, gap, more.width)
    for number, tool in enumerate(shown):
        if number:
            imgui.same_line(0, gap)
        tool.draw()
    folded = [tool for tool in tools if tool not in shown]

    def menu() -> None:
        for tool in folded:
            tool.draw_entry()

    if folded:
        imgui.same_line(0, gap if shown else 0.0)
        replace(more, menu=menu).draw()


def _fitting(tools: Sequence[Tool], room: float, gap: float, more: float) -> list[Tool]:
    """Return the tools that fit, where a menu button for the others has the width `more`."""
    shown = list(tools)
    while shown and sum(t.width + gap for t in shown) + (more + gap) * (len(shown) < len(tools)) > room:
        last = max(tool.folds for tool in shown)
        shown.remove(next(tool for tool in reversed(shown) if tool.folds == last))
    return shown


@dataclass
class Transport:
    """The bar under the view, with its buttons and the timeline."""

    editing: Resimulation
    pins: Pins
    posing: Posing
    cameras: CameraKeys
    cutting: Cutting
    graph: GraphEditor
    selection: Selection = field(init=False)
    timeline: Timeline = field(init=False)
    _tracks: TakeTracks = field(init=False)
    in_view: Callable[[], bool] = lambda: True  # whether the view has the keyboard focus
    _keys_seen: frozenset[Any] = frozenset()
    _wide: bool = True
    _tiny: bool = False

    def __post_init__(self) -> None:
        trim = lambda first, last: self.editing.takes.trim(first, last, held=True)  # noqa: E731
        self.selection = Selection(self.editing, item_kinds(self.editing, self.pins))
        self.timeline = Timeline(trim, self.selection)
        self._tracks = TakeTracks(self.editing, self.pins, self.selection)

    def panel(self, references: ReferenceCard) -> Panel:
        """Return the bar's panel; Escape in the view clears the selection, then closes the take."""

        def close() -> None:
            if not self.selection.let_go():
                self.editing.takes.close_playback()

        return Panel(
            "Transport",
            PanelPlace.BELOW,
            lambda _: self._draw(references),
            shown=lambda: self.editing.playback is not None or bool(self.selection.keys),
            close=close,
            keys=self._keys,
            actions={
                Action.FIT_TIMELINE: self._fit,
                Action.FRAME_BACK: lambda: self._step(-1),
                Action.FRAME_ON: lambda: self._step(1),
                Action.KEY_POSE: self._key,
            },
        )

    def _keys(self) -> None:
        """Run the selection's shortcuts while no text is typed and no window is open."""
        self._follow_pin()
        if not imgui.get_io().want_text_input and self.in_view():
            self.selection.use_keys()

    def _key(self) -> None:
        """Key the picked joint while posing, else the camera."""
        if self.editing.playback is not None:
            (self.posing.set_key if self.posing.shown else self.cameras.add)()

    def _step(self, frames: int) -> None:
        """Step frames, unless the arrow key moves the selection."""
        arrow = imgui.is_key_down(imgui.Key.left_arrow) or imgui.is_key_down(imgui.Key.right_arrow)
        if self.editing.playback is not None and not (arrow and self.selection.keys):
            self.editing.playback.step(frames)

    def _follow_pin(self) -> None:
        """Show the card of a single selected pin, and select a pin chosen in the view."""
        selection, pins = self.selection, self.pins
        selection.poll()
        if self.editing.playback is None:
            return
        key = next(iter(selection.keys)) if len(selection.keys) == 1 else ("", -1, 0)
        alone = int(str(key[1])) if key[0] == PINS else -1
        if selection.keys != self._keys_seen:
            pins.selected = alone
        elif pins.selected != alone:
            chosen = [item for item in selection.all([PINS]) if item.lane == pins.selected]
            selection.pick(chosen)
        self._keys_seen = selection.keys

    def _draw(self, references: ReferenceCard) -> None:
        playback, tracks = self.editing.playback, self.editing.tracks
        if playback is None or tracks is None:
            return
        width = imgui.get_content_region_avail().x
        self._wide, self._tiny = width >= px(WIDE_PX), width < px(TINY_PX)
        self._playing(playback)
        self._edits(playback, references)
        self.timeline.draw(self._tracks.rows(tracks, playback), playback, self._selection(playback))

    def _selection(self, playback: Playback) -> tuple[int, int]:
        """Return the frame range of the selection, or of the trim."""
        items = [] if self.selection.listed else self.selection.items
        if not items:
            return playback.first, playback.last
        return min(item.start for item in items), max(item.end for item in items)

    def shown_frames(self, number: int) -> tuple[int, int] | None:
        """Return the first and last frame that the timeline shows of a take, or None if it shows another take."""
        playback, shown = self.editing.playback, self.timeline.shown
        if playback is None or playback.number != number:
            return None
        return math.ceil(shown.first), math.floor(shown.last)

    def _fit(self) -> None:
        """Zoom to the selection, or back to the whole take."""
        playback = self.editing.playback
        if playback is not None:
            selection = self._selection(playback)
            apart = self.timeline.whole and selection != (0, playback.frames - 1)
            self.timeline.fit(selection if apart else None)

    def _playing(self, playback: Playback) -> None:
        square, gap = px(30), px(4)
        play = f"{ICON.pause if playback.playing else ICON.play}###play"
        for text, hint, act in (
            (ICON.start, "First frame kept (Home)", lambda: playback.seek(playback.first)),
            (f"{ICON.back}##frame back", "One frame back (Left, comma)", lambda: playback.step(-1)),
            (play, "Play or pause (Space, P)", playback.toggle),
            (f"{ICON.on}##frame on", "One frame on (Right, full stop)", lambda: playback.step(1)),
        ):
            if widgets.button(text, square, hint, primary=text is play):
                act()
            imgui.same_line(0, gap)
        if not self._tiny:
            playback.loop = widgets.toggle(ICON.loop, playback.loop, square, "Loop at the end")
            imgui.same_line(0, px(8))
            imgui.set_next_item_width(px(96 if self._wide else 72))
            _, playback.speed = widgets.slider(
                "##speed", playback.speed, *SPEED_RANGE, "%.2f x", logarithmic=True
            )
            widgets.tooltip("Playback speed; Ctrl+click to type it")
            imgui.same_line(0, px(8))
        live = f"{ICON.person} Live" if self._wide else ICON.person
        live_width = imgui.calc_text_size(live).x + 2 * imgui.get_style().frame_padding.x
        right = imgui.get_window_width() - imgui.get_style().window_padding.x - live_width
        end = right - (2 * imgui.get_frame_height() if self._wide else 0.0) - px(8)
        imgui.align_text_to_frame_padding()
        self._time(playback, end - imgui.get_cursor_pos_x())
        if self._wide:
            imgui.same_line(end)
            undo_buttons(self.editing.takes.editor, "take ", 0.0)
        imgui.same_line(right)
        if widgets.button(f"{live}###live", live_width, "Back to the live character (Esc, or just move)"):
            self.editing.takes.close_playback()

    def _time(self, playback: Playback, space: float) -> None:
        """Draw the frame number, and more as space allows; while resimulating, the progress."""
        editing = self.editing
        if editing.busy and space > px(60):
            size = imgui.ImVec2(space, 0)
            imgui.progress_bar(editing.progress, size, f"Resimulating {editing.progress:.0%}")
            return
        frame = f"{playback.number_shown} / {playback.last - playback.take.numbered_from}"
        clock = f"{frame}   {widgets.clock(playback.number_shown / playback.clip.fps)} s"
        choices = (f"{clock}   {playback.take.title}", clock, frame, "")
        widgets.muted(next(text for text in choices if imgui.calc_text_size(text).x <= space or not text))

    def _edits(self, playback: Playback, references: ReferenceCard) -> None:
        takes, fixed = self.editing.takes, self.editing.fixed
        undo_width = 0.0 if self._wide else 2 * imgui.get_frame_height() + px(GAP_PX)
        go_on = imgui.calc_text_size(ICON.walk).x + 2 * imgui.get_style().frame_padding.x + px(GAP_PX)
        _draw_tools(
            self._tools(playback, references), imgui.get_content_region_avail().x - undo_width - go_on
        )
        if not self._wide:
            imgui.same_line(0, px(GAP_PX))
            undo_buttons(takes.editor, "take ", 0.0)
        self._go_on(fixed)

    def _tools(self, playback: Playback, references: ReferenceCard) -> list[Tool]:
        editing, pinned, posing, graph = self.editing, self.pins.fixed, self.posing, self.graph
        trim, fixed = editing.takes.trim, editing.fixed
        gait_hint = "Another gait from this frame to the end of the current one"
        parts_hint = "A track for each body part's description"
        compare_hint = "Compare with another take, a BVH or a film: next to it or over it"

        def show_parts() -> None:
            editing.part_tracks = not editing.part_tracks

        return [
            Tool("[ In", "Trim the start to this frame (I)", 5, act=lambda: trim(first=playback.frame)),
            Tool("Out ]", "Trim the end to this frame (O)", 5, act=lambda: trim(last=playback.frame)),
            Tool("+ Prompt", "Another prompt from this frame on", 0, fixed, menu=self._new_prompt),
            Tool("+ Gait", gait_hint, 2, fixed, menu=self._new_gait),
            Tool("+ Pin", NEW_PIN_HINT, 0, pinned, menu=self._new_pin),
            Tool("Cut…", CUT_HINT, 1, pinned, menu=self.cutting.menu),
            Tool("Pose", POSING_HINT, 1, pinned, act=posing.toggle, lit=posing.open),
            Tool("Curves", CURVES_HINT, 3, act=graph.toggle, lit=graph.open),
            Tool("Parts", parts_hint, 4, act=show_parts, lit=editing.part_tracks),
            Tool("Compare…", compare_hint, 3, menu=references.menu, lit=references.reference.shown),
        ]

    def _go_on(self, fixed: str) -> None:
        """Draw the button at the end of the line, with a label that fits."""
        imgui.same_line(0, px(GAP_PX))
        end = imgui.get_window_width() - imgui.get_style().window_padding.x
        padding, room = 2 * imgui.get_style().frame_padding.x, end - imgui.get_cursor_pos_x()
        texts = [f"{ICON.walk} {text}".rstrip() for text in ("Continue from here", "Continue", "")]
        text = next((t for t in texts if imgui.calc_text_size(t).x + padding <= room), texts[-1])
        width = imgui.calc_text_size(text).x + padding
        imgui.same_line(end - width)
        hint = fixed or "Continue live from this frame"
        if widgets.button(f"{text}###go on", width, hint, enabled=not fixed):
            self.editing.go_on()

    def _new_prompt(self) -> None:
        editing = self.editing
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(px(260))
        hint = "Prompt from here; Enter resimulates"
        entered, editing.new_prompt = widgets.input_text("##new prompt", editing.new_prompt, hint)
        if entered:
            editing.insert_prompt(editing.new_prompt)
            imgui.close_current_popup()

    def _new_gait(self) -> None:
        for gait in REQUESTS:
            if imgui.selectable(f"{gait.label.capitalize()}##gait", False)[0]:
                self.editing.insert_gait(gait)

    def _new_pin(self) -> None:
        for what in Pinned:
            if imgui.selectable(f"{str(what).capitalize()}##pin", False)[0]:
                self.pins.add(what)
        imgui.separator()
        self.cameras.menu()
