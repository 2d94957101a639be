"""The camera in the user's hands: follow or orbit, views by name, rotated by stick, keys and mouse."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.easing import spring
from runtime.pose import Pose
from runtime.terrain.height_map import Terrain
from viewer.gl_bindings import imgui
from viewer.render.camera import (
    TARGET_HALF_LIFE,
    TARGET_HEIGHT_HALF_LIFE,
    FollowCamera,
    OrbitCamera,
)
from viewer.scene.views import OPENING_TURN, StageView

CHEST_SHARE = 0.55  # of the way from the ground to the hips' height: keeps the whole body in view
ORBIT_PIXELS_PER_SECOND = 420.0  # what a full stick is worth in the orbit camera
SHIFT_HALF_LIFE = 0.08  # seconds
JUMP_DISTANCE_M = 3.0  # a target that moves farther in one frame was set there: no glide
FRAME_DISTANCE_M = 4.0  # the whole body, with air above and below
_TRACKING = np.array([TARGET_HALF_LIFE, TARGET_HEIGHT_HALF_LIFE, TARGET_HALF_LIFE])


@dataclass
class CameraControl:
    """Both cameras and which one is in use; switching keeps the view. Both go with the character."""

    mode: str = "follow"
    follow: FollowCamera = field(default_factory=FollowCamera)
    orbit: OrbitCamera = field(default_factory=OrbitCamera)
    _framing: tuple[float, float, float] | None = None
    _tracked: NDArray[np.floating] | None = None  # the character as the orbit camera follows it, `(3,)`
    _tracked_velocity: NDArray[np.floating] = field(default_factory=lambda: np.zeros(3))

    @property
    def current(self) -> OrbitCamera:
        """The camera in use."""
        return self.follow if self.mode == "follow" else self.orbit

    def use(self, mode: str) -> None:
        """Switch to "follow" or "orbit" from the same point of view."""
        if mode == self.mode:
            return
        old = self.current
        self.mode = mode
        new = self.current
        new.target = np.array(old.target, float)
        new.yaw, new.pitch, new.distance = old.yaw, old.pitch, old.distance
        self._tracked = None
        if isinstance(new, FollowCamera):
            new.snap(old.target)

    def open_at(self, pose: Pose, yaw: float) -> None:
        """The view of a start: the character from behind and one side, and what lies before it."""
        camera = self.current
        camera.target = np.array(self.target(pose))
        self._tracked = None
        if isinstance(camera, FollowCamera):
            camera.snap(camera.target)
            camera.open_at(yaw, OPENING_TURN)
        else:
            camera.yaw = yaw

    def lose_track(self) -> None:
        """The character was set somewhere else: the orbit camera stays, and goes along from there."""
        self._tracked = None

    def view(self, view: StageView, pose: Pose) -> None:
        """Look at the character from a named place; the orbit camera then goes with it."""
        self.use("orbit")
        orbit = self.orbit
        orbit.yaw = math.remainder(pose.root_yaw + view.turn, math.tau)
        orbit.pitch, orbit.distance = view.pitch, view.distance
        orbit.target, self._tracked = np.array(self.target(pose)), None
        if view.height:
            orbit.target[1] = float(pose.root_position[1]) + view.height

    def frame_character(self, pose: Pose) -> None:
        """Bring the whole character into the middle, from where the camera is."""
        camera = self.current
        camera.target, camera.distance, self._tracked = np.array(self.target(pose)), FRAME_DISTANCE_M, None
        if isinstance(camera, FollowCamera):
            camera.snap(camera.target)

    def come_back(self, mode: str, distance: float, pitch: float, pose: Pose) -> None:
        """The character from a distance (metres) and a pitch (radians) that held before, in a mode, as the camera is turned."""
        self.use(mode)
        self.current.pitch = pitch
        self.frame_character(pose)
        self.current.distance = distance

    def use_mouse(self, taken: bool) -> tuple[float, bool]:
        """Turn and shift by the mouse where no panel has it; wheel steps, and whether it drags. `taken`: the left button is."""
        io = imgui.get_io()
        if io.want_capture_mouse:
            return 0.0, False
        buttons = [imgui.is_mouse_down(button) for button in range(3)]  # left, right, middle
        dragging = any(buttons[taken:])
        begins = any(imgui.is_mouse_clicked(button) for button in range(3))
        if dragging and not begins:  # how the mouse came to where it was pressed is no drag
            pan = buttons[2] or (buttons[1] and io.key_shift)
            self.drag(io.mouse_delta.x, io.mouse_delta.y, pan, io.display_size.y)
        return float(io.mouse_wheel), dragging

    def frame_in(self, framing: tuple[float, float, float], dt: float) -> None:
        """Glide to the place (-1 left to 1 right, -1 bottom to 1 top) and the fraction of the height that panels leave free."""
        fraction = 1.0 - 0.5 ** (dt / SHIFT_HALF_LIFE)
        old = framing if self._framing is None else self._framing
        right, up, fit = (a + (b - a) * fraction for a, b in zip(old, framing, strict=True))
        self._framing = right, up, fit
        camera = self.current
        camera.shift, camera.shift_up, camera.fit = right, up, fit

    def drag(self, dx: float, dy: float, pan: bool, height: float) -> None:
        """Mouse drag in pixels: turns, or with `pan` shifts the orbit camera in a view of this height."""
        if pan and self.mode == "orbit":
            self.orbit.pan(dx, dy, height)
        else:
            self.current.orbit(dx, dy)

    def update(
        self,
        pose: Pose,
        dt: float,
        look: tuple[float, float],
        zoom_steps: float,
        terrain: Terrain,
        moving: bool,
    ) -> None:
        """Advance by `dt` seconds towards the pose."""
        self.current.zoom(zoom_steps)
        if self.mode == "orbit":
            self._track(np.array(self.target(pose)), dt)
            self.orbit.keep_above(terrain, dt)
            self.orbit.orbit(look[0] * ORBIT_PIXELS_PER_SECOND * dt, -look[1] * ORBIT_PIXELS_PER_SECOND * dt)
            return
        target = np.array(self.target(pose))
        if math.dist(target, self.follow.target) > JUMP_DISTANCE_M:
            self.follow.snap(target)
        align = pose.root_yaw if moving else None
        self.follow.update(target, dt, look, terrain, align)

    def _track(self, target: NDArray[np.floating], dt: float) -> None:
        """Move the orbit camera's target, wherever it was put, along with the character."""
        old = target if self._tracked is None else self._tracked
        if self._tracked is None or math.dist(target, old) > JUMP_DISTANCE_M:
            self._tracked, self._tracked_velocity = target, np.zeros(3)
        else:
            self._tracked, self._tracked_velocity = spring(old, self._tracked_velocity, target, _TRACKING, dt)
        self.orbit.target = self.orbit.target + (self._tracked - old)

    @staticmethod
    def target(pose: Pose) -> tuple[float, float, float]:
        """What the camera looks at: between the feet and the chest."""
        ground, hips = float(pose.root_position[1]), float(pose.hips_position[1])
        height = ground + max(hips - ground, 0.4) * 2 * CHEST_SHARE * 0.85
        return float(pose.hips_position[0]), height, float(pose.hips_position[2])
