"""The shipped prompt library as data: its JSON, and its precomputed embeddings.

An entry of library.json is either a training style, `{"style": "drunk", "also": [...]}`, or a hand-written one:
`{"prompt", "also", "arms" or "left_arm" and "right_arm", "legs" or "left_leg" and "right_leg", "torso", "head"}`.
`{s}` in arms and legs stands for the side; `@drunk` takes the same part's words from that training style.
`also` lists other ways to ask for the same entry; `"mood": true` marks a state of mind or body that another
character can be in.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.errors import FileError, PromptError
from runtime.prompts.parts import PartDescriptions, check_text
from runtime.prompts.text_encoder import TextEncoderLike
from runtime.skeleton import PART_NAMES

MAX_BYTES = 8_000_000
NEUTRAL_STYLE = "neutral"


@dataclass(frozen=True)
class LibraryEntry:
    """One prompt, other ways to ask for it, and its six descriptions; `style` is the training style's key or "", `mood`
    says that torso and head tell it, so that it can be mixed with a character.
    """

    prompt: str
    also: tuple[str, ...]
    descriptions: PartDescriptions
    style: str = ""
    mood: bool = False


@dataclass(frozen=True)
class Style:
    """A training style: a prompt for the list of ready prompts, and paraphrased descriptions of its motion."""

    prompt: str
    descriptions: tuple[PartDescriptions, ...]


@dataclass(frozen=True)
class LibraryEmbeddings:
    """Unit vectors of the library's words, N entries with P prompts in all.

    `prompts` (P, D) with the entry of each in `entry_of` (P,), and `parts` (N, 6, D).
    """

    prompts: NDArray[np.float32]
    entry_of: NDArray[np.int64]
    parts: NDArray[np.float32]


def load_styles(path: Path) -> dict[str, Style]:
    """The training styles of styles.json; FileError naming the style when one is malformed."""
    styles = {}
    for key, value in _read_object(path).items():
        try:
            descriptions = tuple(PartDescriptions.from_mapping(d) for d in value["descriptions"])
            if not descriptions:
                raise ValueError("no descriptions")
            styles[key] = Style(check_text(value["prompt"], "prompt", 300), descriptions)
        except (PromptError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise FileError(
                f"{path}: style {key!r} is malformed ({error!r}).", "Restore the file."
            ) from error
    if NEUTRAL_STYLE not in styles:
        raise FileError(f"{path}: style {NEUTRAL_STYLE!r} is missing.", "Restore the file.")
    return styles


def load_library(path: Path, styles: Mapping[str, Style]) -> tuple[LibraryEntry, ...]:
    """The entries of library.json with references to `styles` resolved; FileError naming a malformed entry."""
    entries = []
    values = _read_object(path).get("entries")
    if not isinstance(values, list) or not values:
        raise FileError(f"{path}: has no list 'entries'.", "Restore the file.")
    for number, value in enumerate(values):
        try:
            entries.append(_entry(value, styles))
        except (PromptError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise FileError(
                f"{path}: entry {number} is malformed ({error!r}).", "Correct or restore the file."
            ) from error
    return tuple(entries)


def _entry(value: Mapping[str, Any], styles: Mapping[str, Style]) -> LibraryEntry:
    also = tuple(check_text(a, "other prompt", 300) for a in value.get("also", ()))
    mood = bool(value.get("mood", False))
    if "style" in value:
        style = styles[value["style"]]
        return LibraryEntry(style.prompt, also, style.descriptions[0], value["style"], mood)
    words = {}
    for part in PART_NAMES:
        side, _, limb = part.partition("_")
        text = value[part] if part in value else value[f"{limb}s"]
        if text.startswith("@"):
            text = getattr(styles[text[1:]].descriptions[0], part)
        words[part] = text.replace("{s}", side)
    return LibraryEntry(check_text(value["prompt"], "prompt", 300), also, PartDescriptions(**words), "", mood)


def library_hash(library: Path, styles: Path) -> str:
    """SHA-256 over both files: stored embeddings belong to exactly these words."""
    return hashlib.sha256(library.read_bytes() + b"\0" + styles.read_bytes()).hexdigest()


def embed_library(entries: tuple[LibraryEntry, ...], encoder: TextEncoderLike) -> LibraryEmbeddings:
    """Compute the embeddings of all prompts and descriptions: a few seconds for some hundred entries."""
    asked = [(text, i) for i, entry in enumerate(entries) for text in (entry.prompt, *entry.also)]
    parts = [encoder.encode(entry.descriptions.as_tuple()) for entry in entries]
    return LibraryEmbeddings(
        encoder.encode([text for text, _ in asked]),
        np.array([i for _, i in asked], np.int64),
        np.stack(parts),
    )


def save_embeddings(path: Path, embeddings: LibraryEmbeddings, digest: str, encoder_name: str) -> None:
    """Write library.npz; half floats, which change a cosine by less than 0.001."""
    np.savez_compressed(
        path,
        prompts=embeddings.prompts.astype(np.float16),
        entry_of=embeddings.entry_of,
        parts=embeddings.parts.astype(np.float16),
        digest=np.array(digest),
        encoder=np.array(encoder_name),
    )


def load_embeddings(
    path: Path, digest: str, encoder: TextEncoderLike, entries: int
) -> LibraryEmbeddings | None:
    """Stored embeddings, or None when there are none for these words and this encoder; FileError when damaged."""
    if not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as data:
            if str(data["digest"]) != digest or str(data["encoder"]) != encoder.name:
                return None
            found = LibraryEmbeddings(
                data["prompts"].astype(np.float32), data["entry_of"], data["parts"].astype(np.float32)
            )
    except Exception as error:  # zipfile, zlib and numpy each raise their own for a damaged archive
        raise FileError(
            f"{path}: not readable as the library's embeddings ({error}).",
            "Run `python -m training.text.build_library`, or install the program again.",
        ) from error
    count, size = len(found.entry_of), encoder.dimensions
    if found.prompts.shape != (count, size) or found.parts.shape != (entries, len(PART_NAMES), size):
        raise FileError(
            f"{path}: embeddings of shape {found.parts.shape}, expected {(entries, len(PART_NAMES), size)}.",
            "Run `python -m training.text.build_library`.",
        )
    return found


def _read_object(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise FileError(
                f"{path}: larger than {MAX_BYTES} bytes.", "Choose a prompt library of this program."
            )
        value = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FileError(f"{path}: not readable as JSON ({error}).", "Restore the file.") from error
    if not isinstance(value, dict):
        raise FileError(f"{path}: not a JSON object.", "Restore the file.")
    return value
