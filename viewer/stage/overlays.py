"""What the toggles of the scene panel mean for the renderer."""

from __future__ import annotations

import numpy as np

from sport.viewer.render.overlays import Overlays, PathOverlay, TrajectoryOverlay
from sport.viewer.services import ControllerLike
from sport.viewer.settings import Settings

PAST_SAMPLES = 6  # of the 12 of the trajectory: one second back, then the present and one second ahead


def make_overlays(
    settings: Settings, controller: ControllerLike | None, path: PathOverlay | None = None
) -> Overlays:
    """Overlays of the live character; without a controller there is no trajectory."""
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
    )
