"""The trained networks behind three ONNX graphs and a metadata file, checked when loaded."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path
from runtime.errors import ModelError
from runtime.features import INPUT_SIZE, LAYOUT_VERSION, OUTPUT_SIZE
from runtime.skeleton import SPORT_SKELETON

Array = NDArray[np.float32]

DEFAULT_MODEL = "models/compact"
_MAX_BYTES = 1024 * 1024 * 1024
_REMEDY = "Install the program again, or name another model folder."


@dataclass(frozen=True)
class Style:
    """What a prompt contributes to every frame: the modulator's folded weights and the natural speeds."""

    z: Array  # (6, 64)
    front_bias: Array
    content_weight: Array
    content_bias: Array
    walk_speed: float  # m/s
    jog_speed: float


class MotionModel:
    """One frame of motion: x and a style to y, by five denoising steps inside one graph.

    Deterministic for equal inputs and noise. `noise_shape` is `(steps, experts, output size)`.
    """

    def __init__(self, folder: Path, metadata: dict[str, Any], threads: int = 1) -> None:
        self.folder = folder
        self.name = str(metadata["name"])
        self.metadata = metadata
        config = metadata["config"]
        self.noise_shape = (
            len(metadata["reverse_steps"]), int(config["experts"]), int(config["output_size"])
        )
        self._step = _session(folder / "step.onnx", metadata, threads)
        self._style = _session(folder / "style.onnx", metadata, threads)
        self.provider = self._step.get_providers()[0].removesuffix("ExecutionProvider")

    @property
    def prompt_path(self) -> Path:
        """The text side of the content encoder: sentence embeddings to Z^t."""
        return self.folder / "prompt.onnx"

    def fold_style(self, z: Array) -> Style:
        """Fold Z^t `(6, 64)` into the modulator's weights: once per prompt, and per frame while prompts blend."""
        z = np.ascontiguousarray(z, np.float32)
        if z.shape != (6, 64) or not np.all(np.isfinite(z)):
            raise ModelError(f"Z^t: expected finite values of shape (6, 64), got {z.shape}.", "Encode the prompt again.")
        bias, weight, content_bias, speeds = self._style.run(None, {"z": z})
        walk, jog = float(np.clip(speeds[0], 0.4, 2.2)), float(np.clip(speeds[1], 1.2, 5.0))
        return Style(z, bias, weight, content_bias, walk, max(jog, 1.3 * walk))

    def step(self, x: Array, noise: Array, style: Style) -> tuple[Array, Array]:
        """y `(B, 473)` and alpha `(B, experts)` of inputs `(B, 472)` and noise `(B, *noise_shape)`."""
        feed = {
            "x": x,
            "noise": noise,
            "front_bias": style.front_bias,
            "content_weight": style.content_weight,
            "content_bias": style.content_bias,
        }
        y, alpha = self._step.run(None, feed)
        return y, alpha


def load_model(folder: Path | str | None = None, threads: int = 1) -> MotionModel:
    """Load and check a model folder (default: the shipped one); ModelError names what is wrong with it."""
    folder = Path(folder) if folder is not None else asset_path(DEFAULT_MODEL)
    path = folder / "metadata.json"
    try:
        metadata = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror or error}.", _REMEDY) from error
    except ValueError as error:
        raise ModelError(f"{path}: not valid JSON.", _REMEDY) from error
    _check_metadata(path, metadata)
    return MotionModel(folder, metadata, threads)


def _check_metadata(path: Path, metadata: Any) -> None:
    if not isinstance(metadata, dict) or metadata.get("format") != "sport-model":
        raise ModelError(f"{path}: not the metadata of a SPORT model.", _REMEDY)
    if metadata.get("layout_version") != LAYOUT_VERSION:
        raise ModelError(
            f"{path}: layout version {metadata.get('layout_version')!r}, this program needs {LAYOUT_VERSION}.",
            "Export the model again with this version of the program.",
        )
    needed = {"name", "config", "reverse_steps", "sha256", "joints", "start"}
    missing = sorted(needed - set(metadata))
    if missing:
        raise ModelError(f"{path}: field '{missing[0]}' is missing.", _REMEDY)
    if tuple(metadata["joints"]) != SPORT_SKELETON.names:
        raise ModelError(f"{path}: field 'joints' names another skeleton.", _REMEDY)
    if metadata["config"].get("output_size") != OUTPUT_SIZE:
        raise ModelError(
            f"{path}: output size {metadata['config'].get('output_size')!r}, the viewer needs {OUTPUT_SIZE}"
            " (with joint rotations).",
            "Train a preset with rotations.",
        )


def _session(path: Path, metadata: dict[str, Any], threads: int) -> Any:
    import onnxruntime

    try:
        if path.stat().st_size > _MAX_BYTES:
            raise ModelError(f"{path}: larger than {_MAX_BYTES >> 20} MB.", _REMEDY)
        data = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror or error}.", _REMEDY) from error
    if hashlib.sha256(data).hexdigest() != metadata["sha256"].get(path.stem):
        raise ModelError(f"{path}: damaged, or from another export than metadata.json.", _REMEDY)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises a dozen unrelated types for a damaged graph
        raise ModelError(f"{path}: not a graph that onnxruntime {onnxruntime.__version__} can load.", _REMEDY) from error
    if path.stem == "step" and session.get_inputs()[0].shape[-1] != INPUT_SIZE:
        raise ModelError(f"{path}: input 'x' has not {INPUT_SIZE} entries.", _REMEDY)
    return session
