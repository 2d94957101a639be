"""The shipped prompt library as data: its JSON, and its precomputed embeddings. assets/prompts/README.md has the format.

An entry is either a training style, `{"style": "drunk", "category", "also": [...]}`, or a hand-written one:
`{"prompt", "category", "also", "arms" or "left_arm" and "right_arm", "legs" or "left_leg" and "right_leg", "torso",
"head"}`. `{s}` in arms and legs stands for the side; `@drunk` takes the same part's words from that training style. `"opposite"`
names the entry for its denial.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.errors import FileError, PromptError
from runtime.prompts.content import one_sided
from runtime.prompts.parts import PartDescriptions, check_text
from runtime.prompts.text_encoder import TextEncoderLike
from runtime.safe_read import open_npz, parse_json, read_bounded
from runtime.skeleton import PART_NAMES

MAX_BYTES = 8_000_000
QUANTISATION_STEPS = (
    63  # of a component: half of what int8 holds, so that the compressed file stays under 3 MB
)
NEUTRAL_STYLE = "neutral"
RIDGE_WEIGHT = 10.0
EMBEDDED_NAMES = 20  # per entry; its other names are only matched word for word


@dataclass(frozen=True)
class LibraryEntry:
    """A library prompt, its alternative names, and its six descriptions.

    `defines` are the characteristic parts, which the entry contributes when a prompt names several entries: torso and
    head of a mood, legs of a ground. `style` is the training style's key or "". `opposite` is the prompt of the entry
    used when this one is denied ("not so fast"), or "".
    """

    prompt: str
    also: tuple[str, ...]
    descriptions: PartDescriptions
    category: str = ""
    defines: tuple[str, ...] = PART_NAMES
    style: str = ""
    opposite: str = ""


@dataclass(frozen=True)
class PromptLibrary:
    """All library entries; `alone` are words that name an entry only as the whole prompt ("star", but not in "a star player").

    `nothing` are examples of prompts that do not describe a body.
    """

    entries: tuple[LibraryEntry, ...]
    alone: frozenset[str] = frozenset()
    nothing: tuple[str, ...] = ()


@dataclass(frozen=True)
class LibraryStyle:
    """A training style: a prompt for the list of examples, and paraphrased descriptions of its motion."""

    prompt: str
    descriptions: tuple[PartDescriptions, ...]


@dataclass(frozen=True)
class LibraryEmbeddings:
    """Unit embedding vectors of the library, for N entries with P prompts in all.

    `prompts` (P, D) with the entry of each in `entry_of` (P,), `parts` (N, 6, D). `bodily` (D + 1,) are weights and
    offset of a linear score, positive for prompts about a body. `other_words` are English words one letter off the
    library's, which are no typing errors.
    """

    prompts: NDArray[np.float32]
    entry_of: NDArray[np.int64]
    parts: NDArray[np.float32]
    bodily: NDArray[np.float32]
    other_words: tuple[str, ...] = ()


def load_styles(path: Path) -> dict[str, LibraryStyle]:
    """Read the training styles of styles.json; FileError names a malformed one."""
    styles = {}
    for key, value in read_object(path).items():
        with checked(path, f"style {key!r}"):
            descriptions = tuple(PartDescriptions.from_mapping(d) for d in value["descriptions"])
            if not descriptions:
                raise ValueError("no descriptions")
            styles[key] = LibraryStyle(check_text(value["prompt"], "prompt", 300), descriptions)
    if NEUTRAL_STYLE not in styles:
        raise FileError(f"{path}: style {NEUTRAL_STYLE!r} is missing.", "Restore the file.")
    return styles


def load_library(path: Path, styles: Mapping[str, LibraryStyle]) -> PromptLibrary:
    """Read library.json, resolving its references to `styles`; FileError names a malformed entry."""
    file = read_object(path)
    with checked(path, "'categories', 'alone' or 'nothing'"):
        defines = {name: _parts(value["defines"]) for name, value in file.get("categories", {}).items()}
        alone = frozenset(check_text(word, "word", 40) for word in file.get("alone", ()))
        nothing = tuple(check_text(text, "prompt about nothing", 300) for text in file.get("nothing", ()))
    with checked(path, "'entries'"):
        values = list(file["entries"])
    entries = []
    for number, value in enumerate(values):
        with checked(path, f"entry {number}"):
            entries.append(_entry(value, styles, defines))
    prompts = {entry.prompt for entry in entries}
    for number, entry in enumerate(entries):
        with checked(path, f"entry {number}"):
            if entry.opposite and entry.opposite not in prompts:
                raise ValueError(f"opposite {entry.opposite!r}, expected another entry's prompt")
    return PromptLibrary(tuple(entries), alone, nothing)


def _entry(
    value: Mapping[str, Any], styles: Mapping[str, LibraryStyle], defines_of: Mapping[str, tuple[str, ...]]
) -> LibraryEntry:
    also = tuple(check_text(a, "other prompt", 300) for a in value.get("also", ()))
    category = str(value.get("category", ""))
    defines = _parts(value["defines"]) if "defines" in value else defines_of.get(category, PART_NAMES)
    opposite = str(value.get("opposite", ""))
    if "style" in value:
        style = styles[value["style"]]
        return LibraryEntry(
            style.prompt, also, style.descriptions[0], category, defines, value["style"], opposite
        )
    words = {}
    for part in PART_NAMES:
        side, _, limb = part.partition("_")
        text = value[part] if part in value else value[f"{limb}s"]
        if text.startswith("@"):
            text = getattr(styles[text[1:]].descriptions[0], part)
        words[part] = text.replace("{s}", side)
    prompt = check_text(value["prompt"], "prompt", 300)
    return LibraryEntry(prompt, also, PartDescriptions(**words), category, defines, "", opposite)


def _parts(names: list[str]) -> tuple[str, ...]:
    unknown = [name for name in names if name not in PART_NAMES]
    if unknown or not names:
        raise ValueError(f"parts {names!r}, expected some of {PART_NAMES}")
    return tuple(part for part in PART_NAMES if part in names)


def library_hash(library: PromptLibrary) -> str:
    """Return a SHA-256 over all embedded text, which stored embeddings must match."""
    words = [[e.prompt, e.also, e.descriptions.as_tuple()] for e in library.entries]
    return hashlib.sha256(json.dumps([words, library.nothing]).encode("utf-8")).hexdigest()


def embed_library(library: PromptLibrary, encoder: TextEncoderLike) -> LibraryEmbeddings:
    """Compute the embeddings of names and descriptions, which takes some seconds for some hundred entries."""
    named = [(t, i) for i, e in enumerate(library.entries) for t in (e.prompt, *e.also)[:EMBEDDED_NAMES]]
    prompts = encoder.encode([text for text, _ in named])
    return LibraryEmbeddings(
        prompts,
        np.array([i for _, i in named], np.int64),
        _part_vectors(library, encoder),
        _bodily_score(prompts, encoder.encode(library.nothing)),
    )


def sentences(library: PromptLibrary) -> list[str]:
    """Return the library's sentences, six per entry, right limbs phrased as left ones."""
    return [
        one_sided(part, text)[0] if part.endswith(("arm", "leg")) else text
        for entry in library.entries
        for part, text in entry.descriptions.to_mapping().items()
    ]


def _part_vectors(library: PromptLibrary, encoder: TextEncoderLike) -> NDArray[np.float32]:
    return encoder.encode(sentences(library)).reshape(len(library.entries), len(PART_NAMES), -1)


def _bodily_score(prompts: NDArray[np.float32], nothing: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ridge regression weights `(D + 1,)` for +1 of `prompts` (P, D) and -1 of `nothing` (M, D), equally weighted."""
    if not len(nothing):
        return np.eye(1, prompts.shape[1] + 1, prompts.shape[1], np.float32)[0]  # everything is about a body
    features = np.hstack([np.vstack([prompts, nothing]), np.ones((len(prompts) + len(nothing), 1))])
    wanted = np.repeat([1.0, -1.0], [len(prompts), len(nothing)])
    weights = len(features) / 2 / np.repeat([len(prompts), len(nothing)], [len(prompts), len(nothing)])
    weighted = features * weights[:, None]
    normal = features.T @ weighted + RIDGE_WEIGHT * np.eye(features.shape[1])
    return np.linalg.solve(normal, weighted.T @ wanted).astype(np.float32)


def save_embeddings(path: Path, embeddings: LibraryEmbeddings, digest: str, encoder_name: str) -> None:
    """Write library.npz; vectors are stored as bytes, which changes a cosine by less than 0.005."""
    np.savez_compressed(
        path,
        prompts=vectors_as_bytes(embeddings.prompts),
        entry_of=embeddings.entry_of.astype(np.int32),
        bodily=embeddings.bodily,
        other_words=np.array("\n".join(embeddings.other_words)),
        digest=np.array(digest),
        encoder=np.array(encoder_name),
    )


def load_embeddings(path: Path, library: PromptLibrary, encoder: TextEncoderLike) -> LibraryEmbeddings | None:
    """Read stored embeddings; None if there are none for this library and encoder; FileError if they are damaged."""
    if not path.exists():
        return None
    remedy = "Run `python -m training.text.build_library`, or install the program again."
    with open_npz(path, remedy) as data:
        if str(data["digest"]) != library_hash(library) or str(data["encoder"]) != encoder.name:
            return None
        found = LibraryEmbeddings(
            unit_vectors(data["prompts"]),
            data["entry_of"].astype(np.int64),
            _part_vectors(library, encoder),
            data["bodily"].astype(np.float32),
            tuple(str(data["other_words"]).split()),
        )
    expected = (len(found.entry_of), encoder.dimensions)
    if found.prompts.shape != expected:
        raise FileError(f"{path}: embeddings of shape {found.prompts.shape}, expected {expected}.", remedy)
    return found


def vectors_as_bytes(vectors: NDArray[np.float32]) -> NDArray[np.int8]:
    """Return unit vectors `(..., D)` quantised to int8, each scaled by its largest component."""
    largest = np.abs(vectors).max(axis=-1, keepdims=True, initial=1e-9)
    return np.round(vectors / largest * QUANTISATION_STEPS).astype(np.int8)


def unit_vectors(stored: NDArray[np.int8]) -> NDArray[np.float32]:
    """Return the unit vectors `(..., D)` that were quantised by `vectors_as_bytes`."""
    return np.asarray(stored / np.maximum(np.linalg.norm(stored, axis=-1, keepdims=True), 1.0), np.float32)


def read_object(path: Path) -> dict[str, Any]:
    """Read a file that holds a JSON object. Raises FileError."""
    with checked(path, "the JSON"):
        value = parse_json(read_bounded(path, MAX_BYTES))
        if not isinstance(value, dict):
            raise ValueError("not an object")
    return value


@contextmanager
def checked(path: Path, what: str) -> Iterator[None]:
    """Raise FileError if the block finds part of a file malformed."""
    try:
        yield
    except (PromptError, KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        problem = f"{path}: {what} is malformed ({error!r})."
        raise FileError(problem, "Correct or restore the file.") from error
