"""Export CLIP's text tower (the paper's text encoder, ViT-B/32) as a text encoder for `--text-encoder`.

    python -m training.text.export_clip --weights DIR --out DIR

The weights are a folder on this machine as Hugging Face stores CLIP: config.json, model.safetensors (or
pytorch_model.bin) and tokenizer.json. Nothing is downloaded. The folder written holds clip_text.onnx,
tokenizer.json and text_encoder.json.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runtime.errors import FileError, run_command
from training.text.export_text_encoder import CHECK_TEXTS, quantise, write_tokenizer

if TYPE_CHECKING:
    from training.text.clip_tower import ClipTextTower

GRAPH = "clip_text.onnx"
PRECISIONS = ("int8", "float32")


def export_clip(weights: Path, out: Path, name: str = "CLIP ViT-B/32", precision: str = "int8") -> float:
    """Write the text encoder into `out`; the lowest cosine against torch on a few sentences.

    FileError when `weights` is no CLIP folder. `name` is what models trained with it will ask for.
    """
    from training.text.clip_tower import load_tower

    if not (weights / "tokenizer.json").is_file():
        raise FileError(
            f"{weights / 'tokenizer.json'}: missing.", "Save the fast tokenizer with the weights."
        )
    tower = load_tower(weights)
    out.mkdir(parents=True, exist_ok=True)
    _write_graph(tower, out / GRAPH, precision)
    max_tokens = tower.position_embedding.num_embeddings
    write_tokenizer(weights / "tokenizer.json", out / "tokenizer.json", max_tokens)
    metadata = {
        "name": name,
        "source": "a local CLIP folder",
        "dimensions": tower.text_projection.out_features,
        "max_tokens": max_tokens,
        "graph": GRAPH,
        "precision": precision,
        "sha256": hashlib.sha256((out / GRAPH).read_bytes()).hexdigest(),
    }
    (out / "text_encoder.json").write_text(json.dumps(metadata, indent=2) + "\n", "utf-8")
    return _check(tower, out)


def _write_graph(tower: ClipTextTower, path: Path, precision: str) -> None:
    import torch

    with tempfile.TemporaryDirectory() as scratch:
        plain = Path(scratch) / "fp32.onnx"
        ids = torch.randint(0, tower.token_embedding.num_embeddings, (2, 7))
        torch.onnx.export(
            tower,
            (ids, torch.ones_like(ids)),
            str(plain),
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
        if precision == "int8":
            quantise(plain, path)
        else:
            shutil.copyfile(plain, path)


def _check(tower: ClipTextTower, out: Path) -> float:
    """Lowest cosine of what was written against the tower itself."""
    import torch
    from tokenizers import Tokenizer

    from runtime.prompts.text_encoder import TextEncoder

    tokenizer = Tokenizer.from_file(str(out / "tokenizer.json"))
    found = TextEncoder(out).encode(CHECK_TEXTS)
    cosines = []
    for text, vector in zip(CHECK_TEXTS, found, strict=True):
        ids = torch.tensor([tokenizer.encode(text).ids])
        with torch.no_grad():
            expected = tower(ids, torch.ones_like(ids))[0].numpy()
        cosines.append(float(np.dot(expected, vector)))
    return min(cosines)


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Export CLIP's text tower for --text-encoder.")
    parser.add_argument("--weights", type=Path, required=True, metavar="DIR", help="folder of a CLIP")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    parser.add_argument("--name", default="CLIP ViT-B/32", help="what models will call it")
    parser.add_argument("--precision", choices=PRECISIONS, default="int8")
    arguments = parser.parse_args(argv)
    cosine = export_clip(arguments.weights, arguments.out, arguments.name, arguments.precision)
    size = (arguments.out / GRAPH).stat().st_size / 1e6
    print(f"{arguments.out / GRAPH}: {size:.1f} MB, cosine against torch at least {cosine:.4f}")


if __name__ == "__main__":
    raise SystemExit(run_command("export CLIP", main))
