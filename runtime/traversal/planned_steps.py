"""Timing of landings, strides and speed of a body approaching an obstacle, updated every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import hypot

import numpy as np

from runtime.arrays import Array
from runtime.feet.ik import LEG_FEET
from runtime.pose import DT, Pose

MIN_LANDING_S = 0.08  # minimum time to the next landing: a step may be slower than the last ones
SETTING_OFF_SPEED_M_PER_S = 0.3  # slower, the first steps are short and quick
STRIDE_RANGE_S = (0.5, 2.2)  # of a stride of two steps
WALK_STRIDE_S = 1.05  # of a stride in a neutral walk,
JOG_STRIDE_S = 0.75  # and in a jog,
MIN_JOG_SPEED_M_PER_S = 1.8  # which is faster than this
MIN_STRIDE_S = 0.25  # between two landings of the same foot
SAME_FOOT_STRIDE_FRACTION = 0.8  # of a stride, after which the same foot may land twice in a row
VELOCITY_SMOOTHING_FRACTION = 0.15  # weight of a frame in the mean velocity
SPEED_SMOOTHING_FRACTION = 0.05  # weight of a frame in the mean speed
STRIDE_RATIO_RANGE = (0.6, 1.6)  # of the previous stride: other ratios result from a missed landing
MIN_STEP_M, MAX_SPEED_M_PER_S = 0.15, 6.0
TRAILING_M = 0.05  # behind the root: a foot landing farther back is the trailing one, held again
STRIDE_SMOOTHING_FRACTION = 0.6  # weight of a new stride in the mean
MAX_FIRST_STRIDE_RATIO = 1.5  # of the usual one: a slower first step says nothing about the stride


@dataclass
class PlannedSteps:
    """Timing of foot landings, strides and speed, carried from frame to frame."""

    # the foot that landed last: 0 left, 1 right
    stance: int | None = field(default=None, metadata={"most": 1})
    elapsed: float = 0.0  # seconds since then
    seconds: float = WALK_STRIDE_S  # of a stride
    measured: bool = False  # whether `seconds` was measured
    speed: float = 0.0  # of the root, m/s, smoothed, at full pace
    # of the root, m/s, smoothed
    velocity: Array = field(default_factory=lambda: np.zeros(2), metadata={"whole": (2,)})
    ahead: float = 0.2  # m of the last landing ahead of the root
    stood: tuple[bool, bool] = (True, True)  # which feet stood in the last frame
    since: tuple[float, float] = (9.0, 9.0)  # seconds since each foot landed
    root: Array | None = field(default=None, metadata={"whole": (2,)})  # position (XZ) in the last frame

    @property
    def length(self) -> float:
        """Step length (metres) at full pace."""
        return max(0.5 * self.speed * self.seconds, MIN_STEP_M)

    def watch(self, pose: Pose, held: Sequence[object], way: Array | None, pace: float) -> bool:
        """Update with a frame and return whether a foot landed; `held` tells which feet stand, `way` (XZ) is the path."""
        x, _, z = pose.root_position.tolist()
        if self.root is not None:
            last_x, last_z = self.root.tolist()
            way_x, way_z = (x - last_x) / DT, (z - last_z) / DT
            velocity = np.array((way_x, way_z))
            self.velocity = self.velocity + (velocity - self.velocity) * VELOCITY_SMOOTHING_FRACTION
            self.speed += (
                min(hypot(way_x, way_z) / pace, MAX_SPEED_M_PER_S) - self.speed
            ) * SPEED_SMOOTHING_FRACTION
        self.root = np.array((x, z))
        self.elapsed += DT
        self.since = (self.since[0] + DT, self.since[1] + DT)
        fresh = [k for k in (0, 1) if held[k] and not self.stood[k] and self._comes_down(k)]
        self.stood = (bool(held[0]), bool(held[1]))
        for foot in fresh:
            ankle = pose.positions[LEG_FEET[foot]]
            ahead = 0.0 if way is None else float((ankle[0] - x) * way[0] + (ankle[2] - z) * way[1])
            if ahead > -TRAILING_M:
                self._landed(foot, ahead)
                return True
        return False

    def _comes_down(self, foot: int) -> bool:
        """Whether a newly held foot has landed, rather than been released for a moment."""
        again = SAME_FOOT_STRIDE_FRACTION * self.seconds if foot == self.stance else MIN_STRIDE_S
        return self.since[foot] > again

    def _landed(self, foot: int, ahead: float) -> None:
        stride = self.since[foot]
        if STRIDE_RANGE_S[0] < stride < STRIDE_RANGE_S[1] and (
            not self.measured or STRIDE_RATIO_RANGE[0] < stride / self.seconds < STRIDE_RATIO_RANGE[1]
        ):
            self.seconds = (
                stride
                if not self.measured
                else self.seconds + STRIDE_SMOOTHING_FRACTION * (stride - self.seconds)
            )
            self.measured = self.speed > SETTING_OFF_SPEED_M_PER_S
        elif not self.measured:
            step = self.since[1 - foot]
            guess = JOG_STRIDE_S if self.speed > MIN_JOG_SPEED_M_PER_S else WALK_STRIDE_S
            self.seconds = (
                2.0 * step if STRIDE_RANGE_S[0] < 2.0 * step < MAX_FIRST_STRIDE_RATIO * guess else guess
            )
        self.stance, self.elapsed, self.ahead = foot, 0.0, max(ahead, 0.0)
        self.since = (0.0, self.since[1]) if foot == 0 else (self.since[0], 0.0)

    def ankle(self, pose: Pose, way: Array) -> float:
        """Return the distance (metres) along `way` from the root to the stance ankle."""
        joint, root = pose.positions[LEG_FEET[self.stance or 0]], pose.root_position
        return float((joint[0] - root[0]) * way[0] + (joint[2] - root[2]) * way[1])

    def next_ankle(self, pace: float) -> float:
        """Return the distance (metres) from the current root to the predicted landing of the next ankle."""
        return self.speed * pace * max(0.5 * self.seconds - self.elapsed, MIN_LANDING_S) + self.ahead

    def after_leap(self, stance: int) -> None:
        """Reset the timing after a leap whose stance foot lands now, half a stride after the other one."""
        self.root = None
        self.stood = (stance != 0, stance != 1)
        times = (self.seconds, 0.5 * self.seconds)
        self.since = (times[stance], times[1 - stance])
