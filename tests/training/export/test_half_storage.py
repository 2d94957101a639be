"""Weights stored in half precision: half the bytes, nearly the same numbers, and only where half precision can hold them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

from training.export.graph import store_in_half

SIZE = 96


def write_graph(path: Path, weights: np.ndarray) -> None:
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, [None, SIZE])
    y = helper.make_tensor_value_info("y", TensorProto.FLOAT, [None, SIZE])
    bias = numpy_helper.from_array(np.ones(SIZE, np.float32), "bias")
    nodes = [helper.make_node("MatMul", ["x", "w"], ["p"]), helper.make_node("Add", ["p", "bias"], ["y"])]
    graph = helper.make_graph(nodes, "g", [x], [y], [numpy_helper.from_array(weights, "w"), bias])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), str(path))


def run(path: Path, x: np.ndarray) -> np.ndarray:
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"]).run(None, {"x": x})[0]


def test_half_the_bytes_and_nearly_the_same_numbers(tmp_path: Path) -> None:
    path = tmp_path / "g.onnx"
    generator = np.random.default_rng(0)
    write_graph(path, generator.normal(size=(SIZE, SIZE)).astype(np.float32))
    x = generator.normal(size=(5, SIZE)).astype(np.float32)
    before, size = run(path, x), path.stat().st_size
    assert store_in_half(path) == 1  # the weights, not the bias
    assert path.stat().st_size < 0.55 * size
    error = np.linalg.norm(run(path, x) - before) / np.linalg.norm(before)
    assert 0.0 < error < 1e-3


def test_weights_beyond_the_range_of_half_precision_stay(tmp_path: Path) -> None:
    path = tmp_path / "g.onnx"
    write_graph(path, np.full((SIZE, SIZE), 1e5, np.float32))
    before = path.read_bytes()
    assert store_in_half(path) == 0
    assert path.read_bytes() == before


def test_a_second_time_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "g.onnx"
    write_graph(path, np.linspace(-1, 1, SIZE * SIZE, dtype=np.float32).reshape(SIZE, SIZE))
    store_in_half(path)
    before = path.read_bytes()
    assert store_in_half(path) == 0
    assert path.read_bytes() == before
