"""Export CLIP's text tower (the paper's text encoder, ViT-B/32) as a text encoder for `--text-encoder`.

    python -m training.text.export_clip --weights DIR --out DIR

The weights are a local folder in Hugging Face's format: config.json, model.safetensors (or pytorch_model.bin) and
tokenizer.json. Nothing is downloaded. The output folder gets clip_text.onnx, tokenizer.json and text_encoder.json.
"""

import argparse
from pathlib import Path

from runtime.errors import FileError, run_command
from training.text.export_text_encoder import write_encoder

GRAPH = "clip_text.onnx"
PRECISIONS = ("int8", "float32")


def export_clip(weights: Path, out: Path, name: str = "CLIP ViT-B/32", precision: str = "int8") -> float:
    """Write the text encoder into `out`; returns the lowest cosine similarity to torch on a few sentences.

    FileError if `weights` is not a CLIP folder. Models trained with the encoder refer to it by `name`.
    """
    from training.text.encoders import load_tower

    tokenizer = weights / "tokenizer.json"
    if not tokenizer.is_file():
        raise FileError(f"{tokenizer}: missing.", "Save the fast tokenizer with the weights.")
    tower = load_tower(weights)
    metadata = {
        "name": name,
        "source": "a local CLIP folder",
        "dimensions": tower.text_projection.out_features,
        "max_tokens": tower.position_embedding.num_embeddings,
        "graph": GRAPH,
        "precision": precision,
    }
    return write_encoder(tower, tokenizer, out, metadata, precision)


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Export CLIP's text tower for --text-encoder.")
    parser.add_argument("--weights", type=Path, required=True, metavar="DIR", help="folder of a CLIP model")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    parser.add_argument("--name", default="CLIP ViT-B/32", help="name by which models refer to it")
    parser.add_argument("--precision", choices=PRECISIONS, default="int8")
    arguments = parser.parse_args(argv)
    cosine = export_clip(arguments.weights, arguments.out, arguments.name, arguments.precision)
    size = (arguments.out / GRAPH).stat().st_size / 1e6
    print(f"{arguments.out / GRAPH}: {size:.1f} MB, cosine to torch at least {cosine:.4f}")


if __name__ == "__main__":
    raise SystemExit(run_command("export CLIP", main))
