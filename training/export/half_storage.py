"""Weights of exported graphs stored in half precision: half the bytes to download, single precision when they run.

onnxruntime computes the casts once, when it loads a graph, so that neither speed nor memory of a frame changes.

    python -m training.export.half_storage FOLDER        rewrites the graphs of a model folder and its hashes
"""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path

import numpy as np

from runtime.atomic import write_atomic
from runtime.errors import run_command
from runtime.motion.model_files import read_metadata

SMALLEST = 4096  # elements of a tensor that is worth a cast
LARGEST = 6.0e4  # a weight beyond the range of half precision keeps its tensor in single precision


def store_in_half(path: Path) -> int:
    """Rewrite the graph `path` with its large float32 weights as float16 and a cast behind each; returns how many."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    model = onnx.load(str(path))
    graph = model.graph
    casts = []
    for tensor in graph.initializer:
        if tensor.data_type != TensorProto.FLOAT or int(np.prod(tensor.dims)) < SMALLEST:
            continue
        values = numpy_helper.to_array(tensor)
        if np.abs(values).max() > LARGEST:
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
    """Every graph of a model folder by `store_in_half`, and their hashes in its metadata; returns the casts."""
    metadata = read_metadata(folder)
    count = 0
    for name in metadata["sha256"]:
        path = folder / f"{name}.onnx"
        count += store_in_half(path)
        metadata["sha256"][name] = hashlib.sha256(path.read_bytes()).hexdigest()
    write_atomic(folder / "metadata.json", json.dumps(metadata, indent=1) + "\n")
    return count


def main(argv: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="training.export.half_storage", description=__doc__)
    parser.add_argument("folder", type=Path)
    options = parser.parse_args(argv)
    print(f"{options.folder}: {store_model_in_half(options.folder)} weights in half precision")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("half_storage", main))
