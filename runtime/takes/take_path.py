"""The path of a take as waypoints, and resimulation along an edited path.

A take was driven by a stick; along an edited path the stick is computed from the character's position, so that the
network walks it as it would live. Prompts stay at their frames; the take ends with the path.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import hypot

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls, Gait
from runtime.errors import UsageError
from runtime.motion.control_scripts import MAX_POINTS, PlanarPose, PointPath, Waypoint
from runtime.pose import FPS, Pose
from runtime.takes.clip import Clip
from runtime.takes.input_recording import InputFrames, InputRecording, Steppable, started, with_poses
from runtime.takes.metadata import gait_of

WAYPOINT_SPACING_M = 1.5  # between two waypoints of a straight path
MAX_DEVIATION_M = 0.12  # tolerated deviation from the line between two waypoints
MIN_STICK_FRACTION = 0.1  # of the full stick
REST_AT_END_S = 0.75  # after the end of the path
MAX_SECONDS = 600.0
MOVED_M = 0.05  # a shorter distance counts as standing


def path_of(clip: Clip, inputs: InputRecording) -> tuple[Waypoint, ...]:
    """Return the path of a clip as few waypoints, each with the speed and gait on the way to it.

    Raises UsageError if the clip stays in place, or goes farther than a path can.
    """
    path = np.asarray(clip.hips_positions, float)[:, [0, 2]]
    corners = _corners(path)
    points = []
    for a, b in itertools.pairwise(corners):
        stick, gait = _leg([inputs.frame(i).controls for i in range(a, b + 1)])
        points.append(Waypoint(float(path[b, 0]), float(path[b, 1]), stick, gait))
    if not points:
        raise UsageError("This take has no path: the character stands.", "Choose a take that moves.")
    if len(points) > MAX_POINTS:
        raise UsageError(
            f"The path of this take has more than {MAX_POINTS} points.", "Choose a shorter take."
        )
    return tuple(points)


def _leg(frames: Sequence[Controls]) -> tuple[float, Gait]:
    """Return the stick length on a section, and its predominant gait."""
    moving = [c for c in frames if gait_of(c) != Gait.STAND] or frames
    gaits = [c.gait for c in moving if c.gait is not Gait.JUMP] or [Gait.WALK]
    stick = float(np.median([hypot(*c.move) for c in moving]))
    return min(max(stick, MIN_STICK_FRACTION), 1.0), max(set(gaits), key=gaits.count)


def resimulated_along(
    clip: Clip,
    inputs: InputRecording,
    controller: Steppable,
    points: Sequence[Waypoint],
    first: int = 0,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Clip, InputRecording]:
    """Resimulate a take along other waypoints from frame `first` on, bit-identical before; its length may change."""
    place = _place(clip.pose(max(first - 1, 0)))
    walk = PointPath(tuple(points)).walk_from(place)
    pose = clip.pose(max(first - 1, 0))
    requested: list[Controls] = []
    rest = 0

    def stick(number: int, shown: Pose | None) -> Controls | None:
        nonlocal rest, pose
        pose = shown or pose
        if walk.ended:
            rest += 1
        if rest > REST_AT_END_S * FPS or number - first > MAX_SECONDS * FPS:
            return None
        requested.append(walk((number - first) / FPS, _place(pose)))
        progress(min(walk.progress / max(float(walk.ends[-1]), 1e-6), 0.99))
        return requested[-1]

    poses, keyframes = started(inputs, controller, first, stick)
    settings = [inputs.frame(min(first + i, len(inputs) - 1)) for i in range(len(requested))]
    made = (replace(frame, controls=stick) for stick, frame in zip(requested, settings, strict=True))
    frames = inputs.frames[: first - inputs.start] + InputFrames.of(made)
    changes = tuple(change for change in inputs.changes if change.frame < len(frames) + inputs.start)
    again = replace(inputs, frames=frames, changes=changes, keyframes=keyframes)
    return with_poses(clip, again, poses, first), again


def _place(pose: Pose) -> PlanarPose:
    return PlanarPose(float(pose.root_position[0]), float(pose.root_position[2]), pose.root_yaw)


def _corners(path: Array) -> list[int]:
    """Return the waypoints' frames: corners (Ramer 1972, Douglas and Peucker 1973), and points on long straight sections."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    if along[-1] < MOVED_M:
        return [0]
    kept = _bends(path, 0, len(path) - 1)
    corners = [0]
    for a, b in itertools.pairwise(kept):
        parts = max(round((along[b] - along[a]) / WAYPOINT_SPACING_M), 1)
        inner = np.searchsorted(along, np.linspace(along[a], along[b], parts + 1)[1:-1])
        corners += [int(i) for i in inner if i > corners[-1]]
        if b > corners[-1]:
            corners.append(b)
    return corners


def _bends(path: Array, a: int, b: int) -> list[int]:
    if b - a < 2:
        return [a, b]
    line = path[b] - path[a]
    offset = path[a + 1 : b] - path[a]
    length = max(float(np.hypot(*line)), 1e-9)
    fraction = np.clip(offset @ line / length**2, 0.0, 1.0)
    away = np.hypot(*(offset - fraction[:, None] * line).T)
    worst = int(np.argmax(away))
    if away[worst] < MAX_DEVIATION_M:
        return [a, b]
    middle = a + 1 + worst
    return [*_bends(path, a, middle)[:-1], *_bends(path, middle, b)]
