"""Step graphs of a preset with random weights, for timing: speed does not depend on the weights.

python -m training.export.untrained --preset paper FOLDER
python -m training.export.untrained --model assets/models/compact FOLDER      layer sizes of that model

Writes plain.onnx (content experts blended in every frame), style.onnx, step.onnx (folded) and step_int8.onnx. There is
no metadata: it is not a usable model.
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from runtime.assets import model_folder
from runtime.errors import run_command
from runtime.motion.features import INPUT_SIZE
from runtime.motion.model_files import FOLDED, INT8_GRAPH, read_metadata
from training.arguments import log_progress
from training.batches import Normalisation
from training.export.graph import export_graph
from training.export.model import StyleGraph
from training.export.quantize import quantize_step
from training.export.step import PlainGraph, StepGraph, export_step
from training.networks.diffusion import Schedule, reverse_steps
from training.networks.generator import Generator
from training.presets import ModelConfig, preset


def export_untrained(config: ModelConfig, folder: Path) -> None:
    """Write the graphs of `config` with initial weights."""
    folder.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    generator = Generator(config).eval()
    size = config.output_size
    normal = Normalisation(
        torch.zeros(INPUT_SIZE), torch.ones(INPUT_SIZE), torch.zeros(size), torch.ones(size)
    )
    schedule = Schedule.linear(config.diffusion_steps)
    count = config.inference_steps
    steps = reverse_steps(schedule, schedule.subsequence(count), np.zeros(count))
    inputs = {
        "x": torch.randn(2, INPUT_SIZE),
        "z": torch.randn(2, config.style_size),
        "noise": torch.randn(2, count, config.experts, size),
    }
    export_graph(PlainGraph(generator, normal, steps), inputs, ["y"], folder / "plain.onnx")
    style, z = (
        StyleGraph(generator, torch.zeros(config.style_size + 1, 2)),
        torch.randn(6, config.style_size // 6),
    )
    export_graph(style, {"z": z}, [*FOLDED, "speeds"], folder / "style.onnx", (None,))
    export_step(StepGraph(generator, normal, steps), generator, count, folder / "step.onnx")
    quantize_step(folder / "step.onnx", folder / f"{INT8_GRAPH}.onnx")


def main(argv: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="training.export.untrained", description="Networks for timing.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--model", type=model_folder, help="folder of a model whose layer sizes are used")
    options = parser.parse_args(argv)
    log_progress()
    config = preset(options.preset)
    if options.model is not None:
        config = ModelConfig.of(read_metadata(options.model)["config"])
    export_untrained(config, options.folder)
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("export_untrained", main))
