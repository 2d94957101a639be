"""The node hierarchy of a glTF file: who carries whom, and where everything rests."""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray
from runtime.character.read import MAX_VALUE, GltfFile


def ancestors(file: GltfFile) -> tuple[list[int], list[int]]:
    """All nodes with parents before their children, and the parent of each node, -1 at roots.

    FileError on a cycle or a bad child index.
    """
    nodes, parents = file.gltf.nodes or [], _parents(file)
    order = [i for i, parent in enumerate(parents) if parent < 0]
    for i in order:  # which grows meanwhile
        order.extend(nodes[i].children or [])
    if len(order) < len(nodes):
        first = min(set(range(len(nodes))) - set(order))
        raise file.error(f"the node hierarchy has a cycle at node {first}.")
    return order, parents


def _parents(file: GltfFile) -> list[int]:
    nodes = file.gltf.nodes or []
    parents = [-1] * len(nodes)
    for i, node in enumerate(nodes):
        for child in node.children or []:
            known = isinstance(child, int) and 0 <= child < len(nodes) and child != i
            if not known or parents[child] >= 0:
                raise file.error(f"the children of node {i} do not form a tree.")
            parents[child] = i
    return parents


def nearest_of(order: list[int], parents: list[int], wanted: Container[int]) -> list[int]:
    """For each node the nearest of the `wanted` ones among itself and its ancestors, -1 where there is none."""
    nearest = [-1] * len(parents)
    for i in order:
        nearest[i] = i if i in wanted else nearest[parents[i]] if parents[i] >= 0 else -1
    return nearest


def node_world_matrices(file: GltfFile, order: list[int], parents: list[int]) -> AnyArray:
    """Rest transforms `(nodes, 4, 4)` in scene space, float64, of nodes as `ancestors` gives them."""
    world, local = np.zeros((len(parents), 4, 4)), _local_matrices(file)
    for i in order:
        world[i] = local[i] if parents[i] < 0 else world[parents[i]] @ local[i]
    if not np.all(np.abs(world) < MAX_VALUE):
        raise file.error(f"its nodes lie further than {MAX_VALUE:.0e} away.")
    return world


def _local_matrices(file: GltfFile) -> AnyArray:
    """Every node's transform in its parent's space `(nodes, 4, 4)`."""

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
