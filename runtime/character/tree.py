"""Hierarchies of nodes, and of joints in a rest pose with their chains, leaves and extents."""

from collections.abc import Collection, Container, Sequence
from functools import cached_property

import numpy as np

from runtime.arrays import AnyArray


def ancestors(parents: Sequence[int], node: int) -> list[int]:
    """Return a node and its ancestors, the root last; the parent of a root is -1."""
    found = [node]
    while parents[found[-1]] >= 0:
        found.append(parents[found[-1]])
    return found


class Tree:
    """Nodes by number with their parents (-1 at roots) and children."""

    def __init__(self, parents: Sequence[int], children: list[list[int]] | None = None) -> None:
        """Without `children`, those of a node are in numerical order."""
        self.parents = tuple(parents)
        self.children = [[] for _ in self.parents] if children is None else children
        for node, parent in enumerate(self.parents if children is None else ()):
            if parent >= 0:
                self.children[parent].append(node)

    @cached_property
    def order(self) -> list[int]:
        """The nodes, parents before their children."""
        order = [node for node, parent in enumerate(self.parents) if parent < 0]
        for node in order:  # grows during the loop
            order.extend(self.children[node])
        return order

    def under(self, top: int) -> list[int]:
        """Return a node and all its descendants, parents first."""
        found = [top]
        for node in found:  # grows during the loop
            found.extend(self.children[node])
        return found

    def ancestors(self, node: int) -> list[int]:
        """Return a node and its ancestors, the root last."""
        return ancestors(self.parents, node)

    def with_ancestors(self, nodes: Collection[int]) -> list[int]:
        """Return the given nodes and all their ancestors, parents first."""
        wanted = set(nodes)
        for node in reversed(self.order):
            if node in wanted:
                wanted.add(self.parents[node])
        return [node for node in self.order if node in wanted]

    def nearest(self, wanted: Container[int]) -> list[int]:
        """Return, for each node, the nearest of the `wanted` nodes among itself and its ancestors, or -1."""
        nearest = [-1] * len(self.parents)
        for node in self.order:
            parent = self.parents[node]
            nearest[node] = node if node in wanted else nearest[parent] if parent >= 0 else -1
        return nearest

    def counts(self, nodes: Collection[int]) -> list[int]:
        """Return, for each node, how many of the given nodes are in its subtree."""
        below = [int(node in nodes) for node in range(len(self.parents))]
        for node in reversed(self.order):
            if self.parents[node] >= 0:
                below[self.parents[node]] += below[node]
        return below


class JointTree(Tree):
    """Joints of a body in its rest pose, at positions `(K, 3)`, Y up."""

    def __init__(self, parents: Sequence[int], positions: AnyArray) -> None:
        super().__init__(parents)
        self.positions = np.asarray(positions, np.float64)

    @cached_property
    def ends(self) -> list[int]:
        """The joints without children."""
        return [joint for joint, children in enumerate(self.children) if not children]

    @cached_property
    def heights(self) -> list[int]:
        """The number of joints on the longest path down from each joint."""
        below = [0] * len(self.parents)
        for joint in reversed(self.order):
            below[joint] = max((below[child] + 1 for child in self.children[joint]), default=0)
        return below

    @cached_property
    def floor(self) -> float:
        """Height of the lowest joint, in the unit of the positions."""
        return float(self.positions[:, 1].min())

    @cached_property
    def size(self) -> float:
        """Height from the lowest to the highest joint, in the unit of the positions."""
        return max(float(np.ptp(self.positions[:, 1])), 1e-9)

    def chain(self, top: int, tip: int) -> list[int]:
        """Return the joints from `top` down to `tip`, both included."""
        above = self.ancestors(tip)
        return above[above.index(top) :: -1]

    def ends_under(self, top: int) -> list[int]:
        """Return the joints without children in the subtree of `top`."""
        return [joint for joint in self.under(top) if not self.children[joint]]

    def lowest(self, top: int) -> int:
        """Return the lowest leaf joint in the subtree of `top`."""
        return min(self.ends_under(top), key=lambda joint: float(self.positions[joint, 1]))

    def meeting(self, a: int, b: int) -> int:
        """Return the lowest common ancestor of two joints, -1 if they have different roots."""
        above = set(self.ancestors(a))
        return next((joint for joint in self.ancestors(b) if joint in above), -1)

    def distance(self, a: int, b: int) -> float:
        """Return the distance between two joints."""
        return float(np.linalg.norm(self.positions[a] - self.positions[b]))

    def along(self, chain: Sequence[int]) -> AnyArray:
        """Return the distance of each joint of a chain from its first joint, measured along the bones."""
        steps = np.linalg.norm(np.diff(self.positions[list(chain)], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])
