"""Up a wall with hands and feet, and down a drop: key poses for a rise or a fall of 0.55 to 1.5 m."""

from __future__ import annotations

from runtime.arrays import Array
from runtime.crossing.climb_keys import pull_up, step_up
from runtime.crossing.descend_keys import let_down
from runtime.crossing.keyed_motion import KeyedMotion
from runtime.crossing.keyed_pose import CrossingPose

STEP_UP_M = 0.68  # up to which the lead foot steps from the ground onto the top
FARTHEST_END_M = 0.28  # behind the edge, where a climber stands up
LANDING_M = 0.52  # behind the edge, where one who got down stands up


class _Crossing:
    """What climbing up and getting down have in common: a keyed motion at a tempo."""

    def __init__(self, motion: KeyedMotion, tempo: float) -> None:
        self._motion, self._tempo = motion, tempo
        self.seconds = motion.seconds / tempo
        self.end_z = motion.end_z

    def root_z(self, t: float) -> float:
        """Place of the root along z in metres at `t` seconds."""
        return self._motion.root.at(t * self._tempo)[0]

    def pose(self, t: float, hips: Array, local: Array) -> CrossingPose:
        """The pose at `t` seconds; `hips` `(3,)` and `local` `(31, 4)` are the incoming one, root at `root_z(t)`."""
        return self._motion.pose(min(max(t * self._tempo, 0.0), self._motion.seconds), hips, local)


class Climb(_Crossing):
    """Up onto a wall: hands on the edge, a foot on top, stand."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        """`rise` metres up from a root at `start_z` < 0; the wall's top is `depth` thick; `tempo` over 1 is faster."""
        end_z = min(FARTHEST_END_M, 0.5 * depth)
        seconds = 1.5 + 1.5 * (rise - 0.6)
        make = step_up if rise < STEP_UP_M else pull_up
        super().__init__(make(rise, start_z, end_z, seconds), tempo)


class Descend(_Crossing):
    """Down a drop: squat at the edge, step off, land on bent knees, stand."""

    def __init__(self, rise: float, start_z: float, depth: float, tempo: float = 1.0) -> None:
        """`rise` < 0 is the drop in metres, from a root at `start_z` < 0; `depth` is not used; `tempo` over 1 is faster."""
        super().__init__(let_down(-rise, start_z, LANDING_M), tempo)
