"""Camera control: follow or orbit, named views, rotation by stick, keys and mouse."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.easing import spring
from runtime.pose import Pose
from runtime.terrain.height_map import Terrain
from viewer.gl_bindings import imgui
from viewer.input.bindings import NAVIGATION, Drag
from viewer.render.camera import TARGET_HALF_LIFE_S, TARGET_HEIGHT_HALF_LIFE_S, FollowCamera, OrbitCamera

CHEST_HEIGHT_FRACTION = 0.55  # of the hips' height above the ground: keeps the whole body in view
ORBIT_PX_PER_S = 420.0  # mouse movement equivalent to a full stick in the orbit camera
SHIFT_HALF_LIFE_S = 0.08  # seconds
JUMP_DISTANCE_M = 3.0  # a target that moves farther in one frame was placed there, without gliding
FRAME_DISTANCE_M = 4.0  # the whole body with margins
POINT_DISTANCE_M = 1.6  # a hand or a foot with its limb
ZOOM_STEP_PX = 40.0  # per step of a zooming drag
BUTTONS = ("left", "right", "middle")  # as ImGui counts them
# radians from the character's back: behind it if obstacles are ahead, else three quarters from the front
OBSTACLE_TURN_RAD, OPENING_TURN_RAD = -0.62, math.pi - 0.72
NEAR_M, FAR_M, STEP_M = 1.0, 15.0, 0.25  # distances where obstacles are looked for
DIRECTIONS = 16
MIN_CLIMB_M = 0.15  # total height change along the path; less is level
_TRACKING = np.array([TARGET_HALF_LIFE_S, TARGET_HEIGHT_HALF_LIFE_S, TARGET_HALF_LIFE_S])


@dataclass(frozen=True)
class StageView:
    """A named view: `turn` radians from the character's facing, towards a point `height` metres above the ground (0: the body)."""

    turn: float
    pitch: float
    distance: float
    height: float = 0.0


VIEWS = {  # in the order of `viewer.input.bindings.VIEW_ACTIONS`; titles are in `viewer.settings`
    "front": StageView(math.pi, 0.10, 4.0),
    "side": StageView(-0.5 * math.pi, 0.10, 4.0),
    "three_quarters": StageView(math.pi - 0.65, 0.20, 4.0),
    "feet": StageView(-0.5 * math.pi - 0.55, 0.16, 1.7, 0.20),
    "top": StageView(0.0, math.radians(88.0), 5.0),
}


@dataclass
class CameraControl:
    """The follow and the orbit camera, both moving with the character, and which one is in use."""

    mode: str = "follow"
    keyed: bool = False  # the view follows the take's camera keys, until the user moves it
    follow: FollowCamera = field(default_factory=FollowCamera)
    orbit: OrbitCamera = field(default_factory=OrbitCamera)
    _framing: tuple[float, float, float] | None = None
    _tracked: NDArray[np.floating] | None = None  # where the orbit camera follows the character, `(3,)`
    _tracked_velocity: NDArray[np.floating] = field(default_factory=lambda: np.zeros(3))

    @property
    def current(self) -> OrbitCamera:
        return self.follow if self.mode == "follow" else self.orbit

    def use(self, mode: str) -> None:
        """Switch to "follow" or "orbit" without changing the view."""
        self.keyed = False
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

    def open_at(self, pose: Pose, yaw: float, obstacles: bool) -> None:
        """Show the character from the front, or from behind if there are `obstacles` ahead, as at the start."""
        camera = self.current
        camera.target = np.array(self.target(pose))
        self._tracked = None
        if isinstance(camera, FollowCamera):
            camera.snap(camera.target)
            camera.open_at(yaw, OBSTACLE_TURN_RAD if obstacles else OPENING_TURN_RAD)
        else:
            camera.yaw = yaw

    def lose_track(self) -> None:
        """Keep the orbit camera in place because the character was moved elsewhere."""
        self._tracked = None

    def view(self, view: StageView, pose: Pose) -> None:
        """Show the character from a named view; the orbit camera then moves with it."""
        self.use("orbit")
        orbit = self.orbit
        orbit.yaw = math.remainder(pose.root_yaw + view.turn, math.tau)
        orbit.pitch, orbit.distance = view.pitch, view.distance
        orbit.target, self._tracked = np.array(self.target(pose)), None
        if view.height:
            orbit.target[1] = float(pose.root_position[1]) + view.height

    def frame_character(self, pose: Pose) -> None:
        """Centre the whole character from the current direction."""
        camera, self.keyed = self.current, False
        camera.target, camera.distance, self._tracked = np.array(self.target(pose)), FRAME_DISTANCE_M, None
        if isinstance(camera, FollowCamera):
            camera.snap(camera.target)

    def frame_point(self, point: NDArray[np.floating]) -> None:
        """Centre a point `(3,)` close up; the orbit camera then moves with the character."""
        self.use("orbit")
        self.orbit.target, self.orbit.distance, self._tracked = np.array(point, float), POINT_DISTANCE_M, None

    def come_back(self, mode: str, distance: float, pitch: float, pose: Pose) -> None:
        """Return to the character in a camera mode, at a distance (metres) and pitch (radians)."""
        self.use(mode)
        self.current.pitch = pitch
        self.frame_character(pose)
        self.current.distance = distance

    def use_mouse(self, taken: bool, navigation: str = "sport") -> bool:
        """Orbit, pan and zoom with the mouse outside the panels; return whether it is dragging.

        `taken`: the left button is in use. `navigation` is one of `bindings.NAVIGATION`.
        """
        io = imgui.get_io()
        if io.want_capture_mouse:
            return False
        size, mouse = io.display_size, io.mouse_pos
        if io.mouse_wheel:
            self.zoom_at(io.mouse_wheel, mouse.x, mouse.y, size.x, size.y)
        drag = _drag_of(NAVIGATION[navigation], taken)
        # the movement before the press is not part of the drag
        begins = any(imgui.is_mouse_clicked(button) for button in range(3))
        if drag is Drag.ZOOM and not begins:
            self.current.zoom(-io.mouse_delta.y / ZOOM_STEP_PX)
        elif drag is not None and not begins:
            self.drag(io.mouse_delta.x, io.mouse_delta.y, drag is Drag.PAN, size.y)
        return drag is not None

    def zoom_at(self, steps: float, x: float, y: float, width: float, height: float) -> None:
        """Zoom by wheel steps; the orbit camera keeps the point under the mouse at `x`, `y` in place."""
        camera = self.current
        before = camera.distance
        camera.zoom(steps)
        if self.mode == "orbit":
            away = 1.0 - before / camera.distance  # offset of the pointer from the target on the screen
            dx, dy = x - (0.5 + 0.5 * camera.shift) * width, y - (0.5 - 0.5 * camera.shift_up) * height
            self.orbit.pan(dx * away, dy * away, height)

    def frame_in(self, framing: tuple[float, float, float], dt: float) -> None:
        """Shift and scale the view smoothly to the area free of panels: centre (-1 left to 1 right, -1 bottom to 1 top) and height fraction."""
        fraction = 1.0 - 0.5 ** (dt / SHIFT_HALF_LIFE_S)
        old = framing if self._framing is None else self._framing
        right, up, fit = (a + (b - a) * fraction for a, b in zip(old, framing, strict=True))
        self._framing = right, up, fit
        camera = self.current
        camera.shift, camera.shift_up, camera.fit = right, up, fit

    def drag(self, dx: float, dy: float, pan: bool, height: float) -> None:
        """Rotate the camera by a mouse drag in pixels, or with `pan` move the orbit camera; `height` is that of the view."""
        if dx or dy:
            self.use("orbit" if pan else self.mode)
        if pan:
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
        """Advance the camera by `dt` seconds towards the pose."""
        self.current.zoom(zoom_steps)
        if self.mode == "orbit":
            self._track(np.array(self.target(pose)), dt)
            self.orbit.keep_above(terrain, dt)
            self.orbit.orbit(look[0] * ORBIT_PX_PER_S * dt, -look[1] * ORBIT_PX_PER_S * dt)
            return
        target = np.array(self.target(pose))
        if math.dist(target, self.follow.target) > JUMP_DISTANCE_M:
            self.follow.snap(target)
        align = pose.root_yaw if moving else None
        self.follow.update(target, dt, look, terrain, align)

    def _track(self, target: NDArray[np.floating], dt: float) -> None:
        """Move the orbit camera's target with the character, keeping its offset."""
        old = target if self._tracked is None else self._tracked
        if self._tracked is None or math.dist(target, old) > JUMP_DISTANCE_M:
            self._tracked, self._tracked_velocity = target, np.zeros(3)
        else:
            self._tracked, self._tracked_velocity = spring(old, self._tracked_velocity, target, _TRACKING, dt)
        self.orbit.target = self.orbit.target + (self._tracked - old)

    @staticmethod
    def target(pose: Pose) -> tuple[float, float, float]:
        """Return the camera's target on a pose: between the feet and the chest."""
        ground, hips = float(pose.root_position[1]), float(pose.hips_position[1])
        height = ground + max(hips - ground, 0.4) * 2 * CHEST_HEIGHT_FRACTION * 0.85
        return float(pose.hips_position[0]), height, float(pose.hips_position[2])


def _drag_of(table: Mapping[tuple[str, str], Drag], taken: bool) -> Drag | None:
    """Return the action of the held button with the held modifier; `taken`: the left one is in use."""
    io = imgui.get_io()
    modifiers = {"shift": io.key_shift, "ctrl": io.key_ctrl, "alt": io.key_alt}
    modifier = next((name for name, down in modifiers.items() if down), "")
    held = next((BUTTONS[i] for i in range(taken, 3) if imgui.is_mouse_down(i)), "")
    return table.get((held, modifier), table.get((held, "")))


def start_yaw(terrain: Terrain) -> float:
    """Return the yaw (radians) in which a character starts at the origin: +Z, or the direction with most obstacles if +Z has none."""
    yaws = math.tau * np.arange(DIRECTIONS) / DIRECTIONS
    along = np.arange(NEAR_M, FAR_M, STEP_M)
    heights = terrain.height(np.outer(np.sin(yaws), along), np.outer(np.cos(yaws), along))
    climbs = np.abs(np.diff(heights, axis=1)).sum(axis=1)
    best = int(np.argmax(climbs))
    ahead = climbs[0] >= MIN_CLIMB_M or climbs[best] < MIN_CLIMB_M
    return 0.0 if ahead else math.remainder(float(yaws[best]), math.tau)
