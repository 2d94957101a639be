"""The shipped text encoder: what it says of sentences, and what it says when its files are damaged."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.errors import ModelError
from runtime.prompts.text_encoder import TextEncoder


@pytest.fixture(scope="module")
def encoder() -> TextEncoder:
    return TextEncoder()


def test_vectors_are_unit_and_of_the_promised_size(encoder: TextEncoder) -> None:
    vectors = encoder.encode(["left arm hanging", "x", "頭を下げる 🙂"])
    assert vectors.shape == (3, 384) == (3, encoder.dimensions)
    assert vectors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-5)


def test_no_texts_give_no_vectors(encoder: TextEncoder) -> None:
    assert encoder.encode([]).shape == (0, 384)


@pytest.mark.parametrize(
    ("a", "near", "far"),
    [
        ("an exhausted soldier", "a weary warrior", "a cheerful dancer"),
        ("left arm raised overhead", "left hand lifted high above the head", "right leg limping"),
        ("head hanging down, looking at the ground", "head lowered, gaze on the floor", "torso leaning back"),
        ("a drunk man", "an intoxicated person", "a heavy suitcase"),
    ],
)
def test_likeness_follows_meaning(encoder: TextEncoder, a: str, near: str, far: str) -> None:
    vectors = encoder.encode([a, near, far])
    assert vectors[0] @ vectors[1] > 0.55
    assert vectors[0] @ vectors[1] > vectors[0] @ vectors[2] + 0.15


def test_a_vector_does_not_depend_on_its_neighbours_or_the_cache(encoder: TextEncoder) -> None:
    texts = ["short", "a much longer sentence about a torso that sways from side to side with each step"]
    together = encoder.encode(texts)
    again = encoder.encode(texts[::-1])[::-1]
    alone = np.concatenate([TextEncoder().encode([text]) for text in texts])
    np.testing.assert_array_equal(together, again)
    np.testing.assert_array_equal(together, alone)


def test_long_texts_are_cut_after_128_tokens(encoder: TextEncoder) -> None:
    head = "step " * 200
    a, b = encoder.encode([head, head + "and then a chicken"])
    np.testing.assert_array_equal(a, b)


def _copy(target: Path) -> Path:
    for name in ("minilm_int8.onnx", "tokenizer.json", "text_encoder.json"):
        shutil.copy(asset_path(f"text/{name}"), target / name)
    return target


@pytest.mark.parametrize("name", ["minilm_int8.onnx", "tokenizer.json", "text_encoder.json"])
@pytest.mark.parametrize("damage", ["truncated", "missing"])
def test_damaged_files_are_named(tmp_path: Path, name: str, damage: str) -> None:
    path = _copy(tmp_path) / name
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ModelError, match=name) as raised:
        TextEncoder(tmp_path).encode(["a"])
    assert raised.value.remedy


def test_a_network_of_another_kind_is_refused(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper

    node = helper.make_node("Identity", ["x"], ["y"])
    tensors = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1]) for n in "xy"]
    graph = helper.make_graph([node], "g", tensors[:1], tensors[1:])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, _copy(tmp_path) / "minilm_int8.onnx")
    with pytest.raises(ModelError, match="input_ids"):
        TextEncoder(tmp_path).encode(["a"])


@pytest.mark.needs_torch
def test_plain_torch_encoder_agrees_with_itself_under_padding() -> None:
    import torch

    from training.text.encoders import BertConfig, SentenceEncoder

    torch.manual_seed(0)
    sizes = {"vocab_size": 50, "hidden_size": 24, "intermediate_size": 32}
    config = BertConfig(num_hidden_layers=2, num_attention_heads=3, **sizes)
    network = SentenceEncoder(config).eval()
    ids = torch.randint(1, 50, (1, 5))
    padded = torch.cat([ids, torch.zeros(1, 3, dtype=torch.long)], dim=1)
    mask = torch.tensor([[1, 1, 1, 1, 1, 0, 0, 0]])
    with torch.no_grad():
        alone, batched = network(ids, torch.ones_like(ids)), network(padded, mask)
    torch.testing.assert_close(alone, batched, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(alone.norm(dim=1), torch.ones(1))
