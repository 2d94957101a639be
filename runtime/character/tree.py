"""A joint hierarchy in its rest pose, with its chains, leaves and extents."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from runtime.arrays import AnyArray


class JointTree:
    """Joints by index with their parents (-1 at roots) and positions `(K, 3)`, Y up."""

    def __init__(self, parents: Sequence[int], positions: AnyArray) -> None:
        self.parents = tuple(parents)
        self.positions = np.asarray(positions, np.float64)
        self.children: list[list[int]] = [[] for _ in self.parents]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.children[parent].append(joint)

    @cached_property
    def order(self) -> list[int]:
        """Parents before their children."""
        order = [joint for joint, parent in enumerate(self.parents) if parent < 0]
        for joint in order:  # which grows meanwhile
            order.extend(self.children[joint])
        return order

    @cached_property
    def ends(self) -> list[int]:
        """Joints that carry no other."""
        return [joint for joint, children in enumerate(self.children) if not children]

    @cached_property
    def heights(self) -> list[int]:
        """For each joint how many joints lie on its longest way down."""
        below = [0] * len(self.parents)
        for joint in reversed(self.order):
            below[joint] = max((below[child] + 1 for child in self.children[joint]), default=0)
        return below

    @cached_property
    def floor(self) -> float:
        """Height of the lowest joint."""
        return float(self.positions[:, 1].min())

    @cached_property
    def size(self) -> float:
        """Height of the joints, from the lowest to the highest one."""
        return max(float(np.ptp(self.positions[:, 1])), 1e-9)

    def under(self, joint: int) -> list[int]:
        """A joint and all that hang on it."""
        found = [joint]
        for each in found:
            found.extend(self.children[each])
        return found

    def chain(self, top: int, tip: int) -> list[int]:
        """The joints from `top` down to `tip`, both included."""
        above = self.ancestors(tip)
        return above[above.index(top) :: -1]

    def lowest(self, top: int) -> int:
        """The lowest end of a branch."""
        ends = [joint for joint in self.under(top) if not self.children[joint]]
        return min(ends, key=lambda joint: float(self.positions[joint, 1]))

    def ancestors(self, joint: int) -> list[int]:
        """A joint and those above it, the root last."""
        found = [joint]
        while self.parents[found[-1]] >= 0:
            found.append(self.parents[found[-1]])
        return found

    def meeting(self, a: int, b: int) -> int:
        """The lowest joint above both, -1 where they hang on different roots."""
        above = set(self.ancestors(a))
        return next((joint for joint in self.ancestors(b) if joint in above), -1)

    def distance(self, a: int, b: int) -> float:
        """Return the distance between two joints."""
        return float(np.linalg.norm(self.positions[a] - self.positions[b]))

    def along(self, chain: Sequence[int]) -> AnyArray:
        """Return the distance of each joint of a chain from its first one, along the chain."""
        steps = np.linalg.norm(np.diff(self.positions[list(chain)], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])
