"""Files of a model folder, treated as untrusted: metadata and graphs are checked in full before use."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.atomic import write_atomic
from runtime.errors import ModelError
from runtime.motion.features import INPUT, INPUT_SIZE, LAYOUT_VERSION, OUTPUT_SIZE, C
from runtime.motion.unsigned_weights import unsigned_weights
from runtime.safe_read import is_text, parse_json, read_bounded, reason
from runtime.skeleton import PART_NAMES, SPORT_SKELETON
from runtime.terrain.obstacle_detection import ObstacleKind

if TYPE_CHECKING:
    import onnxruntime

# An ONNX graph of one MatMulInteger, y = a b with a unsigned and b signed, as in `step_int8.onnx`. Stored as bytes,
# because the runtime does not depend on the package that would build it.
PRODUCT = (
    b'\x08\x08:b\n\x18\n\x01a\n\x01b\x12\x01y"\rMatMulInteger\x12\x01p'
    b"Z\x15\n\x01a\x12\x10\n\x0e\x08\x02\x12\n\n\x03\x12\x01m\n\x03\x12\x01k"
    b"Z\x15\n\x01b\x12\x10\n\x0e\x08\x03\x12\n\n\x03\x12\x01k\n\x03\x12\x01n"
    b"b\x15\n\x01y\x12\x10\n\x0e\x08\x06\x12\n\n\x03\x12\x01m\n\x03\x12\x01nB\x04\n\x00\x10\x12"
)


@cache
def signed_products_are_exact() -> bool:
    """Return whether onnxruntime multiplies signed 8-bit weights without overflow, tested with the largest values.

    False on processors without VNNI (Intel before Ice Lake, AMD before Zen 4).
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(PRODUCT, options, providers=["CPUExecutionProvider"])
    a, b = np.full((2, 64), 255, np.uint8), np.full((64, 16), 127, np.int8)
    (y,) = session.run(None, {"a": a, "b": b})
    return bool(np.array_equal(y, a.astype(np.int32) @ b.astype(np.int32)))


MAX_METADATA_BYTES = 16 * 1024 * 1024
MAX_GRAPH_BYTES = 1024 * 1024 * 1024
MAX_NAME = 200
USUAL_STYLE_SIZE = 384  # style size of models that do not specify it: 64 numbers for each body part
MAX_EXPERTS, MAX_CODE_SIZE = 1024, 4096
MAX_START = 1e4  # metres and the like
REMEDY = "Install the program again, or name another model folder."
FOLDED = ("front_bias", "content_weight", "content_bias")  # inputs that a folded style supplies
INT8_GRAPH = "step_int8"  # optional twin of "step" with 8-bit weights (python -m training.export.quantize)
PRECISIONS = ("auto", "fp32", "int8")
_Shapes = dict[str, list[int | None] | None]  # by name in order; None stands for any number or shape
_JSON_NAMES: dict[type, str] = {str: "string", dict: "object", list: "list"}
_FIELDS: dict[str, type] = {
    "name": str, "config": dict, "reverse_steps": list, "sha256": dict, "joints": list, "start": dict,
}  # fmt: skip


def write_metadata(folder: Path, metadata: dict[str, Any]) -> None:
    """Write metadata.json into a model folder."""
    write_atomic(folder / "metadata.json", json.dumps(metadata, indent=1) + "\n")


def read_metadata(folder: Path) -> dict[str, Any]:
    """Read and check the metadata of a model folder; ModelError names the file, the field and what was expected."""
    path = folder / "metadata.json"
    data = read_bounded(path, MAX_METADATA_BYTES, REMEDY, missing=REMEDY, error=ModelError)
    try:
        metadata = parse_json(data)
    except ValueError as error:
        raise ModelError(f"{path}: not valid JSON.", REMEDY) from error
    _check_metadata(path, metadata)
    return metadata


def read_crosses(folder: Path, metadata: dict[str, Any]) -> dict[str, float]:
    """Return the largest obstacle (metres) of each kind that the network crosses by itself; empty if the model has no such data."""
    crosses = metadata.get("crosses", {})
    kinds = {kind.value for kind in ObstacleKind}
    if not isinstance(crosses, dict) or not crosses.keys() <= kinds:
        raise ModelError(f"{folder / 'metadata.json'}: field 'crosses' names other obstacles.", REMEDY)
    _check_numbers(folder / "metadata.json", "crosses", list(crosses.values()), len(crosses))
    return {kind: float(size) for kind, size in crosses.items()}


def _check_metadata(path: Path, metadata: Any) -> None:
    if not isinstance(metadata, dict) or metadata.get("format") != "sport-model":
        raise ModelError(f"{path}: not the metadata of a SPORT model.", REMEDY)
    version = metadata.get("layout_version")
    if version != LAYOUT_VERSION or isinstance(version, bool):
        raise ModelError(
            f"{path}: field 'layout_version' is {repr(version)[:40]}, this program needs {LAYOUT_VERSION}.",
            "Export the model again with this version of the program.",
        )
    wrong = [field for field, kind in _FIELDS.items() if not isinstance(metadata.get(field), kind)]
    if wrong:
        problem = f"is not a JSON {_JSON_NAMES[_FIELDS[wrong[0]]]}" if wrong[0] in metadata else "is missing"
        raise ModelError(f"{path}: field '{wrong[0]}' {problem}.", REMEDY)
    _check_names(path, metadata["name"], metadata["joints"])
    _check_config(path, metadata["config"])
    for field, count in (("output", OUTPUT_SIZE), ("phase", INPUT["phase"].stop - INPUT["phase"].start)):
        _check_numbers(path, f"start.{field}", metadata["start"].get(field), count)


def _check_names(path: Path, name: Any, joints: list[Any]) -> None:
    if not is_text(name) or len(name) > MAX_NAME:
        raise ModelError(f"{path}: field 'name' is not a name of up to {MAX_NAME} characters.", REMEDY)
    if tuple(joints) != SPORT_SKELETON.names:
        raise ModelError(f"{path}: field 'joints' names another skeleton.", REMEDY)


def _check_config(path: Path, config: dict[str, Any]) -> None:
    if config.get("output_size") != OUTPUT_SIZE:
        raise ModelError(
            f"{path}: output size {str(config.get('output_size'))[:40]}, the viewer needs {OUTPUT_SIZE}"
            " (with joint rotations).",
            "Train a preset with rotations.",
        )
    experts = config.get("experts")
    if type(experts) is not int or not 1 <= experts <= MAX_EXPERTS:
        raise ModelError(f"{path}: field 'config.experts' is not a number of experts.", REMEDY)
    size = config.get("style_size", USUAL_STYLE_SIZE)
    if type(size) is not int or not len(PART_NAMES) <= size <= len(PART_NAMES) * MAX_CODE_SIZE:
        raise ModelError(f"{path}: field 'config.style_size' is not a size of six codes.", REMEDY)


def _check_numbers(path: Path, field: str, values: Any, count: int) -> None:
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if array.shape != (count,) or not np.all(np.abs(array) <= MAX_START):
        raise ModelError(f"{path}: field '{field}' is not a list of {count} finite numbers.", REMEDY)


def choose_precision(folder: Path, metadata: dict[str, Any], wanted: str) -> str:
    """Return the precision to load, fp32 or int8, for one of PRECISIONS; `auto` is the model's default.

    Raises ModelError if int8 is requested but missing, or the metadata has an unknown default.
    """
    path = folder / "metadata.json"
    quantised = metadata.get("quantised", {})
    if not isinstance(quantised, dict) or quantised.get("default", "fp32") not in PRECISIONS[1:]:
        raise ModelError(f"{path}: field 'quantised.default' is neither fp32 nor int8.", REMEDY)
    if wanted not in PRECISIONS:
        raise ModelError(f"precision {wanted[:40]}: unknown.", f"Use one of {', '.join(PRECISIONS)}.")
    precision = str(quantised.get("default", "fp32")) if wanted == "auto" else wanted
    if precision == "int8" and INT8_GRAPH not in metadata["sha256"]:
        raise ModelError(
            f"{path}: the model has no 8-bit graph ({INT8_GRAPH}.onnx).",
            f"Make it with `python -m training.export.quantize {folder}`, or load the model with precision fp32.",
        )
    return precision


def read_graph(folder: Path, name: str, metadata: dict[str, Any]) -> bytes:
    """Read `name`.onnx of a model folder; ModelError unless it matches the metadata's hash."""
    path = folder / f"{name}.onnx"
    data = read_bounded(path, MAX_GRAPH_BYTES, REMEDY, missing=REMEDY, error=ModelError)
    if hashlib.sha256(data).hexdigest() != metadata["sha256"].get(name):
        raise ModelError(f"{path}: damaged, or from another export than metadata.json.", REMEDY)
    return data


def open_graph(path: Path, data: bytes, threads: int) -> onnxruntime.InferenceSession:
    """Open a CPU session that does not spin while idle; ModelError if `data`, read from `path`, is not a network.

    If products of signed weights overflow on this processor, 8-bit weights are made unsigned.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    # A frame is some hundred short products. Waking a second thread for each costs more than it gains, so threads spin
    # between the products, but never beyond the frame.
    options.add_session_config_entry("session.intra_op.allow_spinning", "1" if threads > 1 else "0")
    options.add_session_config_entry("session.force_spinning_stop", "1")
    try:
        if path.stem == INT8_GRAPH and not signed_products_are_exact():
            data = unsigned_weights(data)
        session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        # would keep a copy of the file to change the provider later, which never happens
        session._model_bytes = None
        check_names(session)
        return session
    except Exception as error:  # onnxruntime raises a dozen unrelated types for a damaged graph
        problem = f"not a graph that onnxruntime {onnxruntime.__version__} can load"
        raise ModelError(f"{path}: {problem}.", REMEDY) from error


def check_names(session: onnxruntime.InferenceSession) -> None:
    """Raise UnicodeDecodeError if an input or output of a damaged graph has an undecodable name."""
    for value in (*session.get_inputs(), *session.get_outputs()):
        _ = value.name, value.shape


def run_graph(
    session: onnxruntime.InferenceSession, path: Path, names: list[str] | None, feed: dict[str, Any]
) -> list[Any]:
    """Run a graph read from `path` and return its outputs; ModelError if it fails."""
    try:
        return list(session.run(names, feed))
    except Exception as error:  # onnxruntime's exceptions have no common base class but Exception
        raise ModelError(f"{path}: the graph fails ({reason(error)}).", REMEDY) from error


def check_graphs(
    folder: Path,
    prompt: onnxruntime.InferenceSession,
    style: onnxruntime.InferenceSession,
    step: onnxruntime.InferenceSession,
    noise_shape: tuple[int, int, int],
    style_shape: tuple[int, int] = (6, 64),
    step_name: str = "step",
) -> bool:
    """Return whether `step` takes one style per character; ModelError if the graphs do not fit the program or each other."""
    prompt_path = folder / "prompt.onnx"
    _check_shapes(prompt_path, prompt.get_inputs(), {"embeddings": [None, len(PART_NAMES), None]})
    # after z come the distribution's parameters, which the evaluation compares (models of version 0.1 lack them)
    _check_shapes(prompt_path, prompt.get_outputs()[:1], {"z": [None, *style_shape]})
    style_path, step_path = folder / "style.onnx", folder / f"{step_name}.onnx"
    _check_shapes(style_path, style.get_inputs(), {"z": [*style_shape]})
    # walk and jog speed; then amplitude and rate of each channel at rest, which models of version 0.3 lack
    speeds: list[int | None] = [2 if list(style.get_outputs()[-1].shape) == [2] else 2 + 2 * C]
    _check_shapes(style_path, style.get_outputs(), {**dict.fromkeys(FOLDED), "speeds": speeds})
    folded = {value.name: list(value.shape) for value in style.get_outputs() if value.name in FOLDED}
    # models of version 0.1 take one style for all characters, without a batch dimension
    bias = next((value for value in step.get_inputs() if value.name == FOLDED[0]), None)
    apart = bias is not None and len(bias.shape) > len(folded[FOLDED[0]])
    leading = [None] if apart else []
    taken: _Shapes = {name: [*leading, *shape] for name, shape in folded.items()}
    inputs: _Shapes = {"x": [None, INPUT_SIZE], "noise": [None, *noise_shape], **taken}
    _check_shapes(step_path, step.get_inputs(), inputs)
    _check_shapes(step_path, step.get_outputs(), {"y": [None, OUTPUT_SIZE], "alpha": [None, noise_shape[1]]})
    return apart


def _check_shapes(path: Path, values: Any, expected: _Shapes) -> None:
    found = {value.name: list(value.shape) for value in values}
    if list(found) != list(expected):
        raise ModelError(f"{path}: has {', '.join(found)[:80]}; expected {', '.join(expected)}.", REMEDY)
    for name, shape in expected.items():
        if not _fits(found[name], shape):
            sizes = found[name]
            wanted = ", ".join("any" if size is None else str(size) for size in shape or [])
            raise ModelError(f"{path}: '{name}' has shape {sizes}; expected ({wanted}).", REMEDY)


def _fits(sizes: list[Any], shape: list[Any] | None) -> bool:
    """Return whether a graph's sizes, where they are known, match a shape; None matches all."""
    if shape is None:
        return True
    return len(sizes) == len(shape) and all(w in (None, s) for w, s in zip(shape, sizes, strict=True))
