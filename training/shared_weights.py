"""Weights that a packed run need not hold, because the graphs of its exported model hold the same numbers.

The exporter writes matrices as they are or with their axes in another order, and in half precision, as runs are packed:
most of a model is in its graphs bit for bit.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from dataclasses import asdict, dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from runtime.errors import FileError

GRAPHS = ("step", "style", "prompt", "motion")
SMALLEST = 1000  # numbers; what is smaller stays in the file
_REFERENCE = "weight_of_graph"

Half = NDArray[np.float16]


@dataclass(frozen=True)
class WeightLocation:
    """Where a tensor of `shape` is: in `weight` of `graph`, its axes in the order `axes`."""

    graph: str
    weight: str
    axes: list[int]
    shape: list[int]


def leave_out(packed: dict[str, Any], model: Path) -> dict[str, Any]:
    """`packed` with references in place of tensors in half precision that the graphs in the folder `model` hold."""
    by_size: dict[int, list[tuple[str, str, Half]]] = defaultdict(list)
    for graph in GRAPHS:
        for name, values in _weights(model, graph).items():
            by_size[values.size].append((graph, name, values))

    def replaced(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: replaced(one) for key, one in value.items()}
        if isinstance(value, Tensor) and value.dtype == torch.float16 and value.numel() >= SMALLEST:
            found = _find(value.numpy(), by_size[value.numel()])
            return value if found is None else {_REFERENCE: asdict(found)}
        return value

    return replaced(packed) | {"graphs": {graph: _digest(model, graph) for graph in GRAPHS}}


def put_back(packed: dict[str, Any], model: Path) -> dict[str, Any]:
    """What `leave_out` was given; FileError when the graphs in `model` are not those that it was given."""
    for graph, digest in packed.get("graphs", {}).items():
        if _digest(model, graph) != digest:
            raise FileError(
                f"{model / graph}.onnx: not the graph that the run was packed with.",
                "Name the folder of the run's own model with --model.",
            )
    weights = {graph: _weights(model, graph) for graph in packed.get("graphs", {})}

    def restored(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        if value.keys() == {_REFERENCE}:
            at = WeightLocation(**value[_REFERENCE])
            turned = weights[at.graph][at.weight].reshape([at.shape[axis] for axis in at.axes])
            return torch.tensor(turned.transpose(np.argsort(at.axes)))
        return {key: restored(one) for key, one in value.items()}

    return {key: restored(value) for key, value in packed.items() if key != "graphs"}


def _find(values: Half, candidates: list[tuple[str, str, Half]]) -> WeightLocation | None:
    for graph, name, weight in candidates:
        for axes in permutations(range(values.ndim)):
            if np.array_equal(values.transpose(axes).ravel(), weight.ravel()):
                return WeightLocation(graph, name, list(axes), list(values.shape))
    return None


def _weights(model: Path, graph: str) -> dict[str, Half]:
    """The numbers of a graph by name, in half precision; none where the model has no such graph."""
    import onnx

    path = model / f"{graph}.onnx"
    if not path.is_file():
        return {}
    loaded = onnx.load(str(path)).graph.initializer
    with np.errstate(over="ignore"):
        return {one.name: onnx.numpy_helper.to_array(one).astype(np.float16) for one in loaded}


def _digest(model: Path, graph: str) -> str:
    path = model / f"{graph}.onnx"
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
