"""What the toggles of the scene panel mean for the renderer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runtime.motion.controller import Controller
from runtime.pose import Pose
from viewer.render.overlays import Figure, Overlays, PathOverlay, PinOverlay, TrailOverlay, TrajectoryOverlay
from viewer.settings import Settings

PAST_SAMPLES = 6  # of the 12 of the trajectory: one second back, then the present and one second ahead


def make_overlays(
    settings: Settings,
    controller: Controller | None,
    path: PathOverlay | None = None,
    others: Sequence[Pose] = (),
    ghosts: Sequence[Pose] = (),
    trails: TrailOverlay | None = None,
    pins: PinOverlay | None = None,
    figure: Figure | None = None,
    frames: Sequence[Pose] = (),
) -> Overlays:
    """Overlays of the live character; without a controller there is no trajectory. `others` are drawn beside it.

    `ghosts` are translucent, `trails` the lines of its joints, `pins` the points it is bent to,
    `figure` somebody of another mesh, `frames` ghosts of it at other times.
    """
    trajectory = None
    if settings.show_trajectory and controller is not None:
        view = controller.trajectory
        past = np.arange(len(view.positions)) < PAST_SAMPLES
        trajectory = TrajectoryOverlay(view.positions, view.directions, past)
    return Overlays(
        trajectory=trajectory,
        show_trajectory=trajectory is not None,
        show_skeleton=settings.show_skeleton,
        show_contacts=settings.show_contacts,
        show_grid=settings.show_grid,
        path=path,
        extra_poses=list(others),
        ghosts=list(ghosts),
        frames=list(frames),
        trails=trails,
        pins=pins,
        figure=figure,
    )
