"""8-bit quantisation of the step graph, and its error on frames of the model's own walks.

python -m training.export.quantize FOLDER                     writes step_int8.onnx, and its error into metadata.json
python -m training.export.quantize FOLDER --default fp32      makes full precision the default
"""

from __future__ import annotations

import argparse
import hashlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runtime.arrays import Array
from runtime.errors import FileError, run_command
from runtime.motion.control_scripts import PlanarPose, control_script
from runtime.motion.controller import Controller
from runtime.motion.features import FPS, OUTPUT
from runtime.motion.model import MotionModel, load_model
from runtime.motion.model_files import INT8_GRAPH, PRECISIONS, read_metadata, write_metadata
from runtime.motion.style import Style
from runtime.prompts.prompter import Prompter
from runtime.terrain.library import load_terrain

if TYPE_CHECKING:
    import onnx


# Products that stay in full precision. They are small, and later layers do not average out their error: E's projection
# enters all denoising steps; the head and the expert decoder (`base_weight`, if it is in the graph) output the pose
# itself.
KEPT = ("condition_weight", "head_weight", "base_weight", "encoder_second_bias")
# Limit of `relative_error`. Above it, the last block's second product stays in full precision too: it is small, and its
# error is not averaged out.
MAX_RELATIVE_ERROR = 0.01
LAST_LINEAR = "linear_{}"
# Products before the denoising steps have one row per character and are bound by memory bandwidth: a second row is
# almost free.
REFINED = ("encoder_first", "encoder_second", "front_wide")
REMAINDER_FACTOR = 16.0  # small enough that the second row does not exceed the range of the first
COURSES = (  # prompt, path, gait and terrain of the walks on which the error is measured
    ("a proud queen", "figure8", "walk", "flat"),
    ("walk like a drunk", "random", "walk", "hills"),
    ("an exhausted soldier, left arm hanging", "circle", "walk", "stairs"),
    ("a happy child skipping along", "random", "jog", "hills"),
    ("an old man with a bad back", "forward", "walk", "flat"),
    ("sneak carefully, head down", "random", "crouch", "flat"),
)
WALK_S = 4.0  # length of each walk


@dataclass(frozen=True)
class CalibrationFrames:
    """Inputs of single frames: x `(N, 472)`, noise `(N, steps, K, output)` and their styles."""

    x: Array
    noise: Array
    styles: Sequence[Style]


def quantize_step(source: Path, target: Path, kept: Sequence[str] = ()) -> None:
    """Write the step graph `source` with 8-bit weights, one scale per column, and dynamically scaled activations.

    `kept` names weights that stay in full precision in addition to KEPT.

    Weights are signed, 1.4 times as fast as unsigned on processors that multiply them exactly; for others the runtime
    converts them (`runtime.motion.unsigned_weights`). FileError if `source` is from an older export.
    """
    import onnx
    from onnxruntime.quantization import QuantType, quantize_dynamic

    model = onnx.load(str(source))
    weights = {tensor.name: tuple(tensor.dims) for tensor in model.graph.initializer}
    if not set(REFINED) <= set(weights):
        raise FileError(f"{source}: its layers cannot be identified.", "Export the model again.")
    _refine(model)
    # onnxruntime has no per-column scales for batched matrices (one per expert)
    chosen = [
        node.name
        for node in model.graph.node
        if node.op_type == "MatMul"
        and len(weights.get(node.input[1], ())) == 2
        and node.input[1] not in (*KEPT, *kept)
    ]
    root = logging.getLogger()
    level = root.level
    root.setLevel(logging.ERROR)  # it recommends preprocessing that export_graph has done
    try:
        quantize_dynamic(
            model,
            str(target),
            nodes_to_quantize=chosen,
            op_types_to_quantize=["MatMul"],
            per_channel=True,
            weight_type=QuantType.QInt8,
            extra_options={"MatMulConstBOnly": True},
        )
    finally:
        root.setLevel(level)


def _refine(model: onnx.ModelProto) -> None:
    """Add a second row to the inputs of products in REFINED: their 8-bit rounding error times REMAINDER_FACTOR."""
    from onnx import helper, numpy_helper

    nodes = []
    for name, value in (("remainder", REMAINDER_FACTOR), ("remainder_share", 1.0 / REMAINDER_FACTOR)):
        model.graph.initializer.append(numpy_helper.from_array(np.array(value, np.float32), name))
    for node in model.graph.node:
        if node.op_type != "MatMul" or node.input[1] not in REFINED:
            nodes.append(node)
            continue
        (x, weight), y, p = node.input, node.output[0], f"refined_{node.input[1]}_"
        codes = [p + "codes", p + "scale", p + "zero"]
        nodes += [
            helper.make_node("DynamicQuantizeLinear", [x], codes),
            helper.make_node("DequantizeLinear", codes, [p + "rounded"]),
            helper.make_node("Sub", [x, p + "rounded"], [p + "rest"]),
            helper.make_node("Mul", [p + "rest", "remainder"], [p + "fine"]),
            helper.make_node("Concat", [x, p + "fine"], [p + "both"], axis=0),
            helper.make_node("MatMul", [p + "both", weight], [p + "products"], node.name),
            helper.make_node("Split", [p + "products"], [p + "coarse", p + "small"], axis=0, num_outputs=2),
            helper.make_node("Mul", [p + "small", "remainder_share"], [p + "correction"]),
            helper.make_node("Add", [p + "coarse", p + "correction"], [y]),
        ]
    del model.graph.node[:]
    model.graph.node.extend(nodes)


def quantize_model(
    folder: Path,
    default: str = "int8",
    frames: CalibrationFrames | None = None,
    text_encoder: Path | None = None,
) -> dict[str, object]:
    """Write `step_int8.onnx` into a model folder, and a section with its error, which is returned, into the metadata.

    `default` is the precision that `auto` selects for this model; `frames` default to those of `record_frames`.
    """
    target = folder / f"{INT8_GRAPH}.onnx"
    last = LAST_LINEAR.format(int(read_metadata(folder)["config"]["denoiser_blocks"]) - 1)
    section: dict[str, object] = {}
    for kept in ((), (last,)):
        quantize_step(folder / "step.onnx", target, kept)
        digest = hashlib.sha256(target.read_bytes()).hexdigest()
        _note(folder, {"default": "fp32"}, digest)  # for loading it in the measurement
        frames = frames or record_frames(folder, text_encoder)
        measured = measure(folder, frames)
        section = {"default": default, "kept": list(kept), **measured}
        if measured["relative_error"] <= MAX_RELATIVE_ERROR:
            break
    _note(folder, section, digest)
    return section


def _note(folder: Path, section: dict[str, object], digest: str) -> None:
    metadata = read_metadata(folder)
    metadata["sha256"][INT8_GRAPH] = digest
    metadata["quantised"] = section
    write_metadata(folder, metadata)


class _Recorder(MotionModel):
    """A model that keeps every third frame."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, read_metadata(folder), precision="fp32")
        self.frames_seen = 0
        self.frames: list[tuple[Array, Array, Style]] = []

    def step(self, x: Array, noise: Array, style: Style | Sequence[Style]) -> tuple[Array, Array]:
        self.frames_seen += 1
        if self.frames_seen % 3 == 0 and isinstance(style, Style):
            self.frames.append((x[0].copy(), noise[0].copy(), style))
        return super().step(x, noise, style)


def record_frames(folder: Path, text_encoder: Path | None) -> CalibrationFrames:
    """Record network inputs while walking, jogging and sneaking in six styles, in full precision."""
    model = _Recorder(folder)
    to_style = Prompter(model, text_encoder=text_encoder)
    for seed, (prompt, path, gait, terrain) in enumerate(COURSES):
        controller = Controller(model, load_terrain(terrain), seed)
        controller.set_style(to_style(prompt), 0.0)
        script, pose = control_script(path, gait, 1.0, seed), controller.pose
        for frame in range(round(WALK_S * FPS)):
            x, _, z = pose.root_position
            pose = controller.step(script(frame / FPS, PlanarPose(float(x), float(z), pose.root_yaw)))
    xs, noises, styles = zip(*model.frames, strict=True)
    return CalibrationFrames(np.stack(xs), np.stack(noises), styles)


def measure(folder: Path, frames: CalibrationFrames) -> dict[str, float]:
    """Measure the difference of int8 from fp32 per frame: `relative_error`, and joint positions in mm."""
    full, small = (load_model(folder, precision=precision) for precision in ("fp32", "int8"))
    expected, got = (
        np.concatenate(
            [
                model.step(x[None], noise[None], style)[0]
                for x, noise, style in zip(frames.x, frames.noise, frames.styles, strict=True)
            ]
        )
        for model in (full, small)
    )
    apart = (got - expected)[:, OUTPUT["joint_positions"]].reshape(len(got), -1, 3)
    distance = 1e3 * np.linalg.norm(apart, axis=-1)
    return {
        "relative_error": round(relative_error(expected, got, _deviation(folder / "step.onnx")), 5),
        "joint_error_mm": round(float(distance.mean()), 3),
        "joint_error_max_mm": round(float(distance.max()), 2),
        "frames": len(got),
    }


def relative_error(expected: Array, got: Array, deviation: Array | float = 1.0) -> float:
    """Return the norm of the error of y `(N, output)` over that of y around its mean, entries in standard deviations."""
    spread = (expected - expected.mean(0)) / deviation
    return float(np.linalg.norm((got - expected) / deviation) / np.linalg.norm(spread))


def _deviation(path: Path) -> Array:
    import onnx

    for tensor in onnx.load(str(path)).graph.initializer:
        if tensor.name == "y_deviation":
            return np.asarray(onnx.numpy_helper.to_array(tensor))
    raise FileError(f"{path}: holds no y_deviation.", "Export the model again.")


def main(argv: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="training.export.quantize", description="Quantise a model's step graph to 8 bits."
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--default", choices=PRECISIONS[1:], default="int8", help="precision of `auto`")
    parser.add_argument("--text-encoder", type=Path, help="folder of the model's text encoder")
    options = parser.parse_args(argv)
    section = quantize_model(options.folder, options.default, text_encoder=options.text_encoder)
    print(f"{options.folder / INT8_GRAPH}.onnx: " + ", ".join(f"{k} {v}" for k, v in section.items()))
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("quantize", main))
