"""Mouse handles in the view: points dragged in the plane facing the camera or on the ground, and rotation rings."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.terrain.height_map import Terrain
from viewer.editor import Editor
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.widgets import px
from viewer.render.camera import Camera

GRAB_PX = 15.0  # at scale 1: distance at which a click takes a point
REACH_M = 80.0  # range of the mouse on the ground
RAY_STEPS = 400


@dataclass
class Handles:
    """Tracks which of several points the left button drags."""

    held: int = -1  # -1 for none
    pressed: bool = False  # in this frame, outside the panels

    def use_mouse(self, editor: Editor, camera: Camera, points: Array) -> bool:
        """Grab the nearest of `points` `(n, 3)` or release it; return whether a grabbed point is dragged in this frame."""
        io = imgui.get_io()
        self.pressed = imgui.is_mouse_clicked(0) and not io.want_capture_mouse
        if self.pressed:
            editor.begin_drag(self)
            self.held = _nearest(camera, points, io.mouse_pos, io.display_size)
        elif editor.dragger is not self or not imgui.is_mouse_down(0):
            self.held = -1
        return self.held >= 0 and not self.pressed and bool(io.mouse_delta.x or io.mouse_delta.y)


def _nearest(camera: Camera, points: Array, mouse: imgui.ImVec2, size: imgui.ImVec2) -> int:
    shown = [on_screen(camera, point, size) for point in points]
    away = [np.inf if at is None else np.hypot(at[0] - mouse.x, at[1] - mouse.y) for at in shown]
    best = int(np.argmin(away)) if away else -1
    return best if best >= 0 and away[best] <= GRAB_PX * imgui.get_style().font_scale_dpi else -1


def dragged(camera: Camera, point: Array) -> Array:
    """Return the point `(3,)` moved with the mouse, at the same distance from the camera."""
    io, view = imgui.get_io(), camera.view_matrix().astype(float)
    depth = -(view @ np.array([*point, 1.0]))[2]
    metres = 2.0 * camera.half_height * depth / max(io.display_size.y, 1.0)
    return np.asarray(point + metres * (io.mouse_delta.x * view[0, :3] - io.mouse_delta.y * view[1, :3]))


def ground_under(
    camera: Camera, terrain: Terrain, mouse: imgui.ImVec2, size: imgui.ImVec2
) -> tuple[float, float] | None:
    """Return X and Z (metres) of the ground under a screen position, or None for the sky."""
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
    """Return the screen position of a point `(3,)`, or None if it is behind the camera."""
    matrix = camera.projection_matrix(size.x / max(size.y, 1.0)) @ camera.view_matrix()
    x, y, _, w = (float(v) for v in matrix @ np.array([*point, 1.0]))
    return ((0.5 + 0.5 * x / w) * size.x, (0.5 - 0.5 * y / w) * size.y) if w > 0.0 else None


RADIUS_WIDTH_FRACTION = 0.055  # of the width of the window
OUTER_RADIUS_RATIO = 1.15  # radius of the ring facing the camera, relative to the others
RING_GRAB_PX = 8.0  # at scale 1: distance at which the mouse takes a ring
ANGLES = np.linspace(0.0, 2.0 * np.pi, 97)
AXES = ((0.90, 0.40, 0.38, 1.0), (0.55, 0.80, 0.42, 1.0), (0.42, 0.62, 0.95, 1.0))  # x, y, z
TINTS = (*AXES, theme.TEXT)
HIDDEN_RADIUS_FRACTION = -0.1  # of the radius: points farther behind the joint are hidden


@dataclass
class Rings:
    """Rotation rings of a gizmo: the dragged ring and the hovered one; -1 for none."""

    held: int = -1
    over: int = -1

    @property
    def used(self) -> bool:
        """Whether the mouse is on a ring or drags one."""
        return max(self.held, self.over) >= 0

    def turn(self, camera: Camera, place: Array, axes: Array) -> Array | None:
        """Draw the rings around `place` (3,) with `axes` as columns (3, 3); return the drag's world rotation (4,), or None."""
        io = imgui.get_io()
        if on_screen(camera, place, io.display_size) is None:
            self.held = self.over = -1
            return None
        to_eye = np.asarray(camera.position, float) - place
        to_eye /= max(float(np.linalg.norm(to_eye)), 1e-6)
        normals = [*np.asarray(axes, float).T, to_eye]
        rings = [_ring(camera, place, normal, to_eye, n == len(AXES)) for n, normal in enumerate(normals)]
        mouse = np.array([io.mouse_pos.x, io.mouse_pos.y])
        away = [np.linalg.norm(ring - mouse, axis=1) for ring in rings]
        self._hold(away)
        self._draw(rings)
        if self.held < 0 or not (io.mouse_delta.x or io.mouse_delta.y):
            return None
        ring, at = rings[self.held], int(np.nanargmin(away[self.held]))
        along = np.nan_to_num(ring[min(at + 1, len(ring) - 1)] - ring[max(at - 1, 0)])
        along /= max(float(np.linalg.norm(along)), 1e-6)
        angle = float(along @ (io.mouse_delta.x, io.mouse_delta.y)) / (
            RADIUS_WIDTH_FRACTION * io.display_size.x
        )
        return rotations.from_axis_angle(normals[self.held], np.array(angle))

    def _hold(self, away: list[Array]) -> None:
        """Take the ring nearest to the mouse, given its points' distances `away` (n,), or release it."""
        if self.held < 0:
            nearest = int(np.argmin([np.nanmin(distances) for distances in away]))
            near = np.nanmin(away[nearest]) <= RING_GRAB_PX * imgui.get_style().font_scale_dpi
            self.over = nearest if near and not imgui.get_io().want_capture_mouse else -1
            if imgui.is_mouse_clicked(0):
                self.held = self.over
        elif not imgui.is_mouse_down(0):
            self.held = -1

    def _draw(self, rings: list[Array]) -> None:
        drawing, lit = imgui.get_background_draw_list(), max(self.held, self.over)
        for number, (ring, tint) in enumerate(zip(rings, TINTS, strict=True)):
            color = widgets.packed(theme.WARNING if number == lit else tint)
            for a, b in pairwise(ring):
                if not np.isnan(a[0] + b[0]):
                    drawing.add_line(imgui.ImVec2(*a), imgui.ImVec2(*b), color, px(2.5))


def _ring(camera: Camera, place: Array, normal: Array, to_eye: Array, outer: bool) -> Array:
    """Return the screen positions of a ring's points (n, 2); NaN for those behind the joint."""
    size, view = imgui.get_io().display_size, camera.view_matrix().astype(float)
    depth = -(view @ np.array([*place, 1.0]))[2]
    metres = (
        2.0
        * camera.half_height
        * depth
        / max(size.y, 1.0)
        * RADIUS_WIDTH_FRACTION
        * size.x
        * (OUTER_RADIUS_RATIO if outer else 1.0)
    )
    u = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    u /= np.linalg.norm(u)
    offsets = np.cos(ANGLES)[:, None] * u + np.sin(ANGLES)[:, None] * np.cross(normal, u)
    matrix = camera.projection_matrix(size.x / max(size.y, 1.0)) @ view
    points = np.concatenate([place + metres * offsets, np.ones((len(ANGLES), 1))], axis=1) @ matrix.T
    shown = (points[:, :2] / points[:, 3:] * (0.5, -0.5) + 0.5) * (size.x, size.y)
    hidden = (offsets @ to_eye < HIDDEN_RADIUS_FRACTION) | (points[:, 3] <= 0.0)
    hidden &= not outer
    return np.where(hidden[:, None], np.nan, shown)
