"""Options of a film, and its cameras by name."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from runtime.errors import UsageError
from runtime.motion import features
from runtime.pose import Pose
from runtime.takes.camera_keys import CameraKey, view_at
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from viewer.render.camera import FOV_Y_RAD, Camera, FollowCamera, looked_at

CameraPath = Callable[[Pose], Camera]  # called once per frame, in order

MIN_SIDE, MAX_SIDE = 16, 4096
# height of the characters that the shots are designed for; the camera steps back from taller ones
USUAL_CHARACTER_HEIGHT_M = 1.9
ORBIT_RAD_PER_S = math.radians(24.0)  # per second
MAX_PITCH_RAD = math.radians(70.0)
CLEARANCE_M = 0.3  # of a still camera above the ground


@dataclass(frozen=True)
class Shot:
    """A camera that moves with the character: `turn` radians from its facing, plus `orbit` radians per second.

    With `fixed` the turn is from +Z, whatever the facing.
    """

    turn: float
    pitch: float
    distance: float
    orbit: float = 0.0
    fixed: bool = False


SHOTS = {  # titles are in `runtime.formats.options.CAMERAS`
    "front": Shot(2.7, 0.16, 4.1),
    "follow": Shot(0.0, 0.22, 4.0),
    "side": Shot(0.5 * math.pi, 0.12, 3.9),
    "orbit": Shot(2.7, 0.2, 4.2, ORBIT_RAD_PER_S),
}
STILL = "still"  # stands where it sees the whole path
KEYED = "keyed"  # as the take's camera keys; in the window only
VIEW = "view"  # as `FilmOptions.view`: as in the window, moving with the character
CAMERAS = (*SHOTS, STILL)


@dataclass(frozen=True)
class FilmOptions:
    """Options of a film; `fps` is the film's frame rate, independent of the take's."""

    width: int = 1280
    height: int = 720
    fps: float = 30.0
    camera: str = "front"  # one of `CAMERAS`
    distance: float = 0.0  # metres of the camera, 0 for the default
    captions: bool = True
    quality: str = "high"  # or "software": faster without a graphics card
    view: Shot | None = None  # of the camera "view"
    fov_degrees: float = 0.0  # field of view from bottom to top; 0 for the usual one
    keys: tuple[CameraKey, ...] = ()  # of the camera "keyed", in the time of the film

    def check(self) -> None:
        """Raise UsageError for the first invalid option."""
        if not 1.0 <= self.fps <= 60.0:
            raise UsageError(f" {self.fps:g}: a film has 1 to 60.", "Try 30.", "fps")
        if not all(MIN_SIDE <= side <= MAX_SIDE for side in self.size):
            raise UsageError(
                f" {self.width}x{self.height}: expected {MIN_SIDE} to {MAX_SIDE} pixels a side.",
                "Try 1280x720.",
                "size",
            )
        if not (self.fov_degrees == 0.0 or 5.0 <= self.fov_degrees <= 120.0):
            raise UsageError(f" {self.fov_degrees:g}: expected 5 to 120 degrees.", "Try 38.", "fov_degrees")
        if not (self.distance == 0.0 or 0.5 <= self.distance <= 60.0):
            raise UsageError(f" {self.distance:g}: expected 0.5 to 60 m.", "Try 4.", "distance")
        shown = {VIEW: self.view is not None, KEYED: bool(self.keys)}
        if not shown.get(self.camera, self.camera in CAMERAS):
            raise UsageError(
                f" {self.camera[:40]}: there is no such camera.", f"Choose {', '.join(CAMERAS)}.", "camera"
            )

    @property
    def size(self) -> tuple[int, int]:
        return self.width, self.height


def camera_path(options: FilmOptions, clip: Clip, terrain: Terrain, height: float = 0.0) -> CameraPath:
    """Return the camera of a film by name, for a character `height` metres tall; UsageError lists the names."""
    options.check()
    path = _path_by_name(options, clip, terrain, max(1.0, height / USUAL_CHARACTER_HEIGHT_M))

    def see(pose: Pose) -> Camera:
        camera = path(pose)
        camera.fov_y = math.radians(options.fov_degrees) or FOV_Y_RAD
        return camera

    return see


def _path_by_name(options: FilmOptions, clip: Clip, terrain: Terrain, size: float) -> CameraPath:
    name = options.camera
    if name == STILL:
        camera = _still(options, clip, terrain, size)
        return lambda _: camera
    if name == KEYED:
        return _keyed(options, clip, terrain)
    if name == VIEW and options.view is not None:
        return _moving(options.view, options, clip, terrain, size)
    return _moving(SHOTS[name], options, clip, terrain, size)


def _moving(shot: Shot, options: FilmOptions, clip: Clip, terrain: Terrain, size: float) -> CameraPath:
    frame = 0

    def aim(pose: Pose) -> float:
        facing = 0.0 if shot.fixed else float(features.facing_yaw(pose.positions))
        return facing + shot.turn + shot.orbit * frame / options.fps

    first = clip.sample(0.0)
    away = options.distance or (shot.distance if shot.fixed else size * shot.distance)
    camera = FollowCamera(looked_at(first.hips_position, terrain, size), aim(first), shot.pitch, away)

    def see(pose: Pose) -> Camera:
        nonlocal frame
        yaw = aim(pose)
        if shot.orbit:
            camera.yaw = yaw
        target = looked_at(pose.hips_position, terrain, size)
        camera.update(target, 1.0 / options.fps, terrain=terrain, align_yaw=yaw)
        frame += 1
        return camera

    return see


def _keyed(options: FilmOptions, clip: Clip, terrain: Terrain) -> CameraPath:
    """Return a camera that moves along and follows the keys."""
    follow = FollowCamera(looked_at(clip.sample(0.0).hips_position, terrain))
    frame = 0

    def see(pose: Pose) -> Camera:
        nonlocal frame
        key = view_at(options.keys, frame / options.fps)
        frame += 1
        follow.update(looked_at(pose.hips_position, terrain), 1.0 / options.fps)
        return Camera(follow.target + np.array([key.x, key.y, key.z]), key.yaw, key.pitch, key.distance)

    return see


def _still(options: FilmOptions, clip: Clip, terrain: Terrain, size: float) -> Camera:
    """Return a camera at the side of the path, far enough away to see all of it, and high enough to see over the ground."""
    path = np.asarray(clip.hips_positions, np.float64)
    low, high = path.min(axis=0), path.max(axis=0)
    target = looked_at(0.5 * (low + high), terrain, size)
    along = path[-1] - path[0]
    yaw = math.atan2(along[0], along[2]) + 0.5 * math.pi
    across = math.hypot(high[0] - low[0], high[2] - low[2]) + 1.6
    tangent = 2.0 * math.tan(FOV_Y_RAD / 2)
    away = options.distance or max(across * options.height / options.width, 2.4 * size) / tangent
    camera = Camera(target, yaw, 0.14, away)
    while camera.pitch < MAX_PITCH_RAD and not _clear(camera, terrain):
        camera.pitch += 0.03
    return camera


def _clear(camera: Camera, terrain: Terrain) -> bool:
    points = camera.target + np.linspace(0.3, 1.0, 24)[:, None] * (camera.position - camera.target)
    return bool(np.all(points[:, 1] > terrain.height(points[:, 0], points[:, 2]) + CLEARANCE_M))
