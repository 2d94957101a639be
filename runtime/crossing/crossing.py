"""The state of one character's crossing, and the motion that its numbers describe.

Over bars, gaps and low steps the legs follow a plan for one stride (`leap`) while the network goes on. Before a wall or a
deep drop the character stops, and climbs (`climb`). What lies ahead is found in `look`, a crossing begins in `decide` and is
shown in `play`. Its frame is that of its obstacle: z along the way, 0 at the near edge; x to the left, 0 under the root; y
over the ground before it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from runtime.arrays import Array
from runtime.crossing.climb import Climb, Descend
from runtime.crossing.leap import Leap, LeapStart
from runtime.crossing.steps import PlannedSteps
from runtime.terrain.way_ahead import ObstacleKind

KINDS = ("", *(kind.value for kind in ObstacleKind), "climb", "descend")
HIGHEST_CLIMB_M = 1.5
PACE = (0.85, 1.2)  # of the root in the steps before a leap, so that a foot comes down at its edge
MOST_SIGHT, FASTEST_SIGHT = 1.5, 20.0  # that the spring comes to, where it is turned round on its way
TEMPO = (0.7, 1.2)  # of a climb


@lru_cache(maxsize=64)
def _motion(kind: str, numbers: tuple[float, ...]) -> Leap | Climb | Descend:
    """The motion that these numbers describe: made again after a snapshot is put back."""
    if kind == "climb":
        return Climb(*numbers)
    if kind == "descend":
        return Descend(*numbers)
    length, top, beyond, start, speed, seconds, elapsed, stance, hips = numbers[:9]
    points = np.array(numbers[9:])
    stride = LeapStart(
        start, speed, seconds, elapsed, int(stance), points[:6].reshape(2, 3), points[6:].reshape(2, 4), hips
    )
    return Leap(ObstacleKind(kind), length, top, beyond, stride)


@dataclass
class Crossing:
    """State of one character's crossing, from frame to frame."""

    kind: str = field(default="", metadata={"choices": KINDS})  # of the crossing under way
    stopped: bool = False  # before ground that it neither walks on nor crosses
    pace: float = 1.0  # of the root on its way to a leap
    numbers: tuple[float, ...] = ()  # that describe the motion
    time: float = 0.0
    origin: Array = field(default_factory=lambda: np.zeros(3), metadata={"whole": (3,)})
    yaw: float = 0.0
    fresh: bool = False  # its first pose is still to tell the two offsets
    hips_offset: Array = field(default_factory=lambda: np.zeros(3), metadata={"whole": (3,)})
    offset: Array = field(
        default_factory=lambda: np.zeros((31, 3)), metadata={"whole": (31, 3)}
    )  # rotation vectors
    last_z: float = 0.0
    sight: float = 1.0  # share of the ground's heights that the network sees: none of them in a crossing
    sight_velocity: float = 0.0  # its change, 1/s
    steps: PlannedSteps = field(default_factory=PlannedSteps)

    @property
    def facing(self) -> float | None:
        """The yaw in which it climbs."""
        return self.yaw if self.climbing else None

    @property
    def climbing(self) -> bool:
        """Whether it goes up or down by itself, whatever the stick says."""
        return self.kind in ("climb", "descend")

    @property
    def motion(self) -> Leap | Climb | Descend:
        """What is crossed by; only while there is a `kind`."""
        return _motion(self.kind, self.numbers)

    @property
    def rise(self) -> float:
        """Of the ground behind the obstacle, m."""
        return self.numbers[0] if self.climbing else self.numbers[2]


def is_possible(crossing: Crossing) -> bool:
    """Whether the numbers of a crossing that was read from a file describe one of its kind."""
    numbers = crossing.numbers
    if not (abs(crossing.sight) <= MOST_SIGHT and abs(crossing.sight_velocity) <= FASTEST_SIGHT):
        return False
    if any(abs(number) > 100.0 for number in numbers) or not PACE[0] <= crossing.pace <= PACE[1]:
        return False
    if not crossing.kind:
        return True
    if crossing.climbing:
        upwards = 1.0 if crossing.kind == "climb" else -1.0
        return (
            len(numbers) == 4
            and 0.0 < upwards * numbers[0] <= HIGHEST_CLIMB_M
            and TEMPO[0] <= numbers[3] <= TEMPO[1]
        )
    if len(numbers) != 23:
        return False
    _, _, _, _, speed, seconds, elapsed, stance, _ = numbers[:9]
    return speed >= 0.0 and 0.1 <= seconds <= 10.0 and 0.0 <= elapsed < seconds and stance in (0.0, 1.0)
