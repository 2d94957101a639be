"""torch's exporter takes seconds for a graph; its forerunner writes the same graphs at once, for tests of something else."""

import warnings
from pathlib import Path
from typing import Any

import pytest
import torch


def export_quickly(patch: pytest.MonkeyPatch) -> None:
    """Let the forerunner write graphs for as long as `patch` lasts."""
    export = torch.onnx.export

    def quickly(module: torch.nn.Module, example: tuple, path: str | Path, **options: Any) -> Any:
        names, shapes = options["input_names"], options.pop("dynamic_shapes")
        axes = {name: {0: "batch"} for name, shape in zip(names, shapes, strict=True) if shape}
        del options["external_data"]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it says that it is the forerunner
            return export(module, example, path, **options | {"dynamo": False, "dynamic_axes": axes})

    patch.setattr(torch.onnx, "export", quickly)
