"""Export of torch modules to ONNX graphs, checked against torch, with weights in half precision."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from runtime.atomic import write_atomic
from runtime.motion.model_files import read_metadata, write_metadata

OPSET = 18
MIN_CAST_ELEMENTS = 4096  # smallest tensor that is stored in half precision
MAX_HALF_VALUE = 6.0e4  # tensors with weights beyond the float16 range stay float32
MAX_DIFFERENCE_FRACTION = 1e-4  # between torch and graph, relative to outputs above one
BATCH = torch.export.Dim("batch", min=1, max=4096)


def export_graph(
    module: nn.Module,
    inputs: Mapping[str, Tensor],
    outputs: Sequence[str],
    path: Path,
    shapes: tuple | None = None,
    leading: dict[str, str] | None = None,
) -> float:
    """Write `module` and return its largest difference from torch on `inputs`; RuntimeError above 1e-4.

    `shapes` are the dynamic shapes of `torch.export` per input, by default any batch as the first dimension. `leading`
    renames the first dimension of inputs, because torch unifies dimensions that matrix products broadcast.
    """
    module, example = module.eval(), tuple(inputs.values())
    with torch.no_grad():
        torch.onnx.export(
            module,
            example,
            str(path),
            input_names=list(inputs),
            output_names=list(outputs),
            opset_version=OPSET,
            dynamo=True,
            dynamic_shapes=tuple({0: BATCH} for _ in inputs) if shapes is None else shapes,
            external_data=False,
            verbose=False,
        )
        expected = module(*example)
    _clean(path, leading or {})
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    got = session.run(None, {name: value.numpy() for name, value in inputs.items()})
    expected = expected if isinstance(expected, tuple) else (expected,)
    error = max(float(np.abs(a.numpy() - b).max()) for a, b in zip(expected, got, strict=True))
    scale = max(float(a.abs().max()) for a in expected)
    if error > MAX_DIFFERENCE_FRACTION * max(1.0, scale):
        raise RuntimeError(f"{path}: ONNX differs from torch by {error:.2e}")
    return error


def _clean(path: Path, leading: dict[str, str]) -> None:
    """Remove the exporter's stack traces, which contain local paths, and the inferred shapes."""
    import onnx

    model = onnx.load(str(path))
    graph = model.graph
    for value in graph.input:
        if value.name in leading:
            value.type.tensor_type.shape.dim[0].dim_param = leading[value.name]
    # inferred shapes unify the renamed dimensions and break quantisation
    del graph.value_info[:]
    parts: list[Any] = [model, graph, *graph.node, *graph.input, *graph.output, *graph.initializer]
    for function in model.functions:
        parts += [function, *function.node, *function.value_info]
    for part in parts:
        part.ClearField("metadata_props")
        part.ClearField("doc_string")
    onnx.save(model, str(path))


def store_in_half(path: Path) -> int:
    """Store large float32 weights of the graph `path` as float16, each followed by a cast; returns their number.

    This halves the download. onnxruntime evaluates the casts once while loading, so run-time speed and memory are equal.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    model = onnx.load(str(path))
    graph = model.graph
    casts = []
    for tensor in graph.initializer:
        if tensor.data_type != TensorProto.FLOAT or int(np.prod(tensor.dims)) < MIN_CAST_ELEMENTS:
            continue
        values = numpy_helper.to_array(tensor)
        if np.abs(values).max() > MAX_HALF_VALUE:
            continue
        name = tensor.name
        tensor.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
        casts.append(helper.make_node("Cast", [f"{name}_half"], [name], f"{name}_cast", to=TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
    if casts:
        write_atomic(path, model.SerializeToString())
    return len(casts)


def store_model_in_half(folder: Path) -> int:
    """Apply `store_in_half` to all graphs of a model folder and update their hashes; returns the number of casts."""
    metadata = read_metadata(folder)
    count = 0
    for name in metadata["sha256"]:
        path = folder / f"{name}.onnx"
        count += store_in_half(path)
        metadata["sha256"][name] = hashlib.sha256(path.read_bytes()).hexdigest()
    write_metadata(folder, metadata)
    return count
