"""Fast export of graphs by torch's legacy exporter, for tests of other things: the current one takes seconds per graph."""

import warnings
from pathlib import Path
from typing import Any

import pytest
import torch


def export_quickly(patch: pytest.MonkeyPatch) -> None:
    """Use the legacy exporter while `patch` lasts."""
    export = torch.onnx.export

    def quickly(module: torch.nn.Module, example: tuple, path: str | Path, **options: Any) -> Any:
        names, shapes = options["input_names"], options.pop("dynamic_shapes")
        axes = {name: {0: "batch"} for name, shape in zip(names, shapes, strict=True) if shape}
        del options["external_data"]
        fast = torch.backends.mha.get_fastpath_enabled()
        torch.backends.mha.set_fastpath_enabled(False)  # has no symbol in ONNX
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # a deprecation warning
                return export(module, example, path, **options | {"dynamo": False, "dynamic_axes": axes})
        finally:
            torch.backends.mha.set_fastpath_enabled(fast)

    patch.setattr(torch.onnx, "export", quickly)


def export_motion_quickly(patch: pytest.MonkeyPatch) -> None:
    """Do the same only for the graph of the motion encoder, which takes longest and serves evaluation only."""
    from training.export import model

    export_motion = model._export_motion

    def quickly(*given: Any) -> float:
        with pytest.MonkeyPatch.context() as own:
            export_quickly(own)
            return export_motion(*given)

    patch.setattr(model, "_export_motion", quickly)
