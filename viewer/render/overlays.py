"""Overlay data that the application fills each frame."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.motion.controller import Controller
from runtime.pose import Pose

PAST_SAMPLES = 6  # of the 12 trajectory samples: one second back, then the present and one second ahead


@dataclass(frozen=True)
class TrajectoryOverlay:
    """The controller's trajectory in world space."""

    positions: Array  # (12, 3) metres
    directions: Array  # (12, 2) facing on the XZ plane
    past: NDArray[np.bool_]  # (12,) True for samples that lie behind in time


def trajectory_overlay(controller: Controller) -> TrajectoryOverlay:
    view = controller.trajectory
    return TrajectoryOverlay(view.positions, view.directions, np.arange(len(view.positions)) < PAST_SAMPLES)


@dataclass(frozen=True)
class PathOverlay:
    """The points of a path on the ground; one may be selected."""

    points: Array  # (n, 2) x and z, metres
    selected: int = -1


@dataclass(frozen=True)
class TrailOverlay:
    """Positions of joints over time, with their speeds."""

    points: Array  # (T, J, 3) metres
    speeds: Array  # (T, J) metres per second
    now: int  # which of the T is shown


@dataclass(frozen=True)
class PinOverlay:
    """The points to which hands, feet and gaze are pinned, and their rails."""

    points: Array  # (n, 3) metres
    selected: NDArray[np.bool_]  # (n,)
    rails: Array  # (m, 2, 3)


@dataclass(frozen=True)
class Figure:
    """A character with another mesh: joint `matrices` `(K, 4, 4)`, and a SPORT pose that casts its shadow.

    A `ghost` is translucent; one that is `on_top` is never hidden.
    """

    mesh: Any  # a `SkinnedMesh`
    matrices: Array
    pose: Pose
    ghost: bool = False
    on_top: bool = False

    @property
    def casts(self) -> bool:
        return not (self.ghost or self.on_top)


@dataclass(frozen=True)
class Overlays:
    """The overlays of a frame; the default is the grid alone."""

    trajectory: TrajectoryOverlay | None = None
    show_skeleton: bool = False
    show_contacts: bool = False
    show_grid: bool = True
    path: PathOverlay | None = None
    trails: TrailOverlay | None = None
    pins: PinOverlay | None = None
    ghosts: list[Pose] = field(default_factory=list)  # translucent, for comparison
    # the same at other times: they hide nothing of the character
    frames: list[Pose] = field(default_factory=list)
    extra_poses: list[Pose] = field(default_factory=list)  # drawn like the main character
    figure: Figure | None = None
