"""Orbit and follow cameras: pure numpy, angles in radians, lengths in metres, smoothing as half-lives in seconds.

Yaw is the heading of the view direction about +Y (0 looks along +Z, positive turns towards +X);
pitch is how far the view looks down. Cameras are right-handed, OpenGL clip space.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Array
from runtime.easing import spring
from runtime.terrain.height_map import PointHeights, Terrain

FOV_Y_RAD = math.radians(38.0)
LOOK_HEIGHT_M = 0.86  # of the target above the ground
NEAR_M = 0.1
FAR_M = 300.0
ORBIT_RAD_PER_PX = 0.006
FOOT_M, STANDING_M = 0.15, 2.0  # a foot above the ground, and the highest target on a character
MAX_LIFT_FRACTION = 0.6  # of the distance, to see feet behind a step
ZOOM_STEP_FACTOR = 0.88
STICK_TURN_RAD_PER_S = 2.6  # radians per second at full stick
STICK_TILT_RAD_PER_S = 1.6
TARGET_HALF_LIFE_S = 0.09  # seconds, horizontal
TARGET_HEIGHT_HALF_LIFE_S = 0.20  # slower, so that stairs do not shake the view
STICK_HALF_LIFE_S = 0.05
STICK_REST_RADIUS = 0.02  # dead zone: a stick this close to its centre is at rest
ALIGN_HALF_LIFE_S = 1.1
LIFT_HALF_LIFE_S = 0.10
_BEFORE_FEET, _ON_BOOM = np.linspace(0.15, 0.9, 16), np.linspace(0.25, 1.0, 12)  # of the way to the eye
OPENING_HALF_LIFE_S = 0.35  # of the turn out of an opening view, once the character walks
GROUND_CLEARANCE_M = 0.35
ORBIT_CLEARANCE_M = 0.08  # an orbit camera may look at feet from near the ground


def look_at(eye: Array, target: Array) -> Array:
    """Return the view matrix `(4, 4)` of a camera at `eye` that looks at `target`, with +Y up."""
    back = np.asarray(eye, float) - target
    back = back / max(float(np.linalg.norm(back)), 1e-9)
    right = np.cross((0.0, 1.0, 0.0), back)
    right = right / max(float(np.linalg.norm(right)), 1e-9)
    view = np.eye(4)
    view[:3, :3] = right, np.cross(back, right), back
    view[:3, 3] = -view[:3, :3] @ eye
    return view.astype(np.float32)


def looked_at(hips: Array, terrain: Terrain, size: float = 1.0) -> Array:
    """Return the camera's target `(3,)` for hips `(3,)`: above the ground under them, so that steps do not shake it.

    The body is `size` times as tall as ours.
    """
    x, _, z = (float(value) for value in hips)
    return np.array([x, float(terrain.height(x, z)) + size * LOOK_HEIGHT_M, z])


def perspective(fov_y: float, aspect: float, near: float, far: float) -> Array:
    """Return the OpenGL projection matrix `(4, 4)`; `fov_y` in radians, `aspect` is width / height."""
    f = 1.0 / math.tan(fov_y / 2)
    m = np.zeros((4, 4), np.float32)
    m[0, 0], m[1, 1] = f / aspect, f
    m[2, 2], m[2, 3], m[3, 2] = (far + near) / (near - far), 2 * far * near / (near - far), -1.0
    return m


@dataclass(eq=False)
class Camera:
    """A camera's view: target, direction, distance and field of view."""

    target: Array = field(default_factory=lambda: np.array([0.0, 0.9, 0.0]))
    yaw: float = math.pi
    pitch: float = 0.2
    distance: float = 4.5
    fov_y: float = FOV_Y_RAD
    # screen position of the target, -1 (left, bottom) to 1, and the fraction of the window's height that the view fills:
    # panels may cover a side, and a timeline the ground
    shift: float = 0.0
    shift_up: float = 0.0
    fit: float = 1.0

    def __post_init__(self) -> None:
        self.target = np.array(self.target, float)

    @property
    def forward(self) -> Array:
        """Unit vector `(3,)` from the camera, before any lift, to the target."""
        c = math.cos(self.pitch)
        return np.array([math.sin(self.yaw) * c, -math.sin(self.pitch), math.cos(self.yaw) * c])

    @property
    def heading(self) -> float:
        """Yaw (radians) of the forward direction for the controls."""
        return self.yaw

    @property
    def half_height(self) -> float:
        """Half the height (metres) visible at a distance of one metre."""
        return math.tan(self.fov_y / 2) / self.fit

    @property
    def position(self) -> Array:
        return self.target - self.distance * self.forward

    def view_matrix(self) -> Array:
        return look_at(self.position, self.target)

    def projection_matrix(self, aspect: float) -> Array:
        """Return the projection matrix `(4, 4)` from camera to clip space, for `aspect` = width / height."""
        projection = perspective(2 * math.atan(self.half_height), aspect, NEAR_M, FAR_M)
        projection[:2, 2] = -self.shift, -self.shift_up
        return projection


class OrbitCamera(Camera):
    """A camera that orbits a fixed target; the mouse rotates, pans and zooms it."""

    MIN_PITCH, MAX_PITCH = math.radians(-20.0), math.radians(88.0)
    MIN_DISTANCE, MAX_DISTANCE = 0.6, 60.0
    CLEARANCE_M = ORBIT_CLEARANCE_M
    _lift_m: Array = np.zeros(())
    _lift_velocity: Array = np.zeros(())

    @property
    def position(self) -> Array:
        """Camera position `(3,)` in metres, raised if the ground would hide the target."""
        return super().position + np.array([0.0, float(self._lift_m), 0.0])

    def orbit(self, dx_px: float, dy_px: float) -> None:
        """Rotate the view by a mouse drag in pixels: right turns the scene to the right, down shows it from above."""
        self.yaw = math.remainder(self.yaw - dx_px * ORBIT_RAD_PER_PX, math.tau)
        pitch = self.pitch + dy_px * ORBIT_RAD_PER_PX
        self.pitch = min(max(pitch, self.MIN_PITCH), self.MAX_PITCH)

    def pan(self, dx_px: float, dy_px: float, viewport_height_px: float) -> None:
        """Move the target in the view plane by a mouse drag in pixels, so that points at its depth follow the pointer."""
        metres = 2.0 * self.distance * self.half_height / max(viewport_height_px, 1.0)
        right, up = self.view_matrix()[:2, :3].astype(float)
        self.target = self.target + (-dx_px * right + dy_px * up) * metres

    def zoom(self, steps: float) -> None:
        """Zoom by wheel steps; positive is closer."""
        distance = self.distance * ZOOM_STEP_FACTOR**steps
        self.distance = min(max(distance, self.MIN_DISTANCE), self.MAX_DISTANCE)

    def _lift_over_feet(self, terrain: Terrain) -> float:
        """Return how far (metres) the eye rises so that steps of the ground do not hide the feet under the target."""
        x, y, z = (float(v) for v in self.target)
        foot = PointHeights(terrain).height(x, z) + FOOT_M
        if y - foot > STANDING_M:  # no character stands at the target
            return 0.0
        eye = super().position
        way = _BEFORE_FEET
        over = terrain.height(x + way * (eye[0] - x), z + way * (eye[2] - z)) + FOOT_M / 3
        lift = (over - foot - way * (eye[1] - foot)) / way
        return min(float(np.max(lift)), MAX_LIFT_FRACTION * self.distance)

    def keep_above(self, terrain: Terrain | None, dt: float) -> None:
        """Raise the camera smoothly until no ground is between it and the target."""
        goal = 0.0
        if terrain is not None:
            points = self.target - _ON_BOOM[:, None] * self.distance * self.forward
            ground = terrain.height(points[:, 0], points[:, 2]) + self.CLEARANCE_M
            goal = max(0.0, float(np.max((ground - points[:, 1]) / _ON_BOOM)), self._lift_over_feet(terrain))
        self._lift_m, self._lift_velocity = spring(
            self._lift_m, self._lift_velocity, np.array(goal), LIFT_HALF_LIFE_S, dt
        )
        if terrain is not None:  # never inside the ground, however fast it rises
            x, y, z = self.position.tolist()
            floor = PointHeights(terrain).height(x, z) + 0.3 * self.CLEARANCE_M
            self._lift_m = self._lift_m + max(0.0, floor - y)


@dataclass(eq=False)
class FollowCamera(OrbitCamera):
    """Follows a moving target with critically damped springs, rotated by the right stick, kept above the terrain."""

    MIN_PITCH, MAX_PITCH = math.radians(-10.0), math.radians(75.0)
    MIN_DISTANCE, MAX_DISTANCE = 1.5, 15.0
    CLEARANCE_M = GROUND_CLEARANCE_M

    yaw: float = 0.0
    pitch: float = 0.22
    distance: float = 4.0
    _target_velocity: Array = field(default_factory=lambda: np.zeros(3))
    _turn: Array = field(default_factory=lambda: np.zeros(2))  # yaw and pitch speed, radians per second
    _turn_velocity: Array = field(default_factory=lambda: np.zeros(2))
    _opening: float = 0.0  # radians by which an opening view is turned from behind the character

    @property
    def heading(self) -> float:
        """Yaw (radians) of the forward direction for the controls; during an opening view it is the character's."""
        return self.yaw - self._opening

    def open_at(self, heading: float, turn: float) -> None:
        """Start with an opening view `turn` radians off `heading`; when the character walks, the camera moves behind it."""
        self._opening = turn
        self.yaw = math.remainder(heading + turn, math.tau)

    def orbit(self, dx_px: float, dy_px: float) -> None:
        """Rotate the view by a mouse drag in pixels, which ends an opening view."""
        self._opening = 0.0 if dx_px else self._opening
        super().orbit(dx_px, dy_px)

    def snap(self, target: Array) -> None:
        """Jump to a target without smoothing, such as after a reset."""
        self.target = np.array(target, float)
        self._target_velocity = np.zeros(3)

    def update(
        self,
        target: Array,
        dt: float,
        stick: tuple[float, float] = (0.0, 0.0),
        terrain: Terrain | None = None,
        align_yaw: float | None = None,
    ) -> None:
        """Advance by `dt` seconds.

        `target` `(3,)` is the point to follow, `stick` the right stick (x right, y up, -1..1), `terrain` the ground to
        stay above, `align_yaw` a heading to turn to slowly while the stick is at rest (None: keep the heading).
        """
        half_life = np.array([TARGET_HALF_LIFE_S, TARGET_HEIGHT_HALF_LIFE_S, TARGET_HALF_LIFE_S])
        self.target, self._target_velocity = spring(
            self.target, self._target_velocity, np.asarray(target, float), half_life, dt
        )
        self._turn_by_stick(stick, dt)
        if align_yaw is not None and math.hypot(*stick) < STICK_REST_RADIUS:
            self._align(align_yaw, dt)
        self.keep_above(terrain, dt)

    def _turn_by_stick(self, stick: tuple[float, float], dt: float) -> None:
        if abs(stick[0]) >= STICK_REST_RADIUS:
            self._opening = 0.0
        goal = np.array([-stick[0] * STICK_TURN_RAD_PER_S, -stick[1] * STICK_TILT_RAD_PER_S])
        self._turn, self._turn_velocity = spring(self._turn, self._turn_velocity, goal, STICK_HALF_LIFE_S, dt)
        self.yaw = math.remainder(self.yaw + float(self._turn[0]) * dt, math.tau)
        self.pitch = min(max(self.pitch + float(self._turn[1]) * dt, self.MIN_PITCH), self.MAX_PITCH)

    def _align(self, yaw: float, dt: float) -> None:
        if self._opening:
            step = self._opening * (1.0 - 0.5 ** (dt / OPENING_HALF_LIFE_S))
            step = step if abs(self._opening) > 0.01 else self._opening
            self._opening -= step
            self.yaw = math.remainder(self.yaw - step, math.tau)
            return
        difference = math.remainder(yaw - self.yaw, math.tau)
        fraction = 1.0 - 0.5 ** (dt / ALIGN_HALF_LIFE_S)
        # sin: a character walking straight at the camera must not spin it round
        self.yaw = math.remainder(self.yaw + fraction * math.sin(difference), math.tau)
