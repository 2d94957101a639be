"""Pins and plants in the user's hands: of the take that plays, or pins of the live character; fields, tracks and handles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from runtime.arrays import Array
from runtime.errors import SportError
from runtime.pose import FPS, Pose
from runtime.takes.clip import Clip
from runtime.takes.pinned import along_with, farthest, in_world, pinned, point_of
from runtime.takes.pins import MAX_TIME_S, Pin, Pinned
from runtime.takes.plants import Frames, PlantEdit, fitted_plant, plants, replanted
from runtime.takes.pose_edits import PoseEdits
from viewer.gl_bindings import imgui
from viewer.render.camera import Camera
from viewer.render.overlays import PinOverlay
from viewer.stage.path_tool import on_screen
from viewer.stage.stage import Stage
from viewer.takes.editing import SLOT, TakeEditing
from viewer.takes.state import ClipItem

GRAB_PX = 14.0  # at scale 1: a click nearer to a handle takes it
NEW_SECONDS = 1.0  # that a new pin of a take holds
WALKS_M = 0.6  # farther in that time, a hand could not stay: its new pin goes along
MISSED_M = 0.03  # farther from its point, a pin is said to be out of reach


@dataclass(frozen=True)
class _Grab:
    """A handle that the mouse drags: `end` of a rail or its point, at a depth from the camera."""

    end: bool
    depth: float


@dataclass
class Pinning:
    """Actions on pins and plants. An edit is a `draft` while the mouse moves it, and a version of the take after."""

    editing: TakeEditing
    stage: Stage
    selected: int = -1  # of `pins`
    draft: PoseEdits | None = None
    _label: str = ""
    _subject: object = None  # whose pins `selected` counts
    _grab: _Grab | None = None
    _planted: tuple[object, Clip] | None = field(default=None, init=False)

    @property
    def item(self) -> ClipItem | None:
        """The take that plays."""
        return self.editing.state.played

    @property
    def fixed(self) -> str:
        """Why no pin or plant of the take that plays can be changed; "" when it can."""
        return "It is being driven again…" if self.editing.busy else "" if self.item else "No take plays."

    @property
    def edits(self) -> PoseEdits:
        """The edits of the take that plays, with the draft."""
        item = self.item
        return self.draft or (PoseEdits() if item is None else item.edits)

    @property
    def pins(self) -> tuple[Pin, ...]:
        """The pins of the take that plays, or those that the live character holds."""
        return self.stage.pins.held if self.item is None else self.edits.pins

    @property
    def pin(self) -> Pin | None:
        """The selected one."""
        return self.pins[self.selected] if 0 <= self.selected < len(self.pins) else None

    @property
    def now(self) -> float:
        """Seconds on the clock of live pins."""
        return self.stage.drives.next_frame / FPS

    # --- pins

    def add(self, what: Pinned) -> None:
        """Pin a part of the body where it is: from the frame shown on, or now, until it is let go."""
        playback, item = self.editing.state.playback, self.item
        if playback is None or item is None:
            pose = self.stage.pins.bend(self.stage.state.simulation.current, self.now)
            self.stage.pins.hold(what, self._place(what, pose), self.now)
            self.selected = len(self.pins) - 1
            return
        begin = playback.frame / playback.clip.fps
        end = min(begin + NEW_SECONDS, playback.clip.seconds)
        pose, last = playback.pose_at(playback.frame), playback.pose_at(round(end * playback.clip.fps))
        made = Pin(what, self._place(what, pose), begin, end, of=begin)
        walks = float(np.linalg.norm(last.hips_position - pose.hips_position)) > WALKS_M
        if walks and what in (Pinned.LEFT_HAND, Pinned.RIGHT_HAND):
            point = along_with(np.array(made.point), pose.hips_position, pose.local_rotations[0])
            made = replace(made, along=True, point=_triple(point))
        playback.playing = False
        self._change_to(replace(self.edits, pins=(*self.edits.pins, made)), f"pin of the {what}")
        self.selected = len(self.pins) - 1

    def _place(self, what: Pinned, pose: Pose) -> tuple[float, float, float]:
        if what is Pinned.POSE:
            return 0.0, 0.0, 0.0
        x, y, z = (round(float(v), 4) for v in point_of(what, pose.positions, pose.world_rotations))
        return x, y, z

    def holds(self, what: Pinned) -> bool:
        """Whether the live character holds with a part."""
        return any(pin.what is what for pin in self.stage.pins.held)

    def toggle_live(self, what: Pinned) -> None:
        """Pin a part of the live character where it is, or let it go."""
        if self.holds(what):
            self.stage.pins.release(what, self.now)
            self.selected = -1
        else:
            self.add(what)

    def change(self, pin: Pin) -> None:
        """Another point, time or kind for the selected pin."""
        if self.pin is None or pin == self.pin:
            return
        if self.item is None:
            self.stage.pins.change(self.selected, pin)
            return
        made = list(self.edits.pins)
        made[self.selected] = pin
        self._change_to(replace(self.edits, pins=tuple(made)), f"pin of the {pin.what}")

    def try_change(self, make: Callable[[], Pin]) -> None:
        """The same with a pin that may be none: what is wrong is said."""
        try:
            self.change(make())
        except SportError as error:
            self.editing.messages.error(error)

    def put_along(self, pin: Pin, along: bool) -> None:
        """Let the point go with the character, or stay in the world: where it is now."""
        pose = self._pose()
        places = in_world(pin, pose.hips_position, pose.local_rotations[0])
        if along:
            places = tuple(along_with(p, pose.hips_position, pose.local_rotations[0]) for p in places)
        point, *rest = (_triple(p) for p in places)
        self.change(replace(pin, along=along, point=point, rail=rest[0] if rest else None))

    def put_rail(self, pin: Pin, rail: bool) -> None:
        """Give the pin a rail of two metres ahead, or take it away."""
        ahead = (0.0, 0.0, 2.0)
        if not pin.along:
            yaw = self._pose().root_yaw
            ahead = 2.0 * math.sin(yaw), 0.0, 2.0 * math.cos(yaw)
        end = _triple(np.array(pin.point) + np.array(ahead)) if rail else None
        self.change(replace(pin, rail=end))

    def delete(self) -> None:
        """Remove the selected pin; a live one is let go."""
        pin = self.pin
        if pin is None:
            return
        if self.item is None:
            self.stage.pins.release(pin.what, self.now)
        else:
            kept = tuple(p for i, p in enumerate(self.edits.pins) if i != self.selected)
            self._change_to(replace(self.edits, pins=kept), f"pin of the {pin.what}, removed")
        self.selected = -1

    def close(self) -> bool:
        """Select nothing; whether something was."""
        was, self.selected = self.pin is not None, -1
        return was

    # --- plants

    @property
    def planted(self) -> Clip | None:
        """The take that plays with its plants and without its pins."""
        item = self.item
        if item is None:
            return None
        if self._planted is None or self._planted[0] is not item.clip:
            self._planted = item.clip, replanted(item.driven, item.edits.plants)
        return self._planted[1]

    def plants(self, foot: int) -> list[Frames]:
        """When a foot of the take that plays bears; while one is dragged, as it would."""
        clip, item = self.planted, self.item
        if clip is None or item is None:
            return []
        known = plants(clip.contacts[:, 2 * foot : 2 * foot + 2])
        new = self.draft.plants[len(item.edits.plants) :] if self.draft is not None else ()
        for edit in new:
            if edit.foot == foot:
                known = [p for p in known if p != edit.old] + ([edit.new] if edit.new else [])
        return known

    def plant(self, foot: int, old: Frames | None, new: Frames | None) -> None:
        """Move, add or remove a plant of a foot."""
        clip, item = self.planted, self.item
        if clip is None or item is None:
            return
        try:
            fitted = None if new is None else fitted_plant(clip, foot, old, *new)
        except SportError as error:
            self.editing.messages.error(error)
            return
        edit = PlantEdit(foot, old, fitted)
        side = ("left", "right")[foot]
        name = f"{side} foot" + (", plant removed" if new is None else ", plant added" if old is None else "")
        self._change_to(replace(item.edits, plants=(*item.edits.plants, edit)), name)

    # --- drafts and versions

    def _change_to(self, edits: PoseEdits, label: str) -> None:
        if self.fixed:
            self.editing.messages.warn(self.fixed)
        else:
            self.draft, self._label = edits, label

    def poll(self) -> None:
        """Make the draft a version once the mouse lets go of it; call once a frame."""
        item = self.item
        if self._subject is not item:
            self._subject, self.selected, self.draft, self._grab = item, -1, None, None
        busy = imgui.is_mouse_down(0) or imgui.is_any_item_active() or self.editing.busy
        if self.draft is None or item is None or busy:
            return
        draft, label, before, driven = self.draft, self._label, item.clip, item.driven

        def take(made: Clip) -> None:
            self.draft = None
            if item.clip is before:
                item.edit(made, item.drive, label, driven if draft else None, draft)
                self.editing.show(item)
                self._say(item, label)

        self.editing.takes.jobs.submit(SLOT, lambda: draft.apply(driven), take, lambda _: self._give_up())

    def _give_up(self) -> None:
        self.draft = None

    def _say(self, item: ClipItem, label: str) -> None:
        far = 0.0 if self.pin is None else farthest(item.clip, self.pin)
        out = f" {far:.2f} m out of reach at worst." if far > MISSED_M else ""
        self.editing.messages.note(f"{item.name}: {label}.{out} Ctrl+Z brings the version before back.")

    def shown_pose(self) -> Pose | None:
        """The pose of the take with the draft; None where there is none."""
        playback, clip = self.editing.state.playback, self.planted
        if self.draft is None or playback is None or clip is None:
            return None
        frame = playback.frame
        return playback.standing(pinned(clip, self.draft.pins, only=frame).pose(frame))

    # --- in the view

    def _pose(self) -> Pose:
        playback = self.editing.state.playback
        return self.stage.state.simulation.current if playback is None else playback.pose()

    def overlay(self) -> PinOverlay | None:
        """The points of all pins, with their rails."""
        pose, lit = self._pose(), list[bool]()
        points, rails = list[Array](), list[tuple[Array, ...]]()
        for i, pin in enumerate(self.pins):
            if pin.what is not Pinned.POSE:
                places = in_world(pin, pose.hips_position, pose.local_rotations[0])
                points += places
                lit += [i == self.selected] * len(places)
                rails += [places] if len(places) == 2 else []
        return (
            PinOverlay(np.array(points), np.array(lit), np.array(rails).reshape(-1, 2, 3)) if points else None
        )

    def use_mouse(self, camera: Camera) -> bool:
        """Take and drag handles in this frame; whether the left button is in use here."""
        io = imgui.get_io()
        if imgui.is_mouse_clicked(0) and not io.want_capture_mouse:
            self._grab = self._press(camera)
        elif not imgui.is_mouse_down(0):
            self._grab = None
        pin = self.pin
        if self._grab is None or pin is None:
            return False
        if io.mouse_delta.x or io.mouse_delta.y:
            self._drag(camera, pin, self._grab)
        return True

    def _press(self, camera: Camera) -> _Grab | None:
        io, pose = imgui.get_io(), self._pose()
        best, found = GRAB_PX * imgui.get_style().font_scale_dpi, None
        for i, pin in enumerate(self.pins):
            if pin.what is Pinned.POSE:
                continue
            for end, place in enumerate(in_world(pin, pose.hips_position, pose.local_rotations[0])):
                shown = on_screen(camera, place, io.display_size)
                if shown is None:
                    continue
                away = math.hypot(shown[0] - io.mouse_pos.x, shown[1] - io.mouse_pos.y)
                if away <= best:
                    best, found = away, (i, bool(end), place)
        if found is None:
            return None
        playback = self.editing.state.playback
        if playback is not None:
            playback.playing = False
        self.selected = found[0]
        return _Grab(found[1], _depth(camera, found[2]))

    def _drag(self, camera: Camera, pin: Pin, grab: _Grab) -> None:
        """Move the handle with the mouse, as far from the camera as it is."""
        io, pose = imgui.get_io(), self._pose()
        place = in_world(pin, pose.hips_position, pose.local_rotations[0])[int(grab.end)]
        view, half = camera.view_matrix().astype(float), camera.half_height
        metres = 2.0 * half * grab.depth / max(io.display_size.y, 1.0)
        place = place + metres * (io.mouse_delta.x * view[0, :3] - io.mouse_delta.y * view[1, :3])
        if pin.along:
            place = along_with(place, pose.hips_position, pose.local_rotations[0])
        self.change(replace(pin, **{"rail" if grab.end else "point": _triple(place)}))  # type: ignore[arg-type]


def _depth(camera: Camera, place: Array) -> float:
    view = camera.view_matrix().astype(float)
    return float(-(view @ np.array([*place, 1.0]))[2])


def _triple(point: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) for value in point)
    return x, y, z


def shown_end(pin: Pin, clip: Clip) -> float:
    """Seconds at which a pin ends within a clip."""
    return clip.seconds if pin.end >= MAX_TIME_S else min(pin.end, clip.seconds)
