"""A run's weights and training history as one small file, to fine-tune a model or to train it elsewhere.

python -m training.packed_run pack RUN FILE --model RUN/model     phases, content encoder, scales and generator, in half precision
python -m training.packed_run unpack FILE RUN --model FOLDER      into an empty run; `sport train stage2` then starts from them

FILE omits weights that the graphs of the exported model contain; these are read from the model's folder (--model). The
exporter writes matrices unchanged or with permuted axes, in half precision like packed runs, so most weights are in the
graphs bit for bit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
from collections import defaultdict
from dataclasses import asdict, dataclass, field
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from runtime.assets import model_folder
from runtime.atomic import write_atomic
from runtime.errors import FileError, UsageError, run_command
from training.session import load_checkpoint, save_checkpoint

START = "start.pt"  # initial weights of stage 2, in place of random ones
BEFORE = "before.json"  # training history of the packed weights that a run started from
GRAPHS = ("step", "style", "prompt", "motion")
MIN_ELEMENTS = 1000  # smaller tensors are stored in the file
_FILES = {
    "phase": "phase_final.pt",
    "content": "content_final.pt",
    "scales": "scales.pt",
    "generator": "stage3_final.pt",
}
_REFERENCE = "weight_of_graph"
_STEP = re.compile(r"step (\d+) of \d+")

Half = NDArray[np.float16]


@dataclass
class History:
    """Steps of each stage, one number for each model in a chain of fine-tunings, and last logged losses."""

    steps: dict[str, list[int]] = field(default_factory=dict)
    losses: dict[str, str] = field(default_factory=dict)

    @staticmethod
    def of_run(folder: Path) -> History:
        """Read `before.json`, if it exists, and the run's own logs; FileError if either is damaged."""
        history = History()
        if (folder / BEFORE).exists():
            try:
                stored = json.loads((folder / BEFORE).read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise FileError(
                    f"{folder / BEFORE}: not the history of a run.", "Unpack the checkpoint again."
                ) from error
            history = History.from_mapping(stored, folder / BEFORE)
        for log in sorted((folder / "logs").glob("*.txt")):
            line = log.read_text(encoding="utf-8").strip()
            reached = _STEP.search(line)
            if reached is None:
                raise FileError(f"{log}: no line such as `step 100 of 100`.", "Run the stage again.")
            history.steps.setdefault(log.stem, []).append(int(reached[1]))
            history.losses[log.stem] = line
        return history

    @staticmethod
    def from_mapping(stored: dict[str, Any], path: Path) -> History:
        """Create a history from its fields as plain values; FileError names `path` if they are invalid."""
        try:
            steps = {str(stage): [int(n) for n in counts] for stage, counts in stored["steps"].items()}
            return History(steps, {str(stage): str(line) for stage, line in stored["losses"].items()})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise FileError(f"{path}: not the history of a run.", "Pack the run again.") from error

    def write(self, folder: Path) -> None:
        """Write it to `folder` as the history of a new run's initial weights."""
        write_atomic(folder / BEFORE, json.dumps(asdict(self), indent=1) + "\n")


def _cast(value: Any, wanted: torch.dtype) -> Any:
    if isinstance(value, dict):
        return {k: _cast(v, wanted) for k, v in value.items()}
    if isinstance(value, torch.Tensor) and value.is_floating_point():
        return value.to(wanted)
    return value


def pack(run: Path, file: Path, model: Path | None = None) -> None:
    """Write the weights of a finished run and their history to `file`; FileError names missing files.

    Weights in the graphs of the folder `model` are omitted, if it is given. Scales keep single precision, because they
    span very different magnitudes.
    """
    packed: dict[str, Any] = {}
    for key, name in _FILES.items():
        state = load_checkpoint(run / name)
        packed[key] = state if key == "scales" else _cast(state, torch.float16)
    if model is not None:
        packed = leave_out(packed, model)
    save_checkpoint(file, packed | {"history": asdict(History.of_run(run))})


def unpack(file: Path, run: Path, model: Path | None = None) -> None:
    """Write the inputs of later stages into `run`; UsageError if it already contains a run.

    `model` is the folder of the run's own model, by default the shipped one; weights that the file omits are read from
    its graphs.
    """
    packed = put_back(load_checkpoint(file), model or model_folder())
    missing = [key for key in _FILES if key not in packed]
    if missing:
        raise FileError(f"{file}: {', '.join(missing)} missing.", "Pack a finished run.")
    if any((run / name).exists() for name in (*_FILES.values(), START, "stage2.pt")):
        raise UsageError(f"{run}: already contains a run.", "Choose an empty folder.")
    run.mkdir(parents=True, exist_ok=True)
    for key, name in _FILES.items():
        target = START if key == "generator" else name
        save_checkpoint(run / target, _cast(packed[key], torch.float32))
    if "history" in packed:
        History.from_mapping(packed["history"], file).write(run)


@dataclass(frozen=True)
class WeightLocation:
    """Where a tensor of `shape` is stored: in `weight` of `graph`, with its axes in the order `axes`."""

    graph: str
    weight: str
    axes: list[int]
    shape: list[int]


def leave_out(packed: dict[str, Any], model: Path) -> dict[str, Any]:
    """Return `packed` with half-precision tensors that are in the graphs of the folder `model` replaced by references."""
    by_size: dict[int, list[tuple[str, str, Half]]] = defaultdict(list)
    for graph in GRAPHS:
        for name, values in _weights(model, graph).items():
            by_size[values.size].append((graph, name, values))

    def replaced(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: replaced(one) for key, one in value.items()}
        if isinstance(value, Tensor) and value.dtype == torch.float16 and value.numel() >= MIN_ELEMENTS:
            found = _find(value.numpy(), by_size[value.numel()])
            return value if found is None else {_REFERENCE: asdict(found)}
        return value

    return replaced(packed) | {"graphs": {graph: _digest(model, graph) for graph in GRAPHS}}


def put_back(packed: dict[str, Any], model: Path) -> dict[str, Any]:
    """Undo `leave_out`; FileError if `model` has different graphs."""
    for graph, digest in packed.get("graphs", {}).items():
        if _digest(model, graph) != digest:
            raise FileError(
                f"{model / graph}.onnx: not the graph with which the run was packed.",
                "Give the folder of the run's own model with --model.",
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
    """Return the half-precision weights of a graph by name; empty if the model has no such graph."""
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


def main(argv: list[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Pack a run's weights, or start a run from packed ones.")
    parser.add_argument("action", choices=("pack", "unpack"))
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--model", type=model_folder, help="folder of the run's exported model")
    args = parser.parse_args(argv)
    (pack if args.action == "pack" else unpack)(args.source, args.target, args.model)


if __name__ == "__main__":
    raise SystemExit(run_command("checkpoint", main))
