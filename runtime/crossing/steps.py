"""The steps of a walker: which foot stands, since when, and where the next one will come down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Array
from runtime.feet.ik import LEG_FEET
from runtime.pose import DT, Pose

SOON_S = 0.08  # the next landing takes at least so long: a step may be slower than the last ones
SETTING_OFF = 0.3  # m/s: slower, the first steps are short and quick
STRIDE_S = (0.5, 2.2)  # seconds that a stride of two steps may take
WALKED_S, JOGGED_S, JOGS = (
    1.05,
    0.75,
    1.8,
)  # of a stride at a neutral walk, and a jog: faster than so many m/s
SHORTEST_S = 0.25  # between two landings of one foot
AGAIN = 0.8  # of a stride, until the same foot may come down twice running
TURNING = 0.15  # share of a frame in the mean velocity
SMOOTHING = 0.05  # share of a frame in the mean speed
SAME = (0.6, 1.6)  # of the stride before: other lengths come of a landing that was missed


@dataclass
class PlannedSteps:
    """Landings of the feet, from frame to frame."""

    stance: int | None = field(
        default=None, metadata={"most": 1}
    )  # the foot that came down last: 0 left, 1 right
    elapsed: float = 0.0  # seconds since then
    seconds: float = WALKED_S  # of a stride
    measured: bool = False  # whether `seconds` was
    speed: float = 0.0  # of the root, m/s, smoothed, at full pace
    velocity: Array = field(
        default_factory=lambda: np.zeros(2), metadata={"whole": (2,)}
    )  # of the root, m/s, smoothed
    ahead: float = 0.2  # m of the last landing before the root
    stood: tuple[bool, bool] = (True, True)  # which feet did in the last frame
    since: tuple[float, float] = (9.0, 9.0)  # seconds since each foot came down
    root: Array | None = field(default=None, metadata={"whole": (2,)})  # place (XZ) in the last frame

    @property
    def length(self) -> float:
        """Metres of a step at full pace."""
        return max(0.5 * self.speed * self.seconds, 0.15)

    def watch(self, pose: Pose, held: Sequence[object], way: Array | None, pace: float) -> bool:
        """Whether a foot came down in this frame; `held` tells which feet stand, `way` (XZ) where the root goes."""
        place = pose.root_position[[0, 2]].astype(np.float64)
        if self.root is not None:
            self.velocity = self.velocity + ((place - self.root) / DT - self.velocity) * TURNING
            speed = float(np.linalg.norm(place - self.root)) / DT / pace
            self.speed += (min(speed, 6.0) - self.speed) * SMOOTHING
        self.root = place
        self.elapsed += DT
        self.since = (self.since[0] + DT, self.since[1] + DT)
        fresh = [k for k in (0, 1) if held[k] and not self.stood[k] and self._comes_down(k)]
        self.stood = (bool(held[0]), bool(held[1]))
        for foot in fresh:
            ankle = pose.positions[LEG_FEET[foot]]
            ahead = (
                0.0 if way is None else float((ankle[0] - place[0]) * way[0] + (ankle[2] - place[1]) * way[1])
            )
            if ahead > -0.05:  # else it is the trailing foot, held again
                self._landed(foot, ahead)
                return True
        return False

    def _comes_down(self, foot: int) -> bool:
        """Whether a foot that is held anew has come down, and was not let go of for a moment."""
        again = AGAIN * self.seconds if foot == self.stance else SHORTEST_S
        return self.since[foot] > again

    def _landed(self, foot: int, ahead: float) -> None:
        stride = self.since[foot]
        if STRIDE_S[0] < stride < STRIDE_S[1] and (
            not self.measured or SAME[0] < stride / self.seconds < SAME[1]
        ):
            self.seconds = stride if not self.measured else self.seconds + 0.6 * (stride - self.seconds)
            self.measured = self.speed > SETTING_OFF
        elif not self.measured:
            step = self.since[1 - foot]
            guess = JOGGED_S if self.speed > JOGS else WALKED_S
            self.seconds = 2.0 * step if STRIDE_S[0] < 2.0 * step < 1.5 * guess else guess
        self.stance, self.elapsed, self.ahead = foot, 0.0, max(ahead, 0.0)
        self.since = (0.0, self.since[1]) if foot == 0 else (self.since[0], 0.0)

    def ankle(self, pose: Pose, way: Array) -> float:
        """Metres along `way` from the root to the ankle that stands."""
        joint, root = pose.positions[LEG_FEET[self.stance or 0]], pose.root_position
        return float((joint[0] - root[0]) * way[0] + (joint[2] - root[2]) * way[1])

    def next_ankle(self, pace: float) -> float:
        """Metres from the root of now to where the next ankle will come down."""
        return self.speed * pace * max(0.5 * self.seconds - self.elapsed, SOON_S) + self.ahead

    def after_leap(self, stance: int) -> None:
        """The stance foot of a leap comes down now: half a stride after the other one."""
        self.root = None
        self.stood = (stance != 0, stance != 1)
        times = (self.seconds, 0.5 * self.seconds)
        self.since = (times[stance], times[1 - stance])
