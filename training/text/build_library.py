"""Precompute the embeddings of the shipped prompt library.

    python -m training.text.build_library [--prompts assets/prompts]

Run it after every change of library.json or styles.json; without it the viewer computes them at its first prompt.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from runtime.errors import run_command
from runtime.prompts.library_data import (
    embed_library,
    library_hash,
    load_library,
    load_styles,
    save_embeddings,
)
from runtime.prompts.text_encoder import TextEncoder


def build_library(directory: Path) -> Path:
    """Write library.npz beside library.json and styles.json; returns its path."""
    library, styles = directory / "library.json", directory / "styles.json"
    entries = load_library(library, load_styles(styles))
    encoder = TextEncoder()
    target = directory / "library.npz"
    digest = library_hash(library, styles)
    save_embeddings(target, embed_library(entries, encoder), digest, encoder.name)
    return target


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Precompute the embeddings of the prompt library.")
    parser.add_argument("--prompts", type=Path, default=Path("assets/prompts"))
    target = build_library(parser.parse_args(argv).prompts)
    print(f"{target}: {target.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    raise SystemExit(run_command("library", main))
