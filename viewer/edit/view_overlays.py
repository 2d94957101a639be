"""What is drawn around the pose in view: trajectory, path, pins, ghosts, trails, and what a take is compared with."""

from __future__ import annotations

from dataclasses import dataclass, field

from runtime.motion.controller import Controller
from runtime.pose import Pose
from viewer.edit.ghosts import Trails, ghosts
from viewer.edit.path import PathTool
from viewer.edit.pins import Pins
from viewer.edit.reference import References
from viewer.render.overlays import Figure, Overlays, TrailOverlay, trajectory_overlay
from viewer.session.playback import Playback
from viewer.session.takes import Takes

MEMORY_S = 3.0  # of the live character, for ghosts and trails


@dataclass
class ViewOverlays:
    takes: Takes
    path: PathTool
    pins: Pins
    references: References
    trails: Trails = field(default_factory=Trails)

    def of(self, live: Controller | None, others: list[Pose]) -> Overlays:
        """Return the overlays of one frame; `others` are drawn with the pose, the trajectory only of a `live` character."""
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
        """Return ghosts and trails of the take that plays, or of the last seconds of the live character alone."""
        settings, around = self.takes.settings, playback
        if around is None and (settings.show_ghosts or settings.show_trails) and not others:
            around = self.takes.memory(MEMORY_S)
        if around is None:
            return [], None
        frames = ghosts(around, round(settings.ghost_frames)) if settings.show_ghosts else []
        return frames, self.trails.around(around) if settings.show_trails else None

    def _reference(self, playback: Playback | None, others: list[Pose]) -> tuple[Figure | None, list[Pose]]:
        """Return what the take that plays is compared with: a figure of its own, a ghost over it, or one of the `others`."""
        references = self.references
        pose = None if playback is None else references.pose(playback)
        if playback is None or pose is None:
            return None, []
        figure = references.figure(playback, pose)
        if figure is not None or references.reference.over:
            return figure, [] if figure is not None else [pose]
        others.append(pose)
        return None, []
