"""Small hand-written ONNX networks in place of trained ones."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

Shapes = dict[str, list[int | str]]


def save_graph(
    path: Path,
    nodes: Sequence[tuple[str, str, str, dict[str, int]]],
    inputs: Shapes,
    outputs: Shapes,
    constants: dict[str, np.ndarray],
    whole: bool = False,
) -> Path:
    """Write a graph of nodes, each with operator, names of inputs and outputs, and attributes.

    Inputs are floats, or integers if `whole`.
    """
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    def told(shapes: Shapes, kind: int) -> list:
        return [helper.make_tensor_value_info(name, kind, shape) for name, shape in shapes.items()]

    made = [helper.make_node(kind, a.split(), b.split(), **how) for kind, a, b, how in nodes]
    arrays = [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    kind = TensorProto.INT64 if whole else TensorProto.FLOAT
    graph = helper.make_graph(made, path.stem, told(inputs, kind), told(outputs, TensorProto.FLOAT), arrays)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, str(path))
    return path
