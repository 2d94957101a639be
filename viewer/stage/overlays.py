"""What the toggles of the scene panel mean for the renderer."""

from __future__ import annotations

import numpy as np
from sport.viewer.render.overlays import Overlays, TrajectoryOverlay
from sport.viewer.state import AppState

PAST_SAMPLES = 6  # of the 12 of the trajectory: one second back, then the present and one second ahead


def make_overlays(state: AppState) -> Overlays:
    """Overlays of the live character; a clip that plays has no trajectory."""
    settings, controller = state.settings, state.simulation.controller
    trajectory = None
    if settings.show_trajectory and state.clips.playback is None and controller is not None:
        view = controller.trajectory
        past = np.arange(len(view.positions)) < PAST_SAMPLES
        trajectory = TrajectoryOverlay(view.positions, view.directions, past)
    return Overlays(
        trajectory=trajectory,
        show_trajectory=trajectory is not None,
        show_skeleton=settings.show_skeleton,
        show_contacts=settings.show_contacts,
        show_grid=settings.show_grid,
    )
