"""Another text encoder than the shipped one, by its folder: a small stand-in of CLIP's size, and CLIP's tower itself."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import FileError, ModelError
from runtime.prompts.text_encoder import SHIPPED, TextEncoder, library_encoder, text_encoder_of
from tests.helpers.graphs import save_graph

pytest.importorskip("onnx")
WORDS = ("[START]", "[END]", "left", "right", "arm", "raised", "hanging")
CLIP = {"name": "stand-in", "dimensions": 512}


def write_tokenizer(path: Path) -> None:
    """Words of a small vocabulary between a start and an end token, as CLIP's tokenizer gives them."""
    from tokenizers import Tokenizer, models, pre_tokenizers, processors

    tokenizer = Tokenizer(models.WordLevel({w: k for k, w in enumerate(WORDS)}, unk_token="[END]"))
    tokenizer.pre_tokenizer = pre_tokenizers.Whitespace()
    marks = {"single": "[START] $A [END]", "special_tokens": [("[START]", 0), ("[END]", 1)]}
    tokenizer.post_processor = processors.TemplateProcessing(**marks)
    tokenizer.save(str(path))


def write_encoder(folder: Path, size: int = 512, **metadata: object) -> Path:
    """A text encoder folder whose network averages random word vectors of `size` numbers."""
    folder.mkdir(parents=True, exist_ok=True)
    table = np.random.default_rng(0).standard_normal((len(WORDS), size)).astype(np.float32)
    nodes = [
        ("Gather", "table input_ids", "words", {}),
        ("Cast", "attention_mask", "mask", {"to": 1}),  # real numbers
        ("Unsqueeze", "mask last", "weights", {}),
        ("Mul", "words weights", "kept", {}),
        ("ReduceSum", "kept middle", "embeddings", {"keepdims": 0}),
    ]
    inputs = {name: ["n", "length"] for name in ("input_ids", "attention_mask")}
    constants = {"table": table, "last": np.array([2]), "middle": np.array([1])}
    save_graph(folder / "tower.onnx", nodes, inputs, {"embeddings": ["n", size]}, constants, whole=True)
    write_tokenizer(folder / "tokenizer.json")
    values = {**CLIP, "max_tokens": 77, "graph": "tower.onnx", **metadata}
    (folder / "text_encoder.json").write_text(json.dumps(values), "utf-8")
    return folder


@pytest.fixture(scope="module")
def stand_in(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_encoder(tmp_path_factory.mktemp("encoder"))


def test_a_folder_gives_unit_vectors_of_its_own_size(stand_in: Path) -> None:
    encoder = TextEncoder(stand_in)
    assert (encoder.name, encoder.dimensions) == ("stand-in", 512)
    vectors = encoder.encode(["left arm raised", "right arm hanging"])
    assert vectors.shape == (2, 512)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-6)
    assert vectors[0] @ vectors[1] < 0.9


def test_a_network_of_another_size_than_its_metadata_says_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"tower\.onnx.*\(1, 256\).*\(1, 512\)"):
        TextEncoder(write_encoder(tmp_path, size=256)).encode(["left arm"])


@pytest.mark.parametrize("graph", ["../tower.onnx", "/tower.onnx", ""])
def test_the_network_lies_in_the_folder_itself(tmp_path: Path, graph: str) -> None:
    with pytest.raises(ModelError, match=r"text_encoder\.json"):
        TextEncoder(write_encoder(tmp_path, graph=graph)).encode(["left arm"])


def test_a_model_gets_the_text_encoder_that_it_was_trained_with(tmp_path: Path, stand_in: Path) -> None:
    trained = {"text_encoder": CLIP}
    assert text_encoder_of(trained, tmp_path, stand_in).name == "stand-in"
    # models of version 0.1 name none: they were trained with the shipped one
    assert text_encoder_of({}, tmp_path).name == SHIPPED["name"]
    own = tmp_path / "model"
    write_encoder(own / "text_encoder")
    assert text_encoder_of(trained, own).dimensions == 512


@pytest.mark.parametrize(
    ("metadata", "given"),
    [({"text_encoder": CLIP}, False), ({}, True), ({"text_encoder": {**CLIP, "dimensions": 768}}, True)],
)
def test_a_model_refuses_another_text_encoder(
    tmp_path: Path, stand_in: Path, metadata: dict, given: bool
) -> None:
    with pytest.raises(ModelError, match="trained with the text encoder") as raised:
        text_encoder_of(metadata, tmp_path, stand_in if given else None)
    assert "text_encoder" in raised.value.remedy


@pytest.mark.parametrize("field", ["MiniLM", {"name": "x"}, None])
def test_a_malformed_field_of_the_metadata_is_named(tmp_path: Path, field: object) -> None:
    with pytest.raises(ModelError, match="text_encoder"):
        text_encoder_of({"text_encoder": field}, tmp_path)


def test_the_library_always_compares_by_the_shipped_one(stand_in: Path) -> None:
    shipped = TextEncoder()
    assert library_encoder(shipped) is shipped
    assert library_encoder(TextEncoder(stand_in)).name == SHIPPED["name"]


# --- training
@pytest.mark.needs_torch
def test_the_content_encoder_takes_embeddings_of_any_size() -> None:
    from dataclasses import replace

    import torch

    from training.networks.content import ContentEncoder
    from training.presets import preset

    plain = replace(preset("tiny"), text_size=512, direction_words=False, one_sided_words=False)
    content = ContentEncoder(plain)
    assert content.text(torch.randn(3, 6, 512)).mean.shape == (3, 6, 64)
    with pytest.raises(RuntimeError):
        content.text(torch.randn(3, 6, 384))


def write_clip_folder(folder: Path) -> Path:
    """A CLIP of two narrow layers with random weights, stored as Hugging Face does."""
    import torch

    from training.text.encoders import ClipTextConfig, ClipTextTower

    text = {"vocab_size": len(WORDS), "hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 2}
    text |= {"num_attention_heads": 2, "max_position_embeddings": 12}
    config = {"model_type": "clip", "projection_dim": 512, "text_config": text}
    (folder / "config.json").write_text(json.dumps(config), "utf-8")
    write_tokenizer(folder / "tokenizer.json")
    torch.manual_seed(0)
    tower = ClipTextTower(ClipTextConfig.read(folder / "config.json"))
    names = {
        "token_embedding": "text_model.embeddings.token_embedding",
        "position_embedding": "text_model.embeddings.position_embedding",
        "final_layer_norm": "text_model.final_layer_norm",
        "text_projection": "text_projection",
    }
    layer_names = {
        "query": "self_attn.q_proj", "key": "self_attn.k_proj", "value": "self_attn.v_proj",
        "attention_output": "self_attn.out_proj", "attention_norm": "layer_norm1", "output_norm": "layer_norm2",
        "intermediate": "mlp.fc1", "output": "mlp.fc2",
    }  # fmt: skip
    header, body = {}, b""
    for name, tensor in tower.state_dict().items():
        stem, _, kind = name.rpartition(".")
        if stem.startswith("layers."):
            _, number, inner = stem.split(".")
            stem = f"text_model.encoder.layers.{number}.{layer_names[inner]}"
        data = tensor.numpy().tobytes()
        header[f"{names.get(stem, stem)}.{kind}"] = {
            "dtype": "F32", "shape": list(tensor.shape), "data_offsets": [len(body), len(body) + len(data)],
        }  # fmt: skip
        body += data
    header["vision_model.class_embedding"] = {"dtype": "F32", "shape": [0], "data_offsets": [0, 0]}
    text_header = json.dumps(header).encode()
    (folder / "model.safetensors").write_bytes(struct.pack("<Q", len(text_header)) + text_header + body)
    return folder


@pytest.mark.needs_torch
def test_the_tower_agrees_with_torch_layers(tmp_path: Path) -> None:
    import torch

    from training.text.encoders import load_tower

    tower = load_tower(write_clip_folder(tmp_path))
    ids = torch.tensor([[0, 2, 4, 5, 1]])
    x = tower.token_embedding(ids) + tower.position_embedding.weight[:5]
    for layer in tower.layers:
        attention = torch.nn.MultiheadAttention(16, 2, batch_first=True)
        rows = (layer.query, layer.key, layer.value)
        with torch.no_grad():
            attention.in_proj_weight.copy_(torch.cat([r.weight for r in rows]))
            attention.in_proj_bias.copy_(torch.cat([r.bias for r in rows]))
            attention.out_proj.load_state_dict(layer.attention_output.state_dict())
        y = layer.attention_norm(x)
        causal = torch.triu(torch.ones(5, 5, dtype=torch.bool), 1)
        x = x + attention(y, y, y, attn_mask=causal)[0]
        y = layer.intermediate(layer.output_norm(x))
        x = x + layer.output(y * torch.sigmoid(1.702 * y))
    expected = torch.nn.functional.normalize(tower.text_projection(tower.final_layer_norm(x)[:, -1]), dim=-1)
    padded = torch.tensor([[0, 2, 4, 5, 1, 1, 1]])
    mask = torch.tensor([[1, 1, 1, 1, 1, 0, 0]])
    with torch.no_grad():
        torch.testing.assert_close(tower(ids, torch.ones_like(ids)), expected)
        torch.testing.assert_close(tower(padded, mask), expected)  # what follows the text does not count


@pytest.mark.needs_torch
@pytest.mark.parametrize("precision", ["float32", "int8"])
def test_clip_becomes_a_text_encoder_folder(tmp_path: Path, precision: str) -> None:
    from training.text.export_clip import export_clip

    weights = tmp_path / "clip"
    weights.mkdir()
    cosine = export_clip(write_clip_folder(weights), tmp_path / "out", "CLIP tiny", precision)
    assert cosine > (0.9999 if precision == "float32" else 0.97)
    encoder = TextEncoder(tmp_path / "out")
    assert (encoder.name, encoder.dimensions) == ("CLIP tiny", 512)
    long = encoder.encode(["left arm " * 40, "left arm " * 50])
    np.testing.assert_array_equal(long[0], long[1])  # cut after the tower's 12 positions


@pytest.mark.needs_torch
@pytest.mark.parametrize("damage", ["config.json", "tokenizer.json", "model.safetensors", "another network"])
def test_a_folder_that_is_no_clip_is_named(tmp_path: Path, damage: str) -> None:
    from training.text.export_clip import export_clip

    write_clip_folder(tmp_path)
    if damage == "another network":
        config = json.loads((tmp_path / "config.json").read_text("utf-8"))
        config["text_config"]["hidden_size"] = 32
        (tmp_path / "config.json").write_text(json.dumps(config), "utf-8")
    else:
        (tmp_path / damage).unlink()
    with pytest.raises(FileError) as raised:
        export_clip(tmp_path, tmp_path / "out")
    assert raised.value.remedy
    assert str(tmp_path) in str(raised.value)
