"""What is drawn around the pose of a take: ghosts of other frames, and trails of its joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from viewer.render.overlays import TrailOverlay
from viewer.session.playback import Playback

GHOSTS = 3  # before the frame shown, and as many after it
TRAIL_SECONDS = 0.8  # before and after
SPEED_SECONDS = 0.05  # over which a speed is measured
JOINTS = tuple(
    SPORT_SKELETON.index(name) for name in ("LeftHand", "RightHand", "LeftFoot", "RightFoot", "Head", "Hips")
)


def ghosts(playback: Playback, every: int) -> list[Pose]:
    """Return the poses at every so many frames around the one shown, within the trim marks; none too near to it."""
    frame = playback.frame
    centre = round(frame / every)
    numbers = [k * every for k in range(centre - GHOSTS, centre + GHOSTS + 1)]
    return [
        playback.pose_at(number)
        for number in numbers
        if playback.first <= number <= playback.last and abs(number - frame) >= 0.5 * every
    ]


@dataclass
class Trails:
    """Trails of one clip; its kinematics are computed once."""

    _clip: Clip | None = None
    _points: NDArray[np.floating] | None = None  # (T, J, 3)

    def around(self, playback: Playback) -> TrailOverlay:
        """Return the trails of the frames around the one shown."""
        clip = playback.clip
        if self._points is None or self._clip is not clip:
            self._clip, self._points = clip, clip.world()[0][:, JOINTS]
        reach = max(round(TRAIL_SECONDS * clip.fps), 1)
        first = max(playback.frame - reach, playback.first, 0)
        last = min(playback.frame + reach, playback.last, len(clip) - 1)
        points = self._points[first : last + 1]
        return TrailOverlay(points, speeds(points, clip.fps), playback.frame - first)


def speeds(points: NDArray[np.floating], fps: float) -> NDArray[np.floating]:
    """Return speeds `(T, J)` in metres per second of points `(T, J, 3)`, by differences over `SPEED_SECONDS`."""
    if len(points) < 2:
        return np.zeros(points.shape[:2])
    half = max(round(0.5 * SPEED_SECONDS * fps), 1)
    at = np.arange(len(points))
    before, after = np.maximum(at - half, 0), np.minimum(at + half, len(points) - 1)
    apart = np.linalg.norm(points[after] - points[before], axis=-1)
    return np.asarray(apart * fps / (after - before)[:, None])
