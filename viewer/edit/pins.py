"""Pins and footplants: of the take that plays, or pins of the live character; fields, tracks and handles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from runtime.arrays import Array
from runtime.errors import SportError
from runtime.pose import Pose
from runtime.session import live_pins
from runtime.session.session import LIVE, Session, Take
from runtime.takes.clip import Clip
from runtime.takes.footplants import FootplantEdit, Frames, fitted_footplant, footplants, replanted
from runtime.takes.pinned import along_with, farthest, in_world, point_of
from runtime.takes.pins import MAX_TIME_S, Pin, Pinned
from viewer.edit.path import on_screen
from viewer.edit.resimulation import Resimulation
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.render.camera import Camera
from viewer.render.overlays import PinOverlay
from viewer.scene.scene import Scene
from viewer.session.playback import Playback

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
class Pins:
    """Actions on the pins and footplants of the take that plays, or on the pins of the live character."""

    editor: Editor
    editing: Resimulation
    scene: Scene
    selected: int = -1  # of `pins`
    _subject: int = LIVE  # the take whose pins `selected` counts
    _grab: _Grab | None = None
    _planted: tuple[Take, Clip] | None = None

    def __post_init__(self) -> None:
        self.editor.followers.append(self.follow)

    @property
    def playback(self) -> Playback | None:
        """What plays; None while the character is live."""
        return self.editing.playback

    @property
    def take(self) -> Take:
        """The take that plays, or the live character."""
        return self.editor.session.live if self.playback is None else self.playback.take

    @property
    def live(self) -> bool:
        """Whether the pins are those of the live character."""
        return self.playback is None

    @property
    def fixed(self) -> str:
        """Why no pin or plant of the take that plays can be changed; "" when it can."""
        return "It is being resimulated…" if self.editing.busy else "No take plays." if self.live else ""

    @property
    def pins(self) -> tuple[Pin, ...]:
        """The pins of the take that plays, or those that the live character holds."""
        pins = self.take.poses.pins
        return live_pins.held(pins) if self.live else pins

    @property
    def pin(self) -> Pin | None:
        """The selected one."""
        return self.pins[self.selected] if 0 <= self.selected < len(self.pins) else None

    def follow(self, before: Session, now: Session) -> None:
        """Select no pin that is gone."""
        if self._subject != self.take.number:
            return
        self.selected = self.selected if self.selected < len(self.pins) else -1

    def poll(self) -> None:
        """Select nothing where another take plays; call once a frame."""
        if self._subject != self.take.number:
            self._subject, self.selected, self._grab = self.take.number, -1, None

    # --- pins

    def add(self, what: Pinned) -> None:
        """Pin a part of the body where it is: from the frame shown on, or now, until it is let go."""
        playback = self.playback
        if playback is None:
            now = self.scene.now
            place = self._place(what, self.scene.bend(self.scene.simulation.current, now))
            self._set_live(f"hold of the {what}", live_pins.with_held(self.take.poses.pins, what, place, now))
        else:
            begin = playback.frame / playback.clip.fps
            end = min(begin + NEW_SECONDS, playback.clip.seconds)
            pose, last = playback.pose_at(playback.frame), playback.pose_at(round(end * playback.clip.fps))
            made = Pin(what, self._place(what, pose), begin, end, of=begin)
            walks = float(np.linalg.norm(last.hips_position - pose.hips_position)) > WALKS_M
            if walks and what in (Pinned.LEFT_HAND, Pinned.RIGHT_HAND):
                point = along_with(np.array(made.point), pose.hips_position, pose.local_rotations[0])
                made = replace(made, along=True, point=_triple(point))
            playback.playing = False
            self._set(f"pin of the {what}", (*self.take.poses.pins, made))
        self.poll()
        self.selected = len(self.pins) - 1

    def _place(self, what: Pinned, pose: Pose) -> tuple[float, float, float]:
        if what is Pinned.POSE:
            return 0.0, 0.0, 0.0
        x, y, z = (round(float(v), 4) for v in point_of(what, pose.positions, pose.world_rotations))
        return x, y, z

    def toggle_live(self, what: Pinned) -> None:
        """Pin a part of the live character where it is, or let it go."""
        if any(pin.what is what for pin in self.pins):
            self._release(what)
        else:
            self.add(what)

    def _release(self, what: Pinned) -> None:
        pins = live_pins.released(self.take.poses.pins, what, self.scene.now)
        self._set_live(f"the {what} let go", pins)
        self.selected = -1

    def change(self, pin: Pin) -> None:
        """Another point, time or kind for the selected pin, while the mouse holds its field or handle."""
        old = self.pin
        if old is None or pin == old or (not self.live and self.editing.busy):
            return
        number, pins = self.take.number, self.take.poses.pins
        at = [id(one) for one in pins].index(id(old))
        made = (*pins[:at], pin, *pins[at + 1 :])
        self.editor.drag(f"pin of the {pin.what}", lambda session: _with_pins(session, number, made))

    def try_change(self, make: Callable[[], Pin]) -> None:
        """The same with a pin that may be none: what is wrong is said."""
        try:
            self.change(make())
        except SportError as error:
            self.editor.messages.error(error)

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
        if self.live:
            self._release(pin.what)
        else:
            kept = tuple(p for i, p in enumerate(self.take.poses.pins) if i != self.selected)
            self._set(f"removal of the {pin.what}'s pin", kept)
        self.selected = -1

    def close(self) -> bool:
        """Select nothing; whether something was."""
        was, self.selected = self.pin is not None, -1
        return was

    def _set(self, label: str, pins: tuple[Pin, ...]) -> None:
        if self.fixed:
            self.editor.messages.warn(self.fixed)
            return
        take = self.take
        if self.editor.do(f"{label} of {take.title}", lambda session: _with_pins(session, take.number, pins)):
            self._say(label)

    def _set_live(self, label: str, pins: tuple[Pin, ...]) -> None:
        self.editor.do(label, lambda session: _with_pins(session, LIVE, pins))

    def _say(self, label: str) -> None:
        self.editor.messages.note(f"{self.take.title}: {label}. Ctrl+Z undoes it.")

    def reach(self) -> float:
        """Metres from the selected pin of a take to what it holds in the worst frame, when that is to be told; else 0."""
        playback, pin = self.playback, self.pin
        if playback is None or pin is None or playback.shown is not playback.take:
            return 0.0
        far = farthest(playback.clip, pin)
        return far if far > MISSED_M else 0.0

    # --- plants

    @property
    def planted(self) -> Clip | None:
        """The take that plays with its plants and without its pins."""
        if self.playback is None:
            return None
        take = self.playback.shown
        if self._planted is None or self._planted[0] is not take:
            known = self._planted
            same = known is not None and (known[0].motion, known[0].mirrored, known[0].poses.footplants) == (
                take.motion, take.mirrored, take.poses.footplants,
            )  # fmt: skip
            clip = (
                known[1] if same and known is not None else replanted(take.base_clip, take.poses.footplants)
            )
            self._planted = take, clip
        return self._planted[1]

    def footplants(self, foot: int) -> list[Frames]:
        """When a foot of the take that plays bears; while one is dragged, as it would."""
        clip, playback = self.planted, self.playback
        if clip is None or playback is None:
            return []
        known = footplants(clip.contacts[:, 2 * foot : 2 * foot + 2])
        for edit in playback.take.poses.footplants[len(playback.shown.poses.footplants) :]:
            if edit.foot == foot:
                known = [p for p in known if p != edit.old] + ([edit.new] if edit.new else [])
        return known

    def set_footplant(self, foot: int, old: Frames | None, new: Frames | None) -> None:
        """Move, add or remove a plant of a foot, while the mouse holds it."""
        clip, playback = self.planted, self.playback
        if clip is None or playback is None or self.fixed:
            return
        try:
            fitted = None if new is None else fitted_footplant(clip, foot, old, *new)
        except SportError as error:
            self.editor.messages.error(error)
            return
        edit, take = FootplantEdit(foot, old, fitted), playback.take
        what = "removal" if new is None else "addition" if old is None else "change"
        name = f"{what} of a {('left', 'right')[foot]} footplant"
        made = replace(take.poses, footplants=(*playback.shown.poses.footplants, edit))
        self.editor.drag(
            f"{name} in {take.title}", lambda session: session.with_take(take.number, poses=made)
        )

    # --- in the view

    def _pose(self) -> Pose:
        return self.scene.simulation.current if self.playback is None else self.playback.pose()

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
        if self.playback is not None:
            self.playback.playing = False
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


def _with_pins(session: Session, number: int, pins: tuple[Pin, ...]) -> Session:
    take = session.take(number)
    return session if take is None else session.with_take(number, poses=replace(take.poses, pins=pins))


def _depth(camera: Camera, place: Array) -> float:
    view = camera.view_matrix().astype(float)
    return float(-(view @ np.array([*place, 1.0]))[2])


def _triple(point: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) for value in point)
    return x, y, z


def shown_end(pin: Pin, clip: Clip) -> float:
    """Seconds at which a pin ends within a clip."""
    return clip.seconds if pin.end >= MAX_TIME_S else min(pin.end, clip.seconds)
