"""A path that is drawn on the ground with the mouse and walked by the live character."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from runtime.controls import Controls, Gait
from runtime.motion.paths import PlanarPose
from runtime.terrain.height_map import Terrain
from viewer.gl_bindings import imgui
from viewer.messages import Messages
from viewer.render.camera import Camera
from viewer.render.overlays import PathOverlay

if TYPE_CHECKING:
    from runtime.motion.point_path import PathWalk, Waypoint

GRAB_PX = 16.0  # at scale 1: a click nearer to a point takes it
DRAWN_M = 0.7  # between two points of a path that is drawn by a drag
REACH_M = 80.0  # clicks on ground farther away are none
RAY_STEPS = 400


@dataclass
class PathTool:
    """The points, which of them is selected, and the walk under way."""

    messages: Messages
    active: bool = False  # clicks on the ground set points
    points: list[Waypoint] = field(default_factory=list)
    selected: int = -1
    walk: PathWalk | None = None
    begun: bool = False  # since the last `walk_began`
    drive: Callable[[], None] | None = None  # the points are the way of a take, which this drives again
    _time_s: float = 0.0
    _held: bool = False  # the mouse drags the selected point
    _drawing: bool = False  # the drag began with a new point and sets more

    def overlay(self) -> PathOverlay | None:
        """What is drawn on the ground."""
        if not self.points or not (self.active or self.walk is not None):
            return None
        return PathOverlay(np.array([(p.x, p.z) for p in self.points]), self.selected if self.active else -1)

    # --- points

    def add(self, x: float, z: float) -> None:
        """Another last point, with the speed and gait of the one before."""
        from runtime.motion.point_path import MAX_POINTS, Waypoint

        if len(self.points) < MAX_POINTS:
            before = self.points[-1] if self.points else Waypoint(x, z)
            self.points.append(dataclasses.replace(before, x=x, z=z))
            self.selected = len(self.points) - 1

    def change(self, **values: float | Gait) -> None:
        """Another place, speed or gait for the selected point."""
        if 0 <= self.selected < len(self.points):
            self.points[self.selected] = dataclasses.replace(self.points[self.selected], **values)  # type: ignore[arg-type]

    def delete(self) -> None:
        """Remove the selected point; the one before is selected then."""
        if 0 <= self.selected < len(self.points):
            del self.points[self.selected]
            self.selected = max(self.selected - 1, 0) if self.points else -1

    def clear(self) -> None:
        """Remove every point."""
        self.points.clear()
        self.selected, self.walk = -1, None

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
                self.add(*place)
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
            self.add(x, z)

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

    def start(self, place: PlanarPose) -> None:
        """Lead the character along the path from where it stands."""
        from runtime.motion.point_path import PointPath

        if self.points:
            self.walk, self._time_s, self.begun = PointPath(tuple(self.points)).walk_from(place), 0.0, True

    def stop(self) -> None:
        """Give the stick back."""
        self.walk = None

    def walk_began(self) -> bool:
        """Whether a walk began since the last call."""
        begun, self.begun = self.begun, False
        return begun

    def controls(self, own: Controls, place: PlanarPose, dt: float) -> Controls:
        """The path's stick while it is walked; any stick of the user ends the walk."""
        walk = self.walk
        if walk is None or any(own.move):
            self.walk = None
            return own
        asked = walk(self._time_s, place)
        self._time_s += dt
        if walk.ended:
            self.walk = None
            self.messages.note(
                "The path is walked." if walk.arrived else "The path goes on where nobody can walk."
            )
        return asked


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
