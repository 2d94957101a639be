"""Overlays around the pose in view: trajectory, path, pins, ghosts, trails, and the reference."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.motion.controller import Controller
from runtime.pose import Pose
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from viewer.edit.path import PathTool
from viewer.edit.pins import Pins
from viewer.edit.reference import References
from viewer.render.overlays import Figure, Overlays, TrailOverlay, trajectory_overlay
from viewer.session.playback import Playback
from viewer.session.takes import Takes

MEMORY_S = 3.0  # history of the live character, for ghosts and trails
GHOSTS = 3  # before the frame shown, and as many after it
TRAIL_SECONDS = 0.8  # before and after the frame shown
SPEED_SECONDS = 0.05  # interval for measuring speeds
JOINTS = tuple(
    SPORT_SKELETON.index(name) for name in ("LeftHand", "RightHand", "LeftFoot", "RightFoot", "Head", "Hips")
)


def ghosts(playback: Playback, every: int) -> list[Pose]:
    """Return the poses of every `every`th frame around the one shown, within the trim, except those too close to it."""
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
    """Computes motion trails of a clip, with its kinematics cached."""

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
    """Return speeds `(T, J)` (m/s) of points `(T, J, 3)`, from differences over `SPEED_SECONDS`."""
    if len(points) < 2:
        return np.zeros(points.shape[:2])
    half = max(round(0.5 * SPEED_SECONDS * fps), 1)
    at = np.arange(len(points))
    before, after = np.maximum(at - half, 0), np.minimum(at + half, len(points) - 1)
    apart = np.linalg.norm(points[after] - points[before], axis=-1)
    return np.asarray(apart * fps / (after - before)[:, None])


@dataclass
class ViewOverlays:
    takes: Takes
    path: PathTool
    pins: Pins
    references: References
    trails: Trails = field(default_factory=Trails)

    def of(self, live: Controller | None, others: list[Pose]) -> Overlays:
        """Return the overlays of a frame; the trajectory only for a `live` character, `others` are further poses to draw."""
        settings, playback = self.takes.settings, self.takes.playback
        frames, trails = self._other_times(playback, others)
        figure, over = self._reference(playback, others)
        return Overlays(
            trajectory=trajectory_overlay(live) if live is not None and settings.show_trajectory else None,
            show_skeleton=settings.show_skeleton,
            show_contacts=settings.show_contacts,
            show_grid=settings.show_grid,
            path=self.path.overlay(),
            trails=trails,
            pins=None if others and playback is None else self.pins.overlay(),
            ghosts=over,
            frames=frames,
            extra_poses=others,
            figure=figure,
        )

    def _other_times(
        self, playback: Playback | None, others: list[Pose]
    ) -> tuple[list[Pose], TrailOverlay | None]:
        """Return ghosts and trails of the playing take, or of the live character's last seconds."""
        settings, around = self.takes.settings, playback
        if around is None and (settings.show_ghosts or settings.show_trails) and not others:
            around = self.takes.memory(MEMORY_S)
        if around is None:
            return [], None
        frames = ghosts(around, round(settings.ghost_frames)) if settings.show_ghosts else []
        return frames, self.trails.around(around) if settings.show_trails else None

    def _reference(self, playback: Playback | None, others: list[Pose]) -> tuple[Figure | None, list[Pose]]:
        """Return the reference of the playing take: a figure of its own, a ghost over it, or one of the `others`."""
        references = self.references
        pose = None if playback is None else references.pose(playback)
        if playback is None or pose is None:
            return None, []
        figure = references.figure(playback, pose)
        if figure is not None or references.reference.over:
            return figure, [] if figure is not None else [pose]
        others.append(pose)
        return None, []
