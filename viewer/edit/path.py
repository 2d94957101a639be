"""A path that is drawn on the ground with the mouse: the live character walks it, a take is resimulated along it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from runtime.controls import Controls, Gait
from runtime.errors import SportError
from runtime.motion.control_scripts import PlanarPose
from runtime.session.motion import Motion
from runtime.session.session import LIVE, Session, Take
from runtime.terrain.height_map import Terrain
from viewer.edit.resimulation import Resimulation
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.render.camera import Camera
from viewer.render.overlays import PathOverlay
from viewer.scene.scene import Scene

if TYPE_CHECKING:
    from runtime.motion.control_scripts import PathWalk, Waypoint

GRAB_PX = 16.0  # at scale 1: a click nearer to a point takes it
DRAWN_M = 0.7  # between two points of a path that is drawn by a drag
REACH_M = 80.0  # clicks on ground farther away are none
RAY_STEPS = 400


@dataclass
class PathTool:
    """The path of the live character, which it walks, or of the take that plays, which is resimulated along it."""

    editor: Editor
    editing: Resimulation
    scene: Scene
    active: bool = False  # clicks on the ground set points
    selected: int = -1
    walk: PathWalk | None = None
    _begun: bool = False  # since the last `walk_began`
    _time_s: float = 0.0
    _held: bool = False  # the mouse drags the selected point
    _drawing: bool = False  # the drag began with a new point and sets more
    _subject: int = LIVE  # the take whose points `selected` counts
    _of_motion: tuple[Motion, tuple[Waypoint, ...]] | None = None

    def __post_init__(self) -> None:
        self.editor.followers.append(self.follow)

    @property
    def take(self) -> Take:
        """The take whose path this is."""
        return self.editing.take or self.editor.session.live

    @property
    def of_take(self) -> bool:
        """Whether the path is that of a take that can be resimulated along another one."""
        take = self.editing.take
        return take is not None and (not self.editing.fixed or self.editing.busy)

    @property
    def points(self) -> tuple[Waypoint, ...]:
        """The points that were drawn; of a take without any, while they are edited, the way that it goes."""
        take = self.take
        if take.path or take.motion is None or not (self.active and self.of_take):
            return take.path
        if self._of_motion is None or self._of_motion[0] is not take.motion:
            self._of_motion = take.motion, self._way(take.motion)
        return self._of_motion[1]

    def _way(self, motion: Motion) -> tuple[Waypoint, ...]:
        from runtime.takes.take_path import path_of

        try:
            return () if motion.inputs is None else path_of(motion.clip, motion.inputs)
        except SportError as error:
            self.editor.messages.error(error)
            return ()

    def follow(self, before: Session, now: Session) -> None:
        """Select no point that is gone; a walk along another path ends."""
        if self.take.number == LIVE and before.live.path != now.live.path:
            self.walk = None

    def poll(self) -> None:
        """Look after which take the path is of; call once a frame."""
        take = self.take
        if take.number != self._subject:
            self._subject, self.active, self.selected = take.number, False, -1
        if self.selected >= len(self.points) or (self.active and self.selected < 0):
            self.selected = len(self.points) - 1

    def overlay(self) -> PathOverlay | None:
        """What is drawn on the ground."""
        if not (self.active or self.walk is not None) or not self.points:
            return None
        return PathOverlay(np.array([(p.x, p.z) for p in self.points]), self.selected if self.active else -1)

    # --- points

    def _put(self, label: str, points: tuple[Waypoint, ...], held: bool = False) -> None:
        number = self.take.number
        change = self.editor.drag if held else self.editor.do
        name = "" if number == LIVE else f" of {self.take.title}"
        change(f"{label}{name}", lambda session: session.with_take(number, path=points))

    def add(self, x: float, z: float, held: bool = False) -> None:
        """Another last point, with the speed and gait of the one before."""
        from runtime.motion.control_scripts import MAX_POINTS, Waypoint

        points = self.points
        if len(points) < MAX_POINTS:
            before = points[-1] if points else Waypoint(x, z)
            self._put("points of the path", (*points, replace(before, x=x, z=z)), held)
            self.selected = len(points)

    def change(self, **values: float | Gait) -> None:
        """Another place, speed or gait for the selected point, while the mouse holds it."""
        points, i = self.points, self.selected
        if 0 <= i < len(points):
            made = replace(points[i], **values)  # type: ignore[arg-type]
            self._put("point of the path", (*points[:i], made, *points[i + 1 :]), held=True)

    def delete(self) -> None:
        """Remove the selected point; the one before is selected then."""
        points, i = self.points, self.selected
        if 0 <= i < len(points):
            self._put("removal of a point of the path", points[:i] + points[i + 1 :])
            self.selected = max(i - 1, 0) if len(points) > 1 else -1

    def clear(self) -> None:
        """Remove every point."""
        self._put("removal of the path", ())
        self.selected = -1

    def resimulate(self) -> None:
        """Resimulate the take that plays along the points."""
        self.editor.finish_drag()
        self.editing.walk(self.points)

    # --- mouse

    def use_mouse(self, camera: Camera, terrain: Terrain) -> bool:
        """Set, take and drag points in this frame; whether the left button is the tool's."""
        io = imgui.get_io()
        if not self.active:
            self._held = False
            return False
        if imgui.is_key_pressed(imgui.Key.delete) and not io.want_text_input:
            self.delete()
        place = ground_under(camera, terrain, io.mouse_pos, io.display_size)
        if imgui.is_mouse_clicked(0) and not io.want_capture_mouse and place is not None:
            near = self._point_at(camera, terrain)
            self._drawing = near < 0
            if near >= 0:
                self.selected = near
            else:
                self.add(*place, held=True)
            self._held = True
        elif self._held and imgui.is_mouse_down(0):
            moved = io.mouse_delta.x or io.mouse_delta.y
            if place is not None and moved and self._drawing:
                self._draw_to(*place)
            elif place is not None and moved:
                self.change(x=place[0], z=place[1])
        else:
            self._held = False
        return True

    def _draw_to(self, x: float, z: float) -> None:
        """Another point where the mouse has gone far enough from the last one."""
        last = self.points[-1]
        if math.hypot(x - last.x, z - last.z) >= DRAWN_M:
            self.add(x, z, held=True)

    def _point_at(self, camera: Camera, terrain: Terrain) -> int:
        """The point under the mouse; -1 for none."""
        io, best = imgui.get_io(), (GRAB_PX * imgui.get_style().font_scale_dpi, -1)
        for i, point in enumerate(self.points):
            where = np.array([point.x, float(terrain.height(point.x, point.z)), point.z])
            shown = on_screen(camera, where, io.display_size)
            if shown is not None:
                away = math.hypot(shown[0] - io.mouse_pos.x, shown[1] - io.mouse_pos.y)
                best = min(best, (away, i))
        return best[1]

    # --- walking

    def start(self) -> None:
        """Lead the character along the path from where it stands."""
        from runtime.motion.control_scripts import PointPath

        if self.points:
            self.walk = PointPath(self.points).walk_from(self._place)
            self._time_s, self._begun = 0.0, True

    def stop(self) -> None:
        """Give the stick back."""
        self.walk = None

    def walk_began(self) -> bool:
        """Whether a walk began since the last call."""
        begun, self._begun = self._begun, False
        return begun

    @property
    def _place(self) -> PlanarPose:
        pose = self.scene.simulation.current
        return PlanarPose(float(pose.root_position[0]), float(pose.root_position[2]), pose.root_yaw)

    def controls(self, own: Controls, dt: float) -> Controls:
        """The path's stick while it is walked; any stick of the user ends the walk."""
        walk = self.walk
        if walk is None or any(own.move):
            self.walk = None
            return own
        stick = walk(self._time_s, self._place)
        self._time_s += dt
        if walk.ended:
            self.walk = None
            self.editor.messages.note(
                "The path is walked." if walk.arrived else "Path crosses unwalkable ground."
            )
        return stick


def ground_under(
    camera: Camera, terrain: Terrain, mouse: imgui.ImVec2, size: imgui.ImVec2
) -> tuple[float, float] | None:
    """X and Z (metres) of the ground under a screen position; None for the sky."""
    across, up = 2.0 * mouse.x / max(size.x, 1.0) - 1.0, 1.0 - 2.0 * mouse.y / max(size.y, 1.0)
    view, half = camera.view_matrix().astype(float), camera.half_height
    ray = -view[2, :3] + (across - camera.shift) * half * size.x / max(size.y, 1.0) * view[0, :3]
    ray = ray + (up - camera.shift_up) * half * view[1, :3]
    eye = np.asarray(camera.position, float)
    along = np.geomspace(0.2, REACH_M, RAY_STEPS)
    points = eye + along[:, None] * ray
    above = points[:, 1] - terrain.height(points[:, 0], points[:, 2])
    below = np.flatnonzero(above < 0.0)
    if len(below) == 0 or below[0] == 0:
        return None
    k = int(below[0])
    share = above[k - 1] / (above[k - 1] - above[k])
    x, _, z = points[k - 1] + share * (points[k] - points[k - 1])
    return float(x), float(z)


def on_screen(camera: Camera, point: np.ndarray, size: imgui.ImVec2) -> tuple[float, float] | None:
    """Where a point `(3,)` shows, in screen units; None behind the camera."""
    matrix = camera.projection_matrix(size.x / max(size.y, 1.0)) @ camera.view_matrix()
    x, y, _, w = (float(v) for v in matrix @ np.array([*point, 1.0]))
    return ((0.5 + 0.5 * x / w) * size.x, (0.5 - 0.5 * y / w) * size.y) if w > 0.0 else None
