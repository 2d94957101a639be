"""The camera in the user's hands: follow or orbit, rotated by stick, keys and mouse."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from sport.runtime.pose import Pose
from sport.runtime.terrain.height_map import Terrain
from sport.viewer.render.camera import FollowCamera, OrbitCamera

CHEST_SHARE = 0.55  # of the way from the ground to the hips' height: keeps the whole body in view
ORBIT_PIXELS_PER_SECOND = 420.0  # what a full stick is worth in the orbit camera
SHIFT_HALF_LIFE = 0.08  # seconds
JUMP_DISTANCE_M = 3.0  # a target that moves farther in one frame was set there: no glide


@dataclass
class CameraControl:
    """Both cameras and which one is in use; switching keeps the view."""

    mode: str = "follow"
    follow: FollowCamera = field(default_factory=FollowCamera)
    orbit: OrbitCamera = field(default_factory=OrbitCamera)
    _framing: tuple[float, float, float] | None = None

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
        if isinstance(new, FollowCamera):
            new.snap(old.target)

    def frame_in(self, framing: tuple[float, float, float], dt: float) -> None:
        """Glide to the place (-1 left to 1 right, -1 bottom to 1 top) and the share of the height that panels leave free."""
        share = 1.0 - 0.5 ** (dt / SHIFT_HALF_LIFE)
        old = framing if self._framing is None else self._framing
        right, up, fit = (a + (b - a) * share for a, b in zip(old, framing, strict=True))
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
            self.orbit.orbit(look[0] * ORBIT_PIXELS_PER_SECOND * dt, -look[1] * ORBIT_PIXELS_PER_SECOND * dt)
            return
        target = np.array(self.target(pose))
        if math.dist(target, self.follow.target) > JUMP_DISTANCE_M:
            self.follow.snap(target)
        align = pose.root_yaw if moving else None
        self.follow.update(target, dt, look, terrain, align)

    @staticmethod
    def target(pose: Pose) -> tuple[float, float, float]:
        """What the camera looks at: between the feet and the chest."""
        ground, hips = float(pose.root_position[1]), float(pose.hips_position[1])
        height = ground + max(hips - ground, 0.4) * 2 * CHEST_SHARE * 0.85
        return float(pose.hips_position[0]), height, float(pose.hips_position[2])
