"""A model under evaluation, with its styles, size and speed."""

import statistics
import time
from collections.abc import Callable, Iterable
from functools import cached_property
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.assets import asset_path
from runtime.controls import Controls
from runtime.errors import FileError
from runtime.motion.controller import Controller
from runtime.motion.model import MotionModel, load_model
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.prompter import Prompter
from training.data.sources import style_library
from training.evaluation.motion.driving import flat_ground

TIMED_FRAMES, WARM_UP = 240, 30


class EvaluatedModel:
    """The runtime's model of a folder, with the six-part descriptions of each style."""

    def __init__(self, folder: Path, texts: dict[str, list[PartDescriptions]]) -> None:
        self.folder = folder
        self.model: MotionModel = load_model(folder)
        self.texts = texts
        self._styles: dict[tuple[str, int], Array] = {}

    @cached_property
    def prompter(self) -> Prompter:
        """The encoder of prompts to Z^t."""
        return Prompter(self.model)

    @property
    def name(self) -> str:
        """Name of the folder, or of the training run for its `model` and `model-mixture`; seed 0 is omitted."""
        folder = self.folder.resolve()
        inner = folder.name
        if not inner.startswith("model"):
            return inner
        run, seed = folder.parent, ""
        if run.name.startswith("seed"):  # of an ablation or a baseline: RUNS/<row>/seed<k>/model
            run, seed = run.parent, "" if run.name == "seed0" else f" {run.name}"
        return run.name + inner[5:] + seed

    @property
    def decoder(self) -> str:
        """ "diffusion", or "mixture" (w/o-Diffusion)."""
        return str(self.model.metadata.get("decoder", "diffusion"))

    def style(self, style: str, number: int) -> Array:
        """Return Z^t `(6, 64)` of description `number` (modulo their count) of a style."""
        key = (style, number % len(self.texts[style]))
        if key not in self._styles:
            self._styles[key] = self.prompter(self.texts[style][key[1]])
        return self._styles[key]


def count_parameters(metadata: dict[str, Any]) -> int:
    """Count the parameters of encoder, modulator and decoders (Table I), or of one decoder for w/o-Diffusion.

    The MoE decoder is included in the diffusion model, as in the paper's totals.
    """
    if "parameters" in metadata:  # of another method
        return int(metadata["parameters"])
    from training.networks.generator import Generator
    from training.presets import ModelConfig

    counted = Generator(ModelConfig.of(metadata["config"])).named_parameters()
    unused = "denoiser" if metadata.get("decoder") == "mixture" else "none of these"
    return sum(p.numel() for name, p in counted if not name.startswith(unused))


def frame_times(model: MotionModel) -> dict[str, float]:
    """Measure median CPU milliseconds of one thread: the network alone, and with control, foot lock and IK.

    CPU time, so that other programs on the machine have no influence.
    """
    controller = Controller(model, flat_ground())
    forward = Controls(move=(0.0, 1.0))
    x = np.zeros((1, 472), np.float32)
    noise = np.random.default_rng(0).standard_normal((1, *model.noise_shape), np.float32)
    style = controller.style
    network = _median_ms(lambda: model.step(x, noise, style))
    return {"network_ms": network, "frame_ms": _median_ms(lambda: controller.step(forward))}


def _median_ms(work: Callable[[], object]) -> float:
    times = []
    for _ in range(WARM_UP + TIMED_FRAMES):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return 1e3 * statistics.median(times[WARM_UP:])


def style_texts(styles: Iterable[str] | None = None) -> dict[str, list[PartDescriptions]]:
    """Load six-part descriptions of styles (default: all), alternating hand-written and measured ones; FileError if missing."""
    path = asset_path("prompts/styles.json")
    library = style_library(path)
    chosen = set(library) if styles is None else set(styles)
    missing = chosen - set(library)
    if missing:
        raise FileError(f"{path}: no descriptions for '{sorted(missing)[0]}'.", "Add an entry for it.")
    result = {}
    for style in sorted(chosen):
        all_parts = [PartDescriptions.from_mapping(d) for d in library[style]["descriptions"]]
        written = len(all_parts) - int(library[style].get("measured", 0))
        pairs = zip_longest(all_parts[:written], all_parts[written:])
        result[style] = [parts for pair in pairs for parts in pair if parts is not None]
    return result
