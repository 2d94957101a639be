"""A run's weights and what they have been through, as one small file, to fine-tune a model or to train it elsewhere.

python -m training.packed_run pack RUN FILE --model RUN/model     phases, content encoder, scales and generator, in half precision
python -m training.packed_run unpack FILE RUN --model FOLDER      into an empty run; `sport train stage2` then starts from them

FILE does not hold what the graphs of the exported model hold: that is read from the folder of the model (--model). The
exporter writes matrices as they are or with their axes in another order, and in half precision, as runs are packed:
most of a model is in its graphs bit for bit.
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

START = "start.pt"  # weights that stage 2 begins with in place of random ones
BEFORE = "before.json"  # in a run that began with packed weights: what these had been through
GRAPHS = ("step", "style", "prompt", "motion")
MIN_ELEMENTS = 1000  # numbers; smaller tensors stay in the file
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
    """Steps of each stage, one number for every model that went on from the one before; last logged losses."""

    steps: dict[str, list[int]] = field(default_factory=dict)
    losses: dict[str, str] = field(default_factory=dict)

    @staticmethod
    def of_run(folder: Path) -> History:
        """Read `before.json`, where there is one, and the run's own logs; FileError when either is damaged."""
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
        """Make a history of its fields as plain values; FileError names `path` when they are something else."""
        try:
            steps = {str(stage): [int(n) for n in counts] for stage, counts in stored["steps"].items()}
            return History(steps, {str(stage): str(line) for stage, line in stored["losses"].items()})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise FileError(f"{path}: not the history of a run.", "Pack the run again.") from error

    def write(self, folder: Path) -> None:
        """Note it in `folder` as what the weights of a new run had been through."""
        write_atomic(folder / BEFORE, json.dumps(asdict(self), indent=1) + "\n")


def _cast(value: Any, wanted: torch.dtype) -> Any:
    if isinstance(value, dict):
        return {k: _cast(v, wanted) for k, v in value.items()}
    if isinstance(value, torch.Tensor) and value.is_floating_point():
        return value.to(wanted)
    return value


def pack(run: Path, file: Path, model: Path | None = None) -> None:
    """Write the weights of a finished run, and what they have been through, to `file`; FileError names what it lacks.

    What the graphs in the folder `model` hold is left out; without a folder nothing is. Scales stay in single precision: they normalise values of very different size.
    """
    packed: dict[str, Any] = {}
    for key, name in _FILES.items():
        state = load_checkpoint(run / name)
        packed[key] = state if key == "scales" else _cast(state, torch.float16)
    if model is not None:
        packed = leave_out(packed, model)
    save_checkpoint(file, packed | {"history": asdict(History.of_run(run))})


def unpack(file: Path, run: Path, model: Path | None = None) -> None:
    """Write what stages after it need into `run`; UsageError when it holds a run already.

    `model` is the folder of the run's own model, by default the shipped one; it is read where the file leaves out what
    its graphs hold.
    """
    packed = put_back(load_checkpoint(file), model or model_folder())
    missing = [key for key in _FILES if key not in packed]
    if missing:
        raise FileError(f"{file}: lacks {', '.join(missing)}.", "Pack a finished run.")
    if any((run / name).exists() for name in (*_FILES.values(), START, "stage2.pt")):
        raise UsageError(f"{run}: holds a run already.", "Choose an empty folder.")
    run.mkdir(parents=True, exist_ok=True)
    for key, name in _FILES.items():
        target = START if key == "generator" else name
        save_checkpoint(run / target, _cast(packed[key], torch.float32))
    if "history" in packed:
        History.from_mapping(packed["history"], file).write(run)


@dataclass(frozen=True)
class WeightLocation:
    """The place of a tensor of `shape`: in `weight` of `graph`, its axes in the order `axes`."""

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
        if isinstance(value, Tensor) and value.dtype == torch.float16 and value.numel() >= MIN_ELEMENTS:
            found = _find(value.numpy(), by_size[value.numel()])
            return value if found is None else {_REFERENCE: asdict(found)}
        return value

    return replaced(packed) | {"graphs": {graph: _digest(model, graph) for graph in GRAPHS}}


def put_back(packed: dict[str, Any], model: Path) -> dict[str, Any]:
    """Restore what `leave_out` was given; FileError when the graphs in `model` are others."""
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


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Pack a run's weights, or begin a run with packed ones.")
    parser.add_argument("action", choices=("pack", "unpack"))
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--model", type=model_folder, help="folder of the run's exported model")
    args = parser.parse_args(argv)
    (pack if args.action == "pack" else unpack)(args.source, args.target, args.model)


if __name__ == "__main__":
    raise SystemExit(run_command("checkpoint", main))
