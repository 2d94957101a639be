"""The trained networks: ONNX graphs and a metadata file, checked when loaded, and the sampler's noise."""

from __future__ import annotations

import copy
import threading
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from importlib.metadata import entry_points
from math import cos, pi, sin
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Float32Array
from runtime.assets import model_folder
from runtime.errors import ModelError
from runtime.motion.calibration import Calibration
from runtime.motion.features import C
from runtime.motion.mirror import Mirror, mirrored_code
from runtime.motion.model_files import (
    FOLDED,
    INT8_GRAPH,
    USUAL_STYLE_SIZE,
    check_graphs,
    choose_precision,
    open_graph,
    read_crosses,
    read_graph,
    read_metadata,
    run_graph,
)
from runtime.motion.style import Style
from runtime.motion.swing import PLAIN, MeasuredSwings, composed_fraction
from runtime.skeleton import PART_NAMES
from runtime.terrain.obstacle_detection import ObstacleAhead

# Periods (seconds) of the waves that make up each noise value. Noise that is fresh in every frame, or a random walk, makes the
# character tremble, because a sampled pose follows its noise. These periods share no multiple, and are longer than a step.
PERIODS_S = (1.7, 2.9, 5.3)


@lru_cache(maxsize=64)
def _waves(shape: tuple[int, ...], seed: int) -> NDArray[np.float32]:
    """Return amplitudes `(6, numbers)` of the cosines and sines."""
    count = 2 * len(PERIODS_S)
    waves = np.random.default_rng(seed).standard_normal((count, int(np.prod(shape))), np.float32)
    return waves / np.float32(np.sqrt(len(PERIODS_S)))


def drifting_noise(
    shape: tuple[int, ...], seed: int, seconds: float, spread: float = 1.0
) -> NDArray[np.float32]:
    """Return smooth noise of `shape` at a time: random sums of slow waves, distributed N(0, `spread`), the same for the same seed."""
    angles = [2.0 * pi * seconds / period for period in PERIODS_S]
    weights = [spread * wave(angle) for wave in (cos, sin) for angle in angles]
    return (np.array(weights, np.float32) @ _waves(shape, seed)).reshape(shape)


KINDS = "sport.models"  # entry points of other kinds of model: a class with the interface of `MotionModel`
ARM_PARTS = 2  # the first of the six parts
# strength of a code that is unlike any captured style: at full strength, combinations of words that were never captured together
# unbalance the body; body edits show them too
COMPOSED_STRENGTH = 0.85
MAX_CACHED_STACKS = 8  # style lists whose stacked weights are cached: two calls for each of four threads
MIN_STRENGTH, MAX_STRENGTH = 0.0, 2.0
NEW_MODEL = "Give a style for each, with a newly exported model."
ROUNDING_M = 1e-3  # rounding of heights that a ground stores
WALK_RANGE_M_PER_S, JOG_RANGE_M_PER_S = (0.4, 2.2), (1.2, 5.0)  # limits of a network's speeds
MIN_JOG_RATIO = 1.3  # of the jogging speed to the walking speed


class MotionModel:
    """The motion network: input x and a style to output y, by five denoising steps in one graph.

    Deterministic for equal inputs and noise. `precision` is that of the loaded step graph, fp32 or int8; with int8 the output
    of a character depends slightly on the rest of its batch, which shares the scale of the activations. `noise_shape` is
    `(steps, experts, output size)`, `style_shape` that of Z^t: (6, 64), or six sentence embeddings without a content encoder.
    """

    def __init__(
        self, folder: Path, metadata: dict[str, Any], threads: int = 1, precision: str = "auto"
    ) -> None:
        self.folder, self._threads = folder, threads
        self.precision = choose_precision(folder, metadata, precision)
        self.name = str(metadata["name"])
        self.metadata = metadata
        config = metadata["config"]
        self.noise_shape = (
            len(metadata["reverse_steps"]),
            int(config["experts"]),
            int(config["output_size"]),
        )
        self.style_shape = (
            len(PART_NAMES),
            int(config.get("style_size", USUAL_STYLE_SIZE)) // len(PART_NAMES),
        )
        self._neutral_code, self._strength = _strength(folder, metadata, self.style_shape)
        self._mirror, self.calibration = _calibration(folder, metadata, self.neutral)
        self._swings = MeasuredSwings.read(folder, metadata, self.style_shape)
        step = "step" if self.precision == "fp32" else INT8_GRAPH
        prompt, self._style, self._step = (
            open_graph(folder / f"{name}.onnx", read_graph(folder, name, metadata), threads)
            for name in ("prompt", "style", step)
        )
        self._step_path = folder / f"{step}.onnx"
        self._styles_apart = check_graphs(
            folder, prompt, self._style, self._step, self.noise_shape, self.style_shape, step
        )
        # keyed by the calling thread, and by first or second call
        self._stacked: dict[tuple[int, bool], tuple[tuple[Style, ...], dict[str, Float32Array]]] = {}
        self._crosses = read_crosses(folder, metadata)
        self.provider = self._step.get_providers()[0].removesuffix("ExecutionProvider")

    @property
    def batches(self) -> bool:
        """Whether one call can step characters of different styles independently."""
        return self._styles_apart and self.precision == "fp32"

    @cached_property
    def in_full(self) -> MotionModel:
        """This model in full precision, for crowds: one fp32 call for all is cheaper than an 8-bit call for each."""
        if self.precision == "fp32" or not self._styles_apart:
            return self
        full, name = copy.copy(self), "step"
        full.precision, full._stacked, full._step_path = "fp32", {}, self.folder / f"{name}.onnx"
        full._step = open_graph(full._step_path, read_graph(self.folder, name, self.metadata), self._threads)
        return full

    def crosses(self, obstacle: ObstacleAhead) -> bool:
        """Return whether the network crosses an obstacle without keyframes; the largest one measured of its kind is the limit."""
        return obstacle.size <= self._crosses.get(obstacle.kind.value, 0.0) + ROUNDING_M

    @property
    def prompt_path(self) -> Path:
        """Path of the graph that maps sentence embeddings to Z^t, the text side of the content encoder."""
        return self.folder / "prompt.onnx"

    @property
    def neutral(self) -> Float32Array:
        """Z^t `(6, 64)` of neutral walking; zeros, the mean of all training sentences, if the model does not define it."""
        return np.zeros(self.style_shape, np.float32) if self._neutral_code is None else self._neutral_code

    def neutral_style(self, mirrored: bool) -> Style:
        """Return the folded style of neutral walking; `mirrored` for a mirrored walk."""
        return self._neutral_styles[mirrored]

    @cached_property
    def _neutral_styles(self) -> tuple[Style, Style]:
        mirrored = replace(self.fold_style(mirrored_code(self.neutral)), z=self.neutral, mirrored=True)
        return self.fold_style(self.neutral), mirrored

    def fold_style(self, z: Float32Array, strength: float = 1.0) -> Style:
        """Fold Z^t `(6, 64)` into the modulator's weights: once per prompt, and per frame while prompts blend.

        The code is exaggerated relative to that of neutral walking, n: n + s (z - n), where s is `strength` times the
        best value in the model's metadata, and less for a code that no captured style is near.
        """
        z = np.ascontiguousarray(z, np.float32)
        if z.shape != self.style_shape or not np.all(np.isfinite(z)):
            raise ModelError(
                f"Z^t: expected finite values of shape {self.style_shape}, got {z.shape}.",
                "Encode the prompt again.",
            )
        swings = self.swings(z)
        composed = 0.0 if self._swings is None else composed_fraction(swings)
        own, drawn = (
            self._drawn(z, strength),
            self._drawn(z, strength * (1.0 - (1.0 - COMPOSED_STRENGTH) * composed)),
        )
        path = self.folder / "style.onnx"
        bias, weight, content_bias, speeds = run_graph(self._style, path, None, {"z": drawn})
        if not np.isfinite(speeds).all():
            raise ModelError(f"{path}: returns speeds that are not finite.", "Choose another model.")
        walk, jog = (
            float(np.clip(speeds[0], *WALK_RANGE_M_PER_S)),
            float(np.clip(speeds[1], *JOG_RANGE_M_PER_S)),
        )
        rest = np.zeros((C, 2), np.float32)
        if len(speeds) > 2:
            if self._neutral_code is not None:  # a giant's legs would be read as waving
                arms = own.copy()
                arms[ARM_PARTS:] = self._neutral_code[ARM_PARTS:]
                speeds = run_graph(self._style, path, None, {"z": arms})[3]
            rest = np.asarray(speeds[2:], np.float32).reshape(2, -1).T
        rest = rest.astype(np.float32)
        return Style(z, bias, weight, content_bias, walk, max(jog, MIN_JOG_RATIO * walk), rest, swings=swings)

    def _drawn(self, z: Float32Array, strength: float) -> Float32Array:
        """Return Z^t exaggerated relative to the neutral code, by `strength` times the model's best value."""
        strength *= self._strength
        if self._neutral_code is None or strength == 1.0:
            return z
        return self._neutral_code + np.float32(strength) * (z - self._neutral_code)

    def swings(self, z: Float32Array) -> tuple[float, ...]:
        """Return the swing gains for a walk of Z^t `(6, 64)`; 1 if the model has none."""
        return PLAIN if self._swings is None else self._swings.of(z)

    def step(
        self, x: Float32Array, noise: Float32Array, style: Style | Sequence[Style]
    ) -> tuple[Float32Array, Float32Array]:
        """Run the network: y `(B, 473)` and alpha `(B, experts)` for inputs `(B, 472)` and noise `(B, *noise_shape)`.

        `style` is one for all characters or one each; passing the same list again avoids stacking. For mirrored styles
        x and y are mirrored; limbs that a style takes from the opposite walk cost a second call.
        """
        y, alpha = self._one_way(x, noise, style)
        styles = [style] * len(x) if isinstance(style, Style) else style
        twice = {
            i: one.opposite for i, one in enumerate(styles) if one.opposite is not None and any(one.limbs)
        }
        if self._mirror is not None and twice:
            rows, opposites = list(twice), list(twice.values())
            other = opposites[0] if isinstance(style, Style) else opposites
            opposite, _ = self._one_way(x[rows], noise[rows], other, second=True)
            fractions = np.array([styles[i].limbs for i in rows], np.float32)
            y[rows] = self._mirror.with_limbs(y[rows], opposite, fractions)
        return y, alpha

    def _one_way(
        self, x: Float32Array, noise: Float32Array, style: Style | Sequence[Style], second: bool = False
    ) -> tuple[Float32Array, Float32Array]:
        """Return y and alpha for the styles as folded; `second` marks the call for the opposite walk."""
        folded = self._folded(style, len(x), second)
        mirrored = [s.mirrored for s in ([style] * len(x) if isinstance(style, Style) else style)]
        mirror, turned = self._mirror if any(mirrored) else None, np.array(mirrored)[:, None]
        if mirror is not None:
            x = np.where(turned, mirror.of_input(x), x)
        y, alpha = run_graph(self._step, self._step_path, None, {"x": x, "noise": noise, **folded})
        if mirror is not None:
            y = np.where(turned, mirror.of_output(y), y)
        return y, alpha

    def _folded(self, style: Style | Sequence[Style], count: int, second: bool) -> dict[str, Float32Array]:
        if isinstance(style, Style):
            leading = None if self._styles_apart else ...
            return {name: getattr(style, name)[leading] for name in FOLDED}
        if not self._styles_apart:
            raise ModelError(f"{self.folder}: this model takes one style for all characters.", NEW_MODEL)
        if len(style) != count:
            raise ModelError(f"{self.folder}: {len(style)} styles for {count} characters.", NEW_MODEL)
        return self._stack(style, second)

    def _stack(self, style: Sequence[Style], second: bool) -> dict[str, Float32Array]:
        """Return the folded weights of all styles, stacked; cached for the same list."""
        asking = threading.get_ident(), second
        known, tensors = self._stacked.get(asking, ((), {}))
        if len(known) != len(style) or any(a is not b for a, b in zip(known, style, strict=True)):
            tensors = {name: np.stack([getattr(one, name) for one in style]) for name in FOLDED}
            others = self._stacked if len(self._stacked) < MAX_CACHED_STACKS else {}
            self._stacked = {**others, asking: (tuple(style), tensors)}
        return tensors


def _strength(
    folder: Path, metadata: dict[str, Any], shape: tuple[int, int]
) -> tuple[Float32Array | None, float]:
    """Return neutral Z^t and the style strength of a model; None and 1 if it does not define them."""
    section = metadata.get("strength")
    if section is None:
        return None, 1.0
    try:
        neutral = np.array(section["neutral"], np.float32).reshape(shape)
        default = float(section["default"])
        fits = bool(np.isfinite(neutral).all()) and MIN_STRENGTH <= default <= MAX_STRENGTH
    except (TypeError, KeyError, ValueError, OverflowError):
        fits = False
    if not fits:
        raise ModelError(
            f"{folder / 'metadata.json'}: field 'strength' is not a neutral style {shape} with a default of "
            f"{MIN_STRENGTH:g} to {MAX_STRENGTH:g}.",
            "Export the model again.",
        )
    return neutral, default


def _calibration(
    folder: Path, metadata: dict[str, Any], neutral: Float32Array
) -> tuple[Mirror | None, Calibration | None]:
    """Return the mirror and the calibration of a model's metadata; None where it has none."""
    section = metadata.get("calibration")
    if section is None:
        return None, None
    try:
        phase = np.array(section["phase"], np.float32)
        parts = np.array([PART_NAMES.index(code["part"]) for code in section["codes"]], np.int64)
        codes, leads = (
            np.array([code[name] for code in section["codes"]], np.float32) for name in ("code", "lead")
        )
        shapes = (phase.shape, codes.shape, leads.shape)
        expected = ((C,), (len(parts), neutral.shape[1]), parts.shape)
        within = (np.abs(phase) == 1.0, np.isfinite(codes), np.abs(leads) <= 1.0)
        fits = shapes == expected and all(map(np.all, within))
    except (TypeError, KeyError, ValueError, OverflowError):
        fits = False
    if not fits:
        raise ModelError(
            f"{folder / 'metadata.json'}: field 'calibration' has no signs of {C} phases, or codes that are not of a part.",
            "Export the model again.",
        )
    return Mirror(phase), Calibration(parts, codes, leads, neutral)


def load_model(folder: Path | str | None = None, threads: int = 1, precision: str = "auto") -> MotionModel:
    """Load and check a model by folder or name (default: `compact`); raises ModelError with the reason if it is invalid.

    `precision` is fp32, int8, or auto: the default in the model's metadata.
    """
    folder = model_folder(folder)
    metadata = read_metadata(folder)
    if "kind" not in metadata:
        return MotionModel(folder, metadata, threads, precision)
    kind = str(metadata["kind"])[:40]
    for found in entry_points(group=KINDS, name=kind):
        return cast(MotionModel, found.load()(folder, metadata))
    raise ModelError(
        f"{folder}: no installed package runs a model of the kind '{kind}'.", "Install the program again."
    )


_JOINTS, _ROOT = (40, 31, 9), (40, 3)


class ExportedMotionEncoder:
    """The graph `motion.onnx` of a model folder; raises ModelError if it is missing, damaged or from another export."""

    def __init__(self, folder: Path, threads: int = 1) -> None:
        data = read_graph(folder, "motion", read_metadata(folder))
        self._session = open_graph(folder / "motion.onnx", data, threads)

    def encode(self, joints: Float32Array, root: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Return mean and log-variance `(B, 6, 64)` of sequences of 40 samples, every second frame at 60 Hz.

        `joints` `(B, 40, 31, 9)`: position (metres, relative to root and ground height) and 6D rotation; `root` `(B,
        40, 3)`: its velocity (m/s, m/s, rad/s). All as in the network's output, not normalised.
        """
        if joints.shape[1:] != _JOINTS or root.shape != (len(joints), *_ROOT):
            raise ModelError(
                f"Motion encoder: joints {joints.shape} and root {root.shape}; expected (B, 40, 31, 9), (B, 40, 3).",
                "Cut the motion into windows of 40 samples.",
            )
        feed = {"joints": np.asarray(joints, np.float32), "root": np.asarray(root, np.float32)}
        mean, log_variance = self._session.run(["mean", "log_variance"], feed)
        return mean, log_variance
