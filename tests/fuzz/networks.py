"""A model folder and a text encoder of a few hundred bytes that load and walk: what mutated graphs are made from."""

import hashlib
import json
from pathlib import Path

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from runtime.assets import asset_path

DIMENSIONS = 8
GRAPHS = ("prompt", "style", "step")


def _graph(
    inputs: dict[str, tuple[int, list[int | str]]],
    outputs: dict[str, tuple[np.ndarray, list[int | str]]],
    source: str,
) -> bytes:
    """A graph whose outputs are constants, plus a millionth of the mean of the input `source` where they have rows."""
    nodes = [
        helper.make_node("Cast", [source], ["real"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["real"], ["mean"], axes=[-1], keepdims=1),
        helper.make_node("Mul", ["mean", "small"], ["little"]),
    ]
    weights = [numpy_helper.from_array(np.array(1e-6, np.float32), "small")]
    for name, (value, _) in outputs.items():
        weights.append(numpy_helper.from_array(value.astype(np.float32), f"{name}_value"))
        added = ("Identity", [f"{name}_value"]) if value.ndim == 1 else ("Add", ["little", f"{name}_value"])
        nodes.append(helper.make_node(*added, [name]))
    info = helper.make_tensor_value_info
    taken = [info(name, kind, shape) for name, (kind, shape) in inputs.items()]
    given = [info(name, TensorProto.FLOAT, shape) for name, (_, shape) in outputs.items()]
    graph = helper.make_graph(nodes, "tiny", taken, given, weights)
    opset = [helper.make_opsetid("", 13)]
    return helper.make_model(graph, opset_imports=opset, ir_version=8).SerializeToString()


def write_model(folder: Path) -> Path:
    """A model folder in `folder` that stands still, with its text encoder in the folder of that."""
    metadata = json.loads(asset_path("models/compact/metadata.json").read_text("utf-8"))
    real, start = TensorProto.FLOAT, np.array(metadata["start"]["output"], np.float32)
    biases = dict.fromkeys(("front_bias", "content_weight", "content_bias"), (np.zeros((6, 4)), [6, 4]))
    folded: dict[str, tuple[np.ndarray, list[int | str]]] = dict(biases)
    seen: dict[str, tuple[int, list[int | str]]]
    seen = {"x": (real, ["batch", 472]), "noise": (real, ["batch", 5, 8, 473])}
    shown: dict[str, tuple[np.ndarray, list[int | str]]]
    shown = {"y": (start[None], ["batch", 473]), "alpha": (np.full((1, 8), 0.125), ["batch", 8])}
    words = {"embeddings": (real, ["batch", 6, DIMENSIONS])}
    graphs = {
        "prompt": _graph(words, {"z": (np.zeros((1, 6, 64)), ["batch", 6, 64])}, "embeddings"),
        "style": _graph({"z": (real, [6, 64])}, folded | {"speeds": (np.array([1.2, 2.5]), [2])}, "z"),
        "step": _graph(seen | {name: (real, ["styles", 6, 4]) for name in folded}, shown, "x"),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in graphs.items():
        (folder / f"{name}.onnx").write_bytes(data)
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in graphs.items()}
    metadata |= {"name": "tiny", "sha256": hashes, "quantised": {}, "notes": {}}
    metadata["text_encoder"] = {"name": "tiny", "dimensions": DIMENSIONS}
    (folder / "metadata.json").write_text(json.dumps(metadata), encoding="utf-8")
    write_text_encoder(folder / "text_encoder")
    return folder


def write_text_encoder(folder: Path, unigram: bool = False) -> Path:
    """A text encoder of `DIMENSIONS` numbers whose tokenizer knows a dozen words; `unigram`: pieces, as for many languages."""
    from tokenizers import Tokenizer, models, normalizers, pre_tokenizers

    folder.mkdir(parents=True, exist_ok=True)
    words = ["[UNK]", "a", "walk", "proud", "drunk", "left", "right", "arm", "leg", "torso", "head", "slowly"]
    tokenizer = Tokenizer(models.WordLevel({word: i for i, word in enumerate(words)}, unk_token="[UNK]"))
    tokenizer.pre_tokenizer = pre_tokenizers.Whitespace()
    if unigram:
        pieces = [(f"\u2581{word}", -1.0 - k / 10) for k, word in enumerate(words)]
        pieces += [("é", -4.0), ("a", -5.0)]
        tokenizer = Tokenizer(models.Unigram([("<unk>", 0.0), *pieces], unk_id=0, byte_fallback=False))
        tokenizer.normalizer = normalizers.NFKC()
        tokenizer.pre_tokenizer = pre_tokenizers.Metaspace()
    (folder / "tokenizer.json").write_text(tokenizer.to_str(), encoding="utf-8")
    ids = (TensorProto.INT64, ["batch", "length"])
    embeddings = (np.full((1, DIMENSIONS), DIMENSIONS**-0.5), ["batch", DIMENSIONS])
    graph = _graph({"input_ids": ids, "attention_mask": ids}, {"embeddings": embeddings}, "input_ids")
    (folder / "tiny.onnx").write_bytes(graph)
    values = {"name": "tiny", "dimensions": DIMENSIONS, "max_tokens": 16, "graph": "tiny.onnx"}
    (folder / "text_encoder.json").write_text(json.dumps(values), encoding="utf-8")
    return folder
