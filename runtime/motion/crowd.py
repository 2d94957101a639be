"""Many characters on one stick: each moves as its own `Controller` would, bit by bit, at a fraction of the time.

Their states are one state with more rows; every second network runs on a thread of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from runtime.controls import Controls
from runtime.errors import UsageError
from runtime.motion.controller import Controller
from runtime.motion.frame import step
from runtime.pose import Pose
from runtime.records import joined, part
from runtime.terrain.height_map import Terrain

MOST = 64  # characters


class Crowd:
    """Steps controllers of one model on one ground together; each keeps its own style, seed, strength and place.

    UsageError for none, for more than MOST, and for controllers of several models or grounds.
    """

    def __init__(self, members: Sequence[Controller]) -> None:
        if not 1 <= len(members) <= MOST:
            raise UsageError(f"Crowd: {len(members)} characters; expected 1 to {MOST}.", "Take fewer.")
        if any(m.model is not members[0].model or m.terrain is not members[0].terrain for m in members):
            raise UsageError("Crowd: characters of several models or grounds.", "Give all the same.")
        self.members = tuple(members)
        self._helper = ThreadPoolExecutor(1, "crowd")

    def close(self) -> None:
        """End the second thread."""
        self._helper.shutdown()

    @property
    def terrain(self) -> Terrain:
        """The ground of all."""
        return self.members[0].terrain

    def set_terrain(self, terrain: Terrain) -> None:
        """Let all stand on another ground, where they are."""
        for member in self.members:
            member.set_terrain(terrain)

    def step(self, controls: Controls) -> list[Pose]:
        """Simulate 1/60 s of every character; see `Controller.step`."""
        members = self.members
        state, frame = step(
            members[0].model,
            joined([member.state for member in members]),
            [controls] * len(members),
            self.terrain,
            [member.temperature for member in members],
            [member.response for member in members],
            self._helper,
        )
        return [member.take(part(state, i), frame.part(i)) for i, member in enumerate(members)]
