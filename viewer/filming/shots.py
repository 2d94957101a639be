"""Cameras of films by name: what each frame is seen from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from runtime.errors import UsageError
from runtime.motion import features
from runtime.pose import Pose
from runtime.takes.camera_keys import CameraKey, view_at
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from viewer.render.camera import FOV_Y, Camera, FollowCamera, looked_at

CameraPath = Callable[[Pose], Camera]  # called once for each frame, in their order

USUAL_HEIGHT_M = 1.9  # of characters that the shots are for; from a taller one the camera steps back
ORBIT_SPEED = math.radians(24.0)  # per second
MAX_PITCH = math.radians(70.0)
CLEARANCE_M = 0.3  # of a still camera over the ground


@dataclass(frozen=True)
class ShotView:
    """A direction to look from (radians) and the distance (metres)."""

    yaw: float
    pitch: float
    distance: float


@dataclass(frozen=True)
class Shot:
    """A camera that goes with the character: `turn` radians from its facing, `orbit` radians a second on top of that."""

    turn: float
    pitch: float
    distance: float
    orbit: float = 0.0


SHOTS = {
    "front": Shot(2.7, 0.16, 4.1),
    "follow": Shot(0.0, 0.22, 4.0),
    "side": Shot(0.5 * math.pi, 0.12, 3.9),
    "orbit": Shot(2.7, 0.2, 4.2, ORBIT_SPEED),
}
STILL = "still"  # stands where it sees the whole way
KEYED = "keyed"  # as the keys of the take show it; of the window alone
VIEW = "view"  # as the window shows the character, going along with it; of the window alone
CAMERAS = (*SHOTS, STILL)


def camera_path(
    name: str,
    clip: Clip,
    terrain: Terrain,
    fps: float,
    aspect: float,
    distance: float = 0.0,
    height: float = 0.0,
    view: ShotView | None = None,
    fov: float = 0.0,
    keys: Sequence[CameraKey] = (),
) -> CameraPath:
    """The camera `name` of `CAMERAS` for a clip of a character of a `height`; `distance` in metres, 0 for its usual one.

    `view` is that of the camera `VIEW`, `keys` those of `KEYED`, `fov` the field of view from bottom to top in radians, 0 for the usual one.
    UsageError lists the names.
    """
    if name == KEYED and keys:
        path = _keyed(keys, clip, terrain, fps)
    else:
        path = _camera_path(name, clip, terrain, fps, aspect, distance, height, view)
    if fov == 0.0:
        return path

    def with_lens(pose: Pose) -> Camera:
        camera = path(pose)
        camera.fov_y = fov
        return camera

    return with_lens


def _camera_path(
    name: str,
    clip: Clip,
    terrain: Terrain,
    fps: float,
    aspect: float,
    distance: float,
    height: float,
    view: ShotView | None,
) -> CameraPath:
    size = max(1.0, height / USUAL_HEIGHT_M)
    if name == STILL:
        camera = _still(clip, terrain, aspect, distance, size)
        return lambda _: camera
    if name == VIEW and view is not None:
        return _along(view, clip, terrain, fps, distance, size)
    if name not in SHOTS:
        raise UsageError(f" {name[:40]}: there is no such camera.", f"Choose {', '.join(CAMERAS)}.", "camera")
    return _moving(SHOTS[name], clip, terrain, fps, distance, size)


def _moving(shot: Shot, clip: Clip, terrain: Terrain, fps: float, distance: float, size: float) -> CameraPath:
    first = clip.sample(0.0)
    camera = FollowCamera(
        looked_at(first.hips_position, terrain, size),
        float(features.facing_yaw(first.positions)) + shot.turn,
        shot.pitch,
        distance or size * shot.distance,
    )
    seconds = 0.0

    def next_camera(pose: Pose) -> Camera:
        nonlocal seconds
        yaw = float(features.facing_yaw(pose.positions)) + shot.turn + shot.orbit * seconds
        if shot.orbit:
            camera.yaw = yaw
        camera.update(looked_at(pose.hips_position, terrain, size), 1.0 / fps, terrain=terrain, align_yaw=yaw)
        seconds += 1.0 / fps
        return camera

    return next_camera


def _along(
    view: ShotView, clip: Clip, terrain: Terrain, fps: float, distance: float, size: float
) -> CameraPath:
    """A camera that keeps its direction and goes along."""
    first = looked_at(clip.sample(0.0).hips_position, terrain, size)
    camera = FollowCamera(first, view.yaw, view.pitch, distance or view.distance)

    def next_camera(pose: Pose) -> Camera:
        camera.update(looked_at(pose.hips_position, terrain, size), 1.0 / fps, terrain=terrain)
        return camera

    return next_camera


def _keyed(keys: Sequence[CameraKey], clip: Clip, terrain: Terrain, fps: float) -> CameraPath:
    """A camera that goes along and looks as the keys say."""
    follow = FollowCamera(looked_at(clip.sample(0.0).hips_position, terrain))
    frame = 0

    def next_camera(pose: Pose) -> Camera:
        nonlocal frame
        key = view_at(keys, frame / fps)
        frame += 1
        follow.update(looked_at(pose.hips_position, terrain), 1.0 / fps)
        return Camera(follow.target + np.array([key.x, key.y, key.z]), key.yaw, key.pitch, key.distance)

    return next_camera


def _still(clip: Clip, terrain: Terrain, aspect: float, distance: float, size: float) -> Camera:
    """A camera beside the way, far enough to see all of it, high enough to look over the ground between."""
    path = np.asarray(clip.hips_positions, np.float64)
    low, high = path.min(axis=0), path.max(axis=0)
    target = looked_at(0.5 * (low + high), terrain, size)
    along = path[-1] - path[0]
    yaw = math.atan2(along[0], along[2]) + 0.5 * math.pi
    across = math.hypot(high[0] - low[0], high[2] - low[2]) + 1.6
    tangent = math.tan(FOV_Y / 2)
    away = distance or max(across / (2.0 * tangent * aspect), 2.4 * size / (2.0 * tangent))
    camera = Camera(target, yaw, 0.14, away)
    while camera.pitch < MAX_PITCH and not _clear(camera, terrain):
        camera.pitch += 0.03
    return camera


def _clear(camera: Camera, terrain: Terrain) -> bool:
    points = camera.target + np.linspace(0.3, 1.0, 24)[:, None] * (camera.position - camera.target)
    return bool(np.all(points[:, 1] > terrain.height(points[:, 0], points[:, 2]) + CLEARANCE_M))
