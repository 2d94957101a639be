"""Points in the view that the mouse takes and drags: in the plane that faces the camera, or on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain
from viewer.gl_bindings import imgui
from viewer.render.camera import Camera

GRAB_PX = 15.0  # at scale 1: a click nearer to a point takes it
REACH_M = 80.0  # ground farther away is out of the mouse's reach
RAY_STEPS = 400


@dataclass
class Handles:
    """Which of some points the left button holds."""

    held: int = -1  # -1 for none
    pressed: bool = False  # in this frame, where no panel has the mouse

    def use_mouse(self, camera: Camera, points: Array) -> bool:
        """Take the nearest of `points` `(n, 3)` or let go; whether what is held is moved in this frame."""
        io = imgui.get_io()
        self.pressed = imgui.is_mouse_clicked(0) and not io.want_capture_mouse
        if self.pressed:
            self.held = _nearest(camera, points, io.mouse_pos, io.display_size)
        elif not imgui.is_mouse_down(0):
            self.held = -1
        return self.held >= 0 and not self.pressed and bool(io.mouse_delta.x or io.mouse_delta.y)


def _nearest(camera: Camera, points: Array, mouse: imgui.ImVec2, size: imgui.ImVec2) -> int:
    """Return the point under the mouse; -1 for none."""
    shown = [on_screen(camera, point, size) for point in points]
    away = [np.inf if at is None else np.hypot(at[0] - mouse.x, at[1] - mouse.y) for at in shown]
    best = int(np.argmin(away)) if away else -1
    return best if best >= 0 and away[best] <= GRAB_PX * imgui.get_style().font_scale_dpi else -1


def dragged(camera: Camera, point: Array) -> Array:
    """Return the point `(3,)` moved as the mouse was in this frame, as far from the camera as it is."""
    io, view = imgui.get_io(), camera.view_matrix().astype(float)
    depth = -(view @ np.array([*point, 1.0]))[2]
    metres = 2.0 * camera.half_height * depth / max(io.display_size.y, 1.0)
    return np.asarray(point + metres * (io.mouse_delta.x * view[0, :3] - io.mouse_delta.y * view[1, :3]))


def ground_under(
    camera: Camera, terrain: Terrain, mouse: imgui.ImVec2, size: imgui.ImVec2
) -> tuple[float, float] | None:
    """Return X and Z (metres) of the ground under a screen position; None for the sky."""
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
    fraction = above[k - 1] / (above[k - 1] - above[k])
    x, _, z = points[k - 1] + fraction * (points[k] - points[k - 1])
    return float(x), float(z)


def on_screen(camera: Camera, point: Array, size: imgui.ImVec2) -> tuple[float, float] | None:
    """Return where a point `(3,)` shows, in screen units; None behind the camera."""
    matrix = camera.projection_matrix(size.x / max(size.y, 1.0)) @ camera.view_matrix()
    x, y, _, w = (float(v) for v in matrix @ np.array([*point, 1.0]))
    return ((0.5 + 0.5 * x / w) * size.x, (0.5 - 0.5 * y / w) * size.y) if w > 0.0 else None
