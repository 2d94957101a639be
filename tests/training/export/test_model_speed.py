"""The exported step: a style for each character, its 8-bit twin, and no processor time while it waits."""

import contextlib
import json
import shutil
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from runtime.errors import FileError, ModelError
from runtime.motion.features import OUTPUT
from runtime.motion.model import load_model
from runtime.motion.model_files import PRODUCT, signed_products_are_exact
from runtime.motion.unsigned_weights import unsigned_weights
from training.export.graph import store_in_half
from training.export.quantize import KEPT, CalibrationFrames, main, quantize_model, quantize_step

pytestmark = pytest.mark.needs_torch


@pytest.fixture(scope="module")
def folder(exported_tiny):
    return exported_tiny


@pytest.fixture(scope="module")
def frames(folder):
    random = np.random.default_rng(1)
    model = load_model(folder)
    x, noise = (random.standard_normal((40, *shape), np.float32) for shape in ((472,), model.noise_shape))
    codes = random.standard_normal((40, 6, 64), np.float32)
    return CalibrationFrames(x, noise, [model.fold_style(code) for code in codes])


@pytest.fixture(scope="module")
def quantised(folder, frames, tmp_path_factory):
    path = tmp_path_factory.mktemp("quantised") / "model"
    shutil.copytree(folder, path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("training.export.quantize.MAX_RELATIVE_ERROR", 1.0)
        return path, quantize_model(path, frames=frames)


def single_steps(model, frames, count):
    rows = [(frames.x[i : i + 1], frames.noise[i : i + 1], frames.styles[i]) for i in range(count)]
    return np.concatenate([model.step(*row)[0] for row in rows])


def test_a_style_for_each_character_is_as_if_each_were_alone(folder, frames):
    model = load_model(folder)
    alone = single_steps(model, frames, 8)
    together, alpha = model.step(frames.x[:8], frames.noise[:8], frames.styles[:8])
    assert np.abs(together - alone).max() < 1e-4
    assert alpha.shape == (8, 8)
    assert np.abs(alone - model.step(frames.x[:8], frames.noise[:8], frames.styles[0])[0])[1:].max() > 1e-3
    shared, _ = model.step(frames.x[:8], frames.noise[:8], frames.styles[3])
    listed, _ = model.step(frames.x[:8], frames.noise[:8], [frames.styles[3]] * 8)
    assert np.abs(shared - listed).max() < 1e-4
    with pytest.raises(ModelError, match="3 styles for 4 characters"):
        model.step(frames.x[:4], frames.noise[:4], frames.styles[:3])


def test_the_unrolled_frame_is_the_plain_one(frames):
    """Folding, hoisting and laying out the weights anew changes nothing but the speed."""
    from tests.helpers.tiny_model import tiny_trained
    from training.export.step import PlainGraph, StepGraph

    trained = tiny_trained()
    z = torch.randn(2, 384)
    x, noise = torch.tensor(frames.x[:2]), torch.tensor(frames.noise[:2])
    with torch.no_grad():
        plain = PlainGraph(trained.generator, trained.normal, trained.steps)(x, z, noise)
        folds = [trained.generator.modulator.fold(one[None]) for one in z]
        folded = [torch.stack(tensors) for tensors in zip(*folds, strict=True)]
        fast, _ = StepGraph(trained.generator, trained.normal, trained.steps)(x, noise, *folded)
    assert torch.allclose(plain, fast, atol=1e-4)


def test_the_8_bit_twin_is_near_and_says_how_near(quantised, frames):
    path, section = quantised
    full, small = load_model(path, precision="fp32"), load_model(path, precision="int8")
    assert (full.precision, small.precision) == ("fp32", "int8")
    expected, got = single_steps(full, frames, 40), single_steps(small, frames, 40)
    assert not np.array_equal(expected, got)
    assert 0.0 < section["relative_error"] < 0.03
    apart = (got - expected)[:, OUTPUT["joint_positions"]].reshape(40, 31, 3)
    apart = np.linalg.norm(apart, axis=-1)
    assert 1e3 * apart.max() == pytest.approx(section["joint_error_max_mm"], abs=0.01)
    assert json.loads((path / "metadata.json").read_text())["quantised"] == section


def test_what_is_sensitive_stays_in_full_precision(quantised):
    model = onnx.load(quantised[0] / "step_int8.onnx")
    floats = {t.name for t in model.graph.initializer if t.data_type == onnx.TensorProto.FLOAT}
    eight = {t.name for t in model.graph.initializer if t.data_type == onnx.TensorProto.INT8}
    present = {t.name for t in onnx.load(quantised[0] / "step.onnx").graph.initializer}
    assert {"condition_weight", "head_weight"} <= set(KEPT) & present <= floats
    assert {"encoder_first_quantized", "convolution_0_quantized", "linear_0_quantized"} <= eight
    products = [n for n in model.graph.node if n.op_type == "MatMulInteger"]
    assert len(products) == 3 + 5 * 3  # encoder and front; code, convolution and linear in each of five steps


def test_where_8_bits_cost_too_much_the_last_product_stays_in_full_precision(
    folder, frames, quantised, tmp_path, monkeypatch
):
    monkeypatch.setattr("training.export.quantize.MAX_RELATIVE_ERROR", 0.0)
    copy = shutil.copytree(folder, tmp_path / "model")
    sections = quantised[1], quantize_model(copy, frames=frames)
    for path, section, kept in zip((quantised[0], copy), sections, ([], ["linear_0"]), strict=True):
        assert section["kept"] == kept
        names = {t.name for t in onnx.load(path / "step_int8.onnx").graph.initializer}
        assert ("linear_0" in names) == bool(kept)


def test_the_metadata_say_what_auto_means(quantised, frames, tmp_path):
    path, section = quantised
    assert section["default"] == "int8"
    assert load_model(path).precision == "int8"
    assert load_model(path, precision="fp32").precision == "fp32"
    copy = tmp_path / "model"
    shutil.copytree(path, copy)
    assert quantize_model(copy, "fp32", frames)["default"] == "fp32"
    assert load_model(copy).precision == "fp32"
    assert load_model(copy, precision="int8").precision == "int8"


def test_a_missing_or_damaged_8_bit_graph_is_named_with_its_remedy(folder, quantised, tmp_path):
    with pytest.raises(ModelError, match="no 8-bit graph") as error:
        load_model(folder, precision="int8")
    assert "training.export.quantize" in str(error.value)
    with pytest.raises(ModelError, match="precision int3"):
        load_model(folder, precision="int3")
    shutil.copytree(quantised[0], tmp_path / "model")
    graph = tmp_path / "model" / "step_int8.onnx"
    data = bytearray(graph.read_bytes())
    data[len(data) // 2] ^= 1
    graph.write_bytes(bytes(data))
    load_model(tmp_path / "model", precision="fp32")  # which needs none of it
    with pytest.raises(ModelError, match="damaged"):
        load_model(tmp_path / "model", precision="int8")
    graph.unlink()
    with pytest.raises(ModelError, match="No such file"):
        load_model(tmp_path / "model", precision="int8")


def test_an_unknown_default_in_the_metadata_is_refused(quantised, tmp_path):
    shutil.copytree(quantised[0], tmp_path / "model")
    path = tmp_path / "model" / "metadata.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"quantised": {"default": "int2"}}))
    with pytest.raises(ModelError, match="neither fp32 nor int8"):
        load_model(tmp_path / "model")


def test_a_graph_of_an_older_export_cannot_be_quantised(folder, tmp_path):
    with pytest.raises(FileError, match="Export the model again"):
        quantize_step(folder / "style.onnx", tmp_path / "out.onnx")


def test_the_command_measures_the_models_own_walks(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("training.export.quantize.COURSES", (("a proud queen", "circle", "walk", "flat"),))
    monkeypatch.setattr("training.export.quantize.WALK_S", 1.0)
    shutil.copytree(folder, tmp_path / "model")
    assert main([str(tmp_path / "model")]) == 0
    assert "relative_error" in capsys.readouterr().out
    assert json.loads((tmp_path / "model" / "metadata.json").read_text())["quantised"]["frames"] == 20


def test_an_idle_model_takes_no_processor_time(folder):
    options = load_model(folder, threads=2)._step.get_session_options()
    assert options.get_session_config_entry("session.force_spinning_stop") == "1"


def product_graph(path: Path, weights: np.ndarray, raw: bool) -> bytes:
    """a `(m, 64)` times int8 weights with a zero point for each column, which is 0 as in the 8-bit graph."""
    a = helper.make_tensor_value_info("a", TensorProto.UINT8, ["m", 64])
    y = helper.make_tensor_value_info("y", TensorProto.INT32, ["m", 16])
    bare = helper.make_tensor("b", TensorProto.INT8, weights.shape, weights.ravel())
    stored = numpy_helper.from_array(weights, "b") if raw else bare
    zeros = [helper.make_tensor("z", TensorProto.INT8, [16], [0] * 16)]
    zeros += [helper.make_tensor("u", TensorProto.UINT8, [], [0])]
    node = helper.make_node("MatMulInteger", ["a", "b", "u", "z"], ["y"])
    graph = helper.make_graph([node], "g", [a], [y], [stored, *zeros])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    return model.SerializeToString()


@pytest.mark.parametrize("raw", [True, False])
def test_unsigned_weights_give_the_same_whole_numbers_without_overflow(tmp_path, raw):
    random = np.random.default_rng(2)
    weights = random.integers(-127, 128, (64, 16), np.int8)
    weights[:, 0] = 127  # with the largest activations more than 16 bits hold
    changed = unsigned_weights(product_graph(tmp_path, weights, raw))
    a = np.vstack([np.full((1, 64), 255, np.uint8), random.integers(0, 256, (3, 64), np.uint8)])
    (y,) = onnxruntime.InferenceSession(changed, providers=["CPUExecutionProvider"]).run(None, {"a": a})
    assert np.array_equal(y, a.astype(np.int32) @ weights.astype(np.int32))


@given(st.integers(0, len(PRODUCT) - 1), st.binary(max_size=4))
def test_a_damaged_graph_is_a_value_error_or_bytes(at, damage):
    with contextlib.suppress(ValueError):
        unsigned_weights(PRODUCT[:at] + damage + PRODUCT[at + len(damage) :])


def test_a_processor_that_overflows_walks_by_the_same_numbers(quantised, frames, monkeypatch):
    got = []
    for exact in (True, False):
        monkeypatch.setattr("runtime.motion.model_files.signed_products_are_exact", lambda exact=exact: exact)
        got.append(single_steps(load_model(quantised[0], precision="int8"), frames, 8))
    if signed_products_are_exact():
        np.testing.assert_array_equal(*got)
    full = single_steps(load_model(quantised[0], precision="fp32"), frames, 8)
    assert np.abs(got[1] - full).max() < 0.2 * np.abs(full).max()


def test_products_added_in_16_bits_are_found_out(monkeypatch):
    saturated = np.full((2, 16), 32 * 32767, np.int32)  # the largest that pairs of 255 x 127 give in 16 bits
    exact = np.full((2, 16), 64 * 255 * 127, np.int32)

    def answer(y):
        session = type("Session", (), {"__init__": lambda *_, **__: None, "run": lambda *_: (y,)})
        monkeypatch.setattr("onnxruntime.InferenceSession", session)
        return signed_products_are_exact.__wrapped__()

    assert answer(exact)
    assert not answer(saturated)


# --- weights in half precision
SIZE = 96


def write_graph(path: Path, weights: np.ndarray) -> None:
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, [None, SIZE])
    y = helper.make_tensor_value_info("y", TensorProto.FLOAT, [None, SIZE])
    bias = numpy_helper.from_array(np.ones(SIZE, np.float32), "bias")
    nodes = [helper.make_node("MatMul", ["x", "w"], ["p"]), helper.make_node("Add", ["p", "bias"], ["y"])]
    graph = helper.make_graph(nodes, "g", [x], [y], [numpy_helper.from_array(weights, "w"), bias])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), str(path))


def output_of(path: Path, x: np.ndarray) -> np.ndarray:
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"]).run(None, {"x": x})[0]


def test_half_the_bytes_and_nearly_the_same_numbers(tmp_path: Path) -> None:
    path = tmp_path / "g.onnx"
    generator = np.random.default_rng(0)
    write_graph(path, generator.normal(size=(SIZE, SIZE)).astype(np.float32))
    x = generator.normal(size=(5, SIZE)).astype(np.float32)
    before, size = output_of(path, x), path.stat().st_size
    assert store_in_half(path) == 1  # the weights, not the bias
    assert path.stat().st_size < 0.55 * size
    error = np.linalg.norm(output_of(path, x) - before) / np.linalg.norm(before)
    assert 0.0 < error < 1e-3


def test_weights_beyond_the_range_of_half_precision_and_half_ones_stay(tmp_path: Path) -> None:
    path = tmp_path / "g.onnx"
    for most, stored in ((1e5, 0), (1.0, 1)):
        write_graph(path, np.full((SIZE, SIZE), most, np.float32))
        assert store_in_half(path) == stored
        before = path.read_bytes()
        assert store_in_half(path) == 0
        assert path.read_bytes() == before
