"""Pins and footplants of the playing take, or pins of the live character: edits, handles in the view, and the pin's card."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from runtime.arrays import Array
from runtime.errors import SportError
from runtime.pose import Pose
from runtime.session.session import LIVE, Session, Take
from runtime.takes.clip import Clip
from runtime.takes.footplants import Frames, footplants, replanted
from runtime.takes.pinned import ARMS, along_with, farthest, in_world, point_of
from runtime.takes.pins import DEFAULT_EASE_S, MAX_TIME_S, Pin, Pinned, held_pins, released
from viewer.edit.handles import Handles, dragged
from viewer.edit.resimulation import Resimulation
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.gui import panels, widgets
from viewer.gui.layout import Rect
from viewer.gui.panels import Panel, PanelPlace
from viewer.gui.widgets import px
from viewer.render.camera import Camera
from viewer.render.overlays import PinOverlay
from viewer.scene.scene import Scene
from viewer.session.playback import Playback

NEW_SECONDS = 1.0  # duration of a new pin of a take
WALKS_M = 0.6  # movement in that time from which a new hand pin moves along with the character
MISSED_M = 0.03  # distance from its point at which a pin is reported as out of reach
WIDTH_PX, SMALL_WIDTH_PX = 214.0, 168.0  # of the card, at scale 1
SMALL_VIEW_PX = 520.0  # in a narrower view the card is small, so that it does not hide the character
MIN_VIEW_PX = 230.0
HELD_LIVE = (Pinned.LEFT_HAND, Pinned.RIGHT_HAND, Pinned.LEFT_FOOT, Pinned.RIGHT_FOOT, Pinned.LOOK)


@dataclass
class Pins:
    """Edits pins and footplants of the playing take, or pins of the live character."""

    editor: Editor
    editing: Resimulation
    scene: Scene
    selected: int = -1  # index in `pins`
    _subject: int = LIVE  # the take to which `selected` refers
    _handles: Handles = field(default_factory=Handles)
    _planted: tuple[object, Clip] | None = None  # with the motion and footplants it was made from

    def __post_init__(self) -> None:
        self.editor.followers.append(self.follow)

    @property
    def playback(self) -> Playback | None:
        return self.editing.playback

    @property
    def take(self) -> Take:
        return self.editor.session.live if self.playback is None else self.playback.take

    @property
    def fixed(self) -> str:
        """The reason why pins cannot be edited, or ""."""
        return "It is being resimulated…" if self.playback is not None and self.editing.busy else ""

    @property
    def pins(self) -> tuple[Pin, ...]:
        """The pins of the playing take, or those that the live character holds."""
        pins = self.take.poses.pins
        return held_pins(pins) if self.playback is None else pins

    @property
    def pin(self) -> Pin | None:
        return self.pins[self.selected] if 0 <= self.selected < len(self.pins) else None

    def follow(self, before: Session, now: Session) -> None:
        """Deselect a pin that no longer exists."""
        if self._subject == self.take.number and self.selected >= len(self.pins):
            self.selected = -1

    def poll(self) -> None:
        """Deselect the pin when another take plays; call once per frame."""
        number = LIVE if self.playback is None else self.playback.number
        if self._subject != number:
            self._subject, self.selected, self._handles.held = number, -1, -1

    # --- pins

    def add(self, what: Pinned) -> None:
        """Pin a body part where it is: for a second from the frame shown, or live until released."""
        playback, pose, pins = self.playback, self._pose(), self.take.poses.pins
        if playback is None:
            now = self.scene.now
            pose, pins = self.scene.bend(pose, now), released(pins, what, now)
            made = Pin(what, _place(what, pose), now + DEFAULT_EASE_S, MAX_TIME_S)
        else:
            playback.playing, clip = False, playback.clip
            begin = playback.frame / clip.fps
            end = min(begin + NEW_SECONDS, clip.seconds)
            made = Pin(what, _place(what, pose), begin, end, of=begin)
            moved = playback.pose_at(round(end * clip.fps)).hips_position - pose.hips_position
            if what in (Pinned.LEFT_HAND, Pinned.RIGHT_HAND) and float(np.linalg.norm(moved)) > WALKS_M:
                point = along_with(np.array(made.point), pose.hips_position, pose.local_rotations[0])
                made = replace(made, along=True, point=_triple(point))
        self._put(f"pin of the {what}", (*pins, made))
        self.poll()
        self.selected = len(self.pins) - 1

    def toggle_live(self, what: Pinned) -> None:
        """Pin a body part of the live character where it is, or release it."""
        at = next((i for i, pin in enumerate(self.pins) if pin.what is what), None)
        if at is None:
            self.add(what)
        else:
            self.selected = at
            self.delete()

    def delete(self) -> None:
        """Delete the selected pin; a live pin is released and stays in the recording."""
        pin, pins = self.pin, self.take.poses.pins
        if pin is not None:
            kept = tuple(p for p in pins if p is not pin)
            if self.playback is None:
                kept = released(pins, pin.what, self.scene.now)
            self._put(f"removal of the {pin.what}'s pin", kept)
            self.selected = -1

    def change(self, pin: Pin) -> None:
        """Change the selected pin while its field or handle is dragged."""
        old, pins = self.pin, self.take.poses.pins
        if old is not None and pin != old:
            self._put(f"pin of the {pin.what}", tuple(pin if p is old else p for p in pins), held=True)

    def try_change(self, make: Callable[[], Pin]) -> None:
        """Call `change` with the pin that `make` returns; show its SportError as a message."""
        try:
            self.change(make())
        except SportError as error:
            self.editor.messages.error(error)

    def put_along(self, pin: Pin, along: bool) -> None:
        """Attach the pin to the character, or fix it in the world, at its current position."""
        pose = self._pose()
        places = in_world(pin, pose.hips_position, pose.local_rotations[0])
        if along:
            places = tuple(along_with(p, pose.hips_position, pose.local_rotations[0]) for p in places)
        point, *rest = (_triple(p) for p in places)
        self.change(replace(pin, along=along, point=point, rail=rest[0] if rest else None))

    def put_rail(self, pin: Pin, rail: bool) -> None:
        """Add a rail to the pin, along the body's movement while it holds or two metres ahead, or remove it."""
        if not rail:
            self.change(replace(pin, rail=None))
            return
        playback, begin, end = self.playback, self._pose(), self._pose()
        if playback is not None:
            fps, seconds = playback.clip.fps, playback.clip.seconds
            begin, end = (playback.pose_at(round(at * fps)) for at in (pin.start, pin.end_in(seconds)))
        point = in_world(pin, begin.hips_position, begin.local_rotations[0])[0]
        way = end.hips_position - begin.hips_position
        if float(np.linalg.norm(way)) < WALKS_M:
            way = 2.0 * np.array([math.sin(begin.root_yaw), 0.0, math.cos(begin.root_yaw)])
        self.change(replace(pin, along=False, point=_triple(point), rail=_triple(point + way)))

    def close(self) -> None:
        """Deselect the pin."""
        self.selected = -1

    def _put(self, label: str, pins: tuple[Pin, ...], held: bool = False) -> None:
        take = self.take
        if self.fixed:
            if not held:
                self.editor.messages.warn(self.fixed)
            return
        try:
            poses = replace(take.poses, pins=pins)
        except SportError as error:
            self.editor.messages.error(error)
            return
        if held:
            self.editor.put(label, take.number, held, poses=poses)
        elif self.editor.do(
            f"{label} of {take.title}", lambda session: session.with_take(take.number, poses=poses)
        ):
            self.editor.messages.note(f"{take.title}: {label}. Ctrl+Z undoes it.")

    def reach(self) -> float:
        """Return the largest distance (metres) of the held part from its pin in any frame, or 0 if it is small."""
        playback, pin = self.playback, self.pin
        if playback is None or pin is None or playback.shown is not playback.take:
            return 0.0
        far = farthest(playback.clip, pin)
        return far if far > MISSED_M else 0.0

    # --- footplants

    def planted_frames(self, take: Take, foot: int) -> list[Frames]:
        """Return the frame ranges in which a foot of a take is planted, with footplant edits and without pins."""
        key, known = (take.made, take.mirrored, take.poses.footplants), self._planted
        if known is None or known[0] != key:
            known = self._planted = key, replanted(take.base_clip, take.poses.footplants)
        return footplants(known[1].contacts[:, 2 * foot : 2 * foot + 2])

    def footplants(self, foot: int) -> list[Frames]:
        """Return the planted frame ranges of a foot of the playing take, including a drag in progress."""
        playback = self.playback
        if playback is None:
            return []
        known = self.planted_frames(playback.shown, foot)
        for edit in playback.take.poses.footplants[len(playback.shown.poses.footplants) :]:
            if edit.foot == foot:
                known = sorted([p for p in known if p != edit.old] + ([edit.new] if edit.new else []))
        return known

    # --- in the view

    def _pose(self) -> Pose:
        return self.scene.simulation.current if self.playback is None else self.playback.pose()

    def _points(self) -> list[tuple[int, str, Array]]:
        """Return the pin index, field name and position of every handle."""
        if not self.pins:
            return []
        pose = self._pose()
        return [
            (i, name, place)
            for i, pin in enumerate(self.pins)
            if pin.what is not Pinned.POSE
            for name, place in zip(
                ("point", "rail"), in_world(pin, pose.hips_position, pose.local_rotations[0]), strict=False
            )
        ]

    @property
    def place(self) -> Array | None:
        """The selected pin's position `(3,)`, or None."""
        return next((place for i, _, place in self._points() if i == self.selected), None)

    def overlay(self) -> PinOverlay | None:
        points = self._points()
        if not points:
            return None
        rails = [(points[k - 1][2], place) for k, (_, name, place) in enumerate(points) if name == "rail"]
        lit = np.array([i == self.selected for i, _, _ in points])
        return PinOverlay(np.array([p for _, _, p in points]), lit, np.array(rails).reshape(-1, 2, 3))

    def use_mouse(self, camera: Camera) -> bool:
        """Grab and drag handles of pins; return whether the left button is in use."""
        points, handles = self._points(), self._handles
        moves = handles.use_mouse(self.editor, camera, np.array([place for _, _, place in points]))
        if not 0 <= handles.held < len(points):
            return False
        index, name, place = points[handles.held]
        if handles.pressed:
            self.selected = index
            if self.playback is not None:
                self.playback.playing = False
        pin = self.pin
        if moves and pin is not None:
            pose, place = self._pose(), dragged(camera, place)
            if pin.along:
                place = along_with(place, pose.hips_position, pose.local_rotations[0])
            self.change(replace(pin, **{name: _triple(place)}))  # type: ignore[arg-type]
        return True

    # --- panels

    def panel(self) -> Panel:
        """Return the card of the selected pin; Escape closes it."""
        return Panel(
            "Pin", PanelPlace.VIEW, lambda view: _draw_card(self, view), shown=lambda: self.pin is not None,
            close=self.close,
        )  # fmt: skip

    def draw_live(self, key_camera: Callable[[], None], width: float) -> None:
        """Draw the button for pins of the live character, which holds chosen parts where they are."""
        held = [pin.what for pin in self.pins] if self.playback is None else []
        hint = "Hold a hand, a foot or the look at a point, which can be dragged in the view"
        text = "Hold…" if not held else f"Holds {len(held)}"
        with widgets.disabled(self.playback is not None):
            if widgets.toggle(text, bool(held), width, hint) != bool(held):
                imgui.open_popup("hold")
        if imgui.begin_popup("hold"):
            for what in HELD_LIVE:
                if widgets.item(str(what).capitalize(), chosen=what in held):
                    self.toggle_live(what)
            imgui.separator()
            if widgets.item("Key the camera"):
                key_camera()
            imgui.end_popup()


def _place(what: Pinned, pose: Pose) -> tuple[float, float, float]:
    if what is Pinned.POSE:
        return 0.0, 0.0, 0.0
    return _triple(point_of(what, pose.positions, pose.world_rotations))


def _triple(point: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) for value in point)
    return x, y, z


def _draw_card(pins: Pins, view: Rect) -> None:
    pin = pins.pin
    if pin is None or view.width < px(MIN_VIEW_PX):
        return
    with panels.card("Pin", view, SMALL_WIDTH_PX if view.width < px(SMALL_VIEW_PX) else WIDTH_PX, right=True):
        pressed = panels.card_title(
            str(pin.what).capitalize(), "pin", "Let go" if pins.playback is None else "Remove the pin"
        )
        if pin.what is not Pinned.POSE:
            _draw_points(pins, pin)
        if pins.playback is not None:
            _draw_times(pins, pin, pins.playback.clip)
        if pressed:
            (pins.delete if pressed == "remove" else pins.close)()


def _draw_points(pins: Pins, pin: Pin) -> None:
    _draw_triple(pins, pin, "point")
    half = widgets.column_width(2)
    hint = "The point moves with the character"
    if widgets.toggle("Along", pin.along, half, hint) != pin.along:
        pins.put_along(pin, not pin.along)
    widgets.same_line()
    hint = "The hand slides along a straight rail"
    with widgets.disabled(pin.what not in ARMS):
        if widgets.toggle("Rail", pin.rail is not None, half, hint) != (pin.rail is not None):
            pins.put_rail(pin, pin.rail is None)
    current = pins.pin
    if current is not None and current.rail is not None:
        _draw_triple(pins, current, "rail")


def _draw_triple(pins: Pins, pin: Pin, name: str) -> None:
    value, changed = getattr(pin, name), []
    hints = ("To its left" if pin.along else "X", "Up", "Ahead" if pin.along else "Z")
    imgui.push_item_width(widgets.column_width(3))
    for number, (axis, hint) in enumerate(zip("xyz", hints, strict=True)):
        if number:
            widgets.same_line()
        hint = f"{hint}, metres. Drag, or double-click to type."
        moved, entry = widgets.drag(f"##pin {name} {axis}", value[number], (-1000.0, 1000.0), "%.2f", hint)
        changed.append(entry if moved else value[number])
    imgui.pop_item_width()
    pins.try_change(lambda: replace(pin, **{name: tuple(changed)}))  # type: ignore[arg-type]


def _draw_times(pins: Pins, pin: Pin, clip: Clip) -> None:
    fps, last = clip.fps, len(clip) - 1
    zero = pins.take.numbered_from
    first, end = round(pin.start * fps) - zero, round(pin.end_in(clip.seconds) * fps) - zero
    last -= zero
    fields: tuple[tuple[str, float, tuple[float, float], str, str], ...] = (
        ("start", first, (-zero, end), "from %d", "First frame at full strength"),
        ("end", end, (first, last), "to %d", "Last frame at full strength"),
        ("ease_in", pin.ease_in, (0.0, 5.0), "in %.2f s", "Ease in before that"),
        ("ease_out", pin.ease_out, (0.0, 5.0), "out %.2f s", "Ease out after that"),
    )
    imgui.push_item_width(widgets.column_width(2))
    for number, (name, value, limits, text, hint) in enumerate(fields):
        if number % 2:
            widgets.same_line()
        frames = isinstance(value, int)
        moved, value = widgets.drag(
            f"##pin {text.split()[0]}", value, limits, text, hint, 0.3 if frames else 0.005
        )
        now = pins.pin
        if moved and now is not None:
            value = max((value + zero) / fps if frames else value, now.start if name == "end" else 0.0)
            pins.try_change(partial(replace, now, **{name: value}))
    imgui.pop_item_width()
    far = 0.0 if pins.editor.dragging else pins.reach()
    if far:
        widgets.muted(f"up to {far:.2f} m out of reach", wrap=True)
