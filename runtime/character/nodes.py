"""The nodes of a glTF file: their hierarchy and rest transforms."""

from functools import cached_property

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.read import MAX_VALUE, Entry, GltfFile
from runtime.character.tree import JointTree, Tree


class Nodes(Tree):
    """The node hierarchy of a glTF file. Raises FileError if it is not a tree."""

    def __init__(self, file: GltfFile) -> None:
        self.file = file
        children = [entry.children or [] for entry in file.gltf.nodes or []]
        super().__init__(_parents(file, children), children)
        if len(self.order) < len(children):
            first = min(set(range(len(children))) - set(self.order))
            raise file.error(f"the node hierarchy has a cycle at node {first}.")

    @cached_property
    def skinned(self) -> set[int]:
        """The existing joints that skins name; missing ones are reported when the skins are read."""
        every = range(len(self.parents))
        return {joint for skin in self.file.gltf.skins or [] for joint in skin.joints or [] if joint in every}

    @cached_property
    def rest(self) -> AnyArray:
        """World matrices `(nodes, 4, 4)`, float64, of the nodes at rest."""
        world, local = np.zeros((len(self.parents), 4, 4)), local_matrices(self.file)
        for i in self.order:
            world[i] = local[i] if self.parents[i] < 0 else world[self.parents[i]] @ local[i]
        if not np.all(np.abs(world) < MAX_VALUE):
            raise self.file.error(f"its nodes lie further than {MAX_VALUE:.0e} away.")
        return world

    @property
    def skeleton(self) -> set[int]:
        """The joints of skins, the animated nodes and those between them, without the roots above."""
        animations = self.file.gltf.animations
        wanted = {node for skin in self.file.gltf.skins or [] for node in skin.joints}
        wanted |= {channel.target.node for animation in animations for channel in animation.channels}
        for node in reversed(self.order):
            above = self.parents[node]
            if node in wanted and above >= 0 and self.parents[above] >= 0:
                wanted.add(above)
        return wanted

    def joint_tree(self, branch: list[int]) -> JointTree:
        """Return the nodes of `branch` as joints at rest; a node whose parent is not in the branch becomes a root."""
        place = {node: k for k, node in enumerate(branch)}
        return JointTree([place.get(self.parents[node], -1) for node in branch], self.rest[branch, :3, 3])

    def entry(self, node: int) -> Entry:
        """Return the glTF object of a node."""
        entry: Entry = self.file.gltf.nodes[node]
        return entry

    def name(self, node: int) -> str:
        """Return the name of a node, or its number."""
        return str(self.entry(node).name or f"node {node}")


def _parents(file: GltfFile, children: list[list[int]]) -> list[int]:
    parents = [-1] * len(children)
    for node, below in enumerate(children):
        for child in below:
            known = isinstance(child, int) and 0 <= child < len(children) and child != node
            if not known or parents[child] >= 0:
                raise file.error(f"the children of node {node} do not form a tree.")
            parents[child] = node
    return parents


def local_matrices(file: GltfFile) -> AnyArray:
    """Return every node's transform in its parent's space `(nodes, 4, 4)`."""

    def values(name: str, default: tuple[float, ...]) -> AnyArray:
        given = [default if (value := node.get(name)) is None else value for node in nodes]
        rows = np.zeros((len(nodes), len(default)))
        for i, value in enumerate(given):
            array = np.array(value, np.float64)
            if array.shape != (len(default),) or not np.all(np.abs(array) < MAX_VALUE):
                raise file.error(f"the {name} of node {i} is not {len(default)} finite numbers.")
            rows[i] = array
        return rows

    nodes = file.gltf.nodes
    matrices = values("matrix", tuple(np.eye(4).ravel())).reshape(-1, 4, 4).transpose(0, 2, 1)
    turns = rotations.to_matrix(
        rotations.normalize(values("rotation", (0.0, 0.0, 0.0, 1.0))[:, [3, 0, 1, 2]])
    )
    parts = np.tile(np.eye(4), (len(nodes), 1, 1))
    parts[:, :3, :3] = turns * values("scale", (1.0, 1.0, 1.0))[:, None]
    parts[:, :3, 3] = values("translation", (0.0, 0.0, 0.0))
    whole = np.array([node.get("matrix") is not None for node in nodes])
    return np.where(whole[:, None, None], matrices, parts)
