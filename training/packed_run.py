"""A run's weights as one small file, to fine-tune a model or to train it further elsewhere.

python -m training.packed_run pack RUN FILE --model RUN/model     phases, content encoder, scales and generator, in half precision
python -m training.packed_run unpack FILE RUN --model FOLDER      into an empty run; `sport train stage2` then starts from them

What the graphs of the exported model hold is left out of FILE: it is read from the folder of the model (--model).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import torch

from runtime.assets import model_folder
from runtime.errors import FileError, UsageError, run_command
from training.history import History
from training.session import load_checkpoint, save_checkpoint
from training.shared_weights import leave_out, put_back

START = "start.pt"  # weights that stage 2 begins with in place of random ones
CONTENT_START = "content_start.pt"  # the same for stage 1
_FILES = {
    "phase": "phase_final.pt",
    "content": "content_final.pt",
    "scales": "scales.pt",
    "generator": "stage3_final.pt",
}


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
    packed = {}
    for key, name in _FILES.items():
        state = load_checkpoint(run / name)
        packed[key] = state if key == "scales" else _cast(state, torch.float16)
    if model is not None:
        packed = leave_out(packed, model)
    save_checkpoint(file, packed | {"history": History.of_run(run).mapping()})


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
