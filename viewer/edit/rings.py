"""Rings around a joint in the view, one an axis and one that faces the camera: the mouse turns the joint along one."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from viewer.edit.handles import on_screen
from viewer.gl_bindings import imgui
from viewer.gui import theme, widgets
from viewer.gui.widgets import px
from viewer.render.camera import Camera

RADIUS_WIDTH_FRACTION = 0.055  # of the width of the window
OUTER_RADIUS_RATIO = 1.15  # of the ring that faces the camera over the others
GRAB_PX = 8.0  # at scale 1, how near to a ring the mouse takes it
ANGLES = np.linspace(0.0, 2.0 * np.pi, 97)
AXES = ((0.90, 0.40, 0.38, 1.0), (0.55, 0.80, 0.42, 1.0), (0.42, 0.62, 0.95, 1.0))  # x, y, z
TINTS = (*AXES, theme.TEXT)
HIDDEN_RADIUS_FRACTION = -0.1  # of the radius: what lies farther behind the joint is hidden


@dataclass
class Rings:
    """Which ring the mouse holds, and which it is over; -1 for none."""

    held: int = -1
    over: int = -1

    @property
    def used(self) -> bool:
        """Whether the left button is in use here, or would be."""
        return max(self.held, self.over) >= 0

    def turn(self, camera: Camera, place: Array, axes: Array) -> Array | None:
        """Draw the rings around `place` (3,), whose `axes` are columns (3, 3); how the mouse turned the held one, (4,) in the world."""
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
        """Take the ring nearest to the mouse, whose points are `away` (n,) from it, or let go."""
        if self.held < 0:
            nearest = int(np.argmin([np.nanmin(distances) for distances in away]))
            near = np.nanmin(away[nearest]) <= GRAB_PX * imgui.get_style().font_scale_dpi
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
    """Return where the points of a ring show (n, 2), in screen units; NaN for those behind the joint."""
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
