"""State of one character's traversal of an obstacle, its probe, and its end.

Over bars, gaps and low steps the legs follow a plan for one stride (`leap`) while the network continues. Before a wall or a
deep drop the character stops, and climbs (`climb`). `plan` starts a traversal, `traversal_frame` shows it, and
`obstacle_probe` finds obstacles. Its frame is that of its obstacle: z along the path, 0 at the near edge; x to the left, 0
under the root; y over the ground before it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from runtime.arrays import Array
from runtime.feet.next_step import SteppedOver
from runtime.pose import DT
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import ObstacleKind
from runtime.traversal.climb import Climb
from runtime.traversal.leap import Leap, LeapStart
from runtime.traversal.obstacle_probe import (
    CLEAR,
    CLIMBING,
    HIGHEST_CLIMB_M,
    ObstacleProbe,
    probe_obstacles,
)
from runtime.traversal.planned_steps import PlannedSteps

KINDS = ("", *(kind.value for kind in ObstacleKind), "climb", "descend")
WALKING_SPEED_M_PER_S = 0.4  # above which the root's own direction counts,
FOLLOWED_FRACTION = 0.7  # with this weight
PACE_RANGE = (0.85, 1.2)  # of the root in the steps before a leap, so that a foot lands at its edge
# of the spring of `sight` when it reverses: fraction, and 1/s
MAX_SIGHT_FRACTION, MAX_SIGHT_CHANGE_PER_S = 1.5, 20.0
MAX_SIZE_M, MAX_NUMBER = 10.0, 100.0  # limits of an obstacle's size; of the numbers that describe it
TEMPO_RANGE = (0.7, 1.2)  # of a climb
STRIDE_RANGE_S = (0.1, 10.0)  # of a leap
CLIMB_NUMBERS, LEAP_NUMBERS = 4, 23  # count of the numbers that describe one


@lru_cache(maxsize=64)
def _motion(kind: str, numbers: tuple[float, ...]) -> Leap | Climb:
    """Return the motion that these numbers describe, also after a snapshot is restored."""
    if kind in ("climb", "descend"):
        return Climb(*numbers)
    length, top, beyond, start, speed, seconds, elapsed, stance, hips = numbers[:9]
    points = np.array(numbers[9:])
    stride = LeapStart(
        start, speed, seconds, elapsed, int(stance), points[:6].reshape(2, 3), points[6:].reshape(2, 4), hips
    )
    return Leap(ObstacleKind(kind), length, top, beyond, stride)


@dataclass
class Traversal:
    """State of one character's traversal, carried from frame to frame."""

    kind: str = field(default="", metadata={"choices": KINDS})  # kind of the traversal in progress
    stopped: bool = False  # before ground that can neither be walked on nor crossed
    pace: float = 1.0  # of the root while approaching a leap
    numbers: tuple[float, ...] = ()  # that describe the motion
    time: float = 0.0
    origin: Array = field(default_factory=lambda: np.zeros(3), metadata={"whole": (3,)})
    yaw: float = 0.0
    fresh: bool = False  # its first pose has yet to set the two offsets
    hips_offset: Array = field(default_factory=lambda: np.zeros(3), metadata={"whole": (3,)})
    # rotation vectors
    offset: Array = field(default_factory=lambda: np.zeros((31, 3)), metadata={"whole": (31, 3)})
    last_z: float = 0.0
    sight: float = 1.0  # fraction of the ground's height variation that the network sees: none in a traversal
    sight_velocity: float = 0.0  # its rate of change, 1/s
    steps: PlannedSteps = field(default_factory=PlannedSteps)
    over: SteppedOver = field(default_factory=SteppedOver, metadata={"later": True})

    @property
    def climbing(self) -> bool:
        """Whether it climbs up or down, regardless of the stick."""
        return self.kind in ("climb", "descend")

    @property
    def motion(self) -> Leap | Climb:
        """The motion of the traversal; only valid while `kind` is set."""
        return _motion(self.kind, self.numbers)

    @property
    def rise(self) -> float:
        """Height of the ground behind the obstacle (metres)."""
        return self.numbers[0] if self.climbing else self.numbers[2]

    def path(self, heading: Array) -> Array:
        """Return the root's path (XZ, a unit vector): a mix of its past velocity, where feet will land, and the stick's `heading`."""
        speed = float(np.linalg.norm(self.steps.velocity))
        if speed < WALKING_SPEED_M_PER_S:
            return heading
        mixed: Array = (1.0 - FOLLOWED_FRACTION) * heading + FOLLOWED_FRACTION * self.steps.velocity / speed
        size = float(np.linalg.norm(mixed))
        return mixed / size if size > 0.5 else heading

    def probe(self, terrain: Terrain | None, place: Array, heading: Array, speed: float) -> ObstacleProbe:
        """Return what lies ahead of a root at `place` (XZ) with the stick at `heading` (XZ); updates whether it has stopped.

        `speed` is the root's, m/s; `terrain` is None if it has no obstacles, or nothing is requested.
        """
        if self.climbing:
            found = CLIMBING
        elif terrain is None or self.over.is_under(float(place[0]), float(place[1])):
            found = CLEAR
        else:
            found = probe_obstacles(terrain, place, self.path(heading), speed, self.stopped)
        self.stopped = found.reason is not None
        return found


def is_possible(traversal: Traversal) -> bool:
    """Return whether a traversal read from a file is valid for its kind."""
    numbers = traversal.numbers
    over, farthest = traversal.over, max(map(abs, numbers), default=0.0)
    seen = abs(traversal.sight) <= MAX_SIGHT_FRACTION
    seen = seen and abs(traversal.sight_velocity) <= MAX_SIGHT_CHANGE_PER_S
    near = max(over.length, abs(over.top), abs(over.rise)) <= MAX_SIZE_M and not farthest > MAX_NUMBER
    if not (seen and near and PACE_RANGE[0] <= traversal.pace <= PACE_RANGE[1]):
        return False
    if not traversal.kind:
        return True
    if traversal.climbing:
        return len(numbers) == CLIMB_NUMBERS and _is_climb_possible(traversal.kind, numbers[0], numbers[3])
    return len(numbers) == LEAP_NUMBERS and _is_leap_possible(*numbers[4:8])


def _is_climb_possible(kind: str, rise: float, tempo: float) -> bool:
    upwards = 1.0 if kind == "climb" else -1.0
    return 0.0 < upwards * rise <= HIGHEST_CLIMB_M and TEMPO_RANGE[0] <= tempo <= TEMPO_RANGE[1]


def _is_leap_possible(speed: float, seconds: float, elapsed: float, stance: float) -> bool:
    return (
        speed >= 0.0
        and STRIDE_RANGE_S[0] <= seconds <= STRIDE_RANGE_S[1]
        and 0.0 <= elapsed < seconds
        and stance in (0.0, 1.0)
    )


def end_when_over(traversal: Traversal) -> bool:
    """End the traversal if the frame just shown was its last; return whether it ended."""
    if traversal.time < traversal.motion.seconds - 0.5 * DT:
        return False
    motion, steps = traversal.motion, traversal.steps
    vars(traversal).update(vars(Traversal(sight=traversal.sight, sight_velocity=traversal.sight_velocity)))
    if isinstance(motion, Leap):
        traversal.steps = steps
        steps.after_leap(motion.stride.stance)
    return True
