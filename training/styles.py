"""The training clips' six-part descriptions: for every clip some paraphrases, as indices into embedded sentences."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from runtime.errors import FileError
from runtime.prompts.content import part_inputs
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.text_encoder import TextEncoderLike
from runtime.skeleton import PART_NAMES
from training.augmentation.catalogue import PartEdit, part_edits
from training.data.style_library import style_library
from training.frames import FrameTable

LAYERS, CAPTIONS = (
    "layers.json",
    "captions.json",
)  # next to the clips: of edited ones, and measured on captured ones
PARAPHRASES = 8
MEASURED = 2  # of these for a captured clip with captions of its own
MIX = 0.4  # fraction of draws in which every part takes a paraphrase of its own


@dataclass
class StyleTexts:
    """Descriptions of every clip.

    `sentences[k]` are part k's distinct sentences with embeddings `embeddings[k]` `(U_k, D)`, to which direction
    words and side belong if the model has them (`runtime.prompts.content`);
    `index` `(clips, PARAPHRASES, 6)` points into them. `keys` `(clips, 6)` numbers what a part does: equal keys are
    the same content, whatever the words. `names` are the keys' names.
    """

    sentences: list[list[str]]
    embeddings: list[np.ndarray]
    index: np.ndarray
    keys: np.ndarray
    names: list[str]

    def of_rhythm(self) -> np.ndarray:
        """`(clips,)` bool: where a part does an edit of rhythm and weight, which shows in steps only."""
        return self._does(lambda edit: edit.of_steps)

    def of_pace(self) -> np.ndarray:
        """`(clips,)` bool: where an edit changes how long or how quick the steps are."""
        return self._does(lambda edit: edit.kind in ("steps", "hesitation"))

    def _does(self, what: Callable[[PartEdit], bool]) -> np.ndarray:
        edits = [part_edits().get(".".join(name.split(".")[:2])) for name in self.names]
        return np.array([edit is not None and what(edit) for edit in edits])[self.keys].any(1)

    def pick(self, clips: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Sentence indices `(B, 6)` for clips `(B,)`: one paraphrase, or now and then another one for each part."""
        index = torch.as_tensor(self.index, device=clips.device)
        return pick_paraphrases(index, clips, generator)


def pick_paraphrases(index: Tensor, clips: Tensor, generator: torch.Generator | None = None) -> Tensor:
    """Sentence indices `(B, 6)` out of `index` `(clips, P, 6)` for clips `(B,)`, or `(B, 6)` of every part's own."""
    count, parts = index.shape[1:]
    whose = clips if clips.ndim == 2 else clips[:, None]

    def random(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator).to(clips.device)

    own = (random(len(clips), parts) * count).long()
    same = own[:, :1].expand(-1, parts)
    choice = torch.where(random(len(clips), 1) < MIX, own, same)
    return index[whose, choice, torch.arange(parts, device=clips.device)]


@dataclass
class StyleTable:
    """Standardised Z^t of every training sentence: `parts[k]` `(U_k, 64)`; `index` `(clips, P, 6)` points into them."""

    parts: list[Tensor]
    index: Tensor

    def draw(self, clips: Tensor) -> Tensor:
        """Z^t `(B, 384)` of random paraphrases of clips `(B,)`."""
        return self.of(pick_paraphrases(self.index, clips))

    def of(self, sentences: Tensor) -> Tensor:
        """Z^t `(B, 384)` of sentence indices `(B, 6)`."""
        return torch.cat([z[sentences[:, k]] for k, z in enumerate(self.parts)], dim=-1)

    def to(self, device: torch.device) -> StyleTable:
        return StyleTable([z.to(device) for z in self.parts], self.index.to(device))


def load_style_texts(
    table: FrameTable,
    path: Path,
    encoder: TextEncoderLike,
    clips: Path | None = None,
    words: bool = False,
    side: bool = False,
) -> StyleTexts:
    """Gather and embed every description; FileError names a style of the data that has none.

    `clips` is the folder of the clips: its `layers.json` holds the descriptions of layered clips, its
    `captions.json`, if there, sentences measured on each captured one. `words` appends the direction words, `side` describes every limb as the left one.
    """
    library = style_library(path)
    layers = _optional(clips, LAYERS)
    captions = _optional(clips, CAPTIONS)
    random = np.random.default_rng(0)
    descriptions: list[list[PartDescriptions]] = []
    keys: list[list[str]] = []
    for name, style, mirrored in zip(table.names, table.styles, table.mirrored, strict=True):
        if name in layers:
            descriptions.append([PartDescriptions.from_mapping(d) for d in layers[name]["descriptions"]])
            keys.append(list(layers[name]["keys"]))
            continue
        if style not in library:
            raise FileError(f"{path}: no descriptions for the style '{style}'.", "Add an entry for it.")
        written = [PartDescriptions.from_mapping(d) for d in library[style]["descriptions"]]
        measured = captions.get(name.removesuffix("_m"), [])[:MEASURED]
        room = PARAPHRASES - len(measured)
        chosen = [written[int(k)] for k in random.permutation(len(written))[:room]]
        chosen += [PartDescriptions.from_mapping(d) for d in measured]
        descriptions.append([d.mirrored() for d in chosen] if mirrored else chosen)
        keys.append([style + ("_m" if mirrored else "")] * len(PART_NAMES))
    return _indexed(descriptions, keys, encoder, words, side)


def _indexed(
    descriptions: list[list[PartDescriptions]],
    keys: list[list[str]],
    encoder: TextEncoderLike,
    words: bool,
    side: bool,
) -> StyleTexts:
    sentences, embeddings = [], []
    index = np.zeros((len(descriptions), PARAPHRASES, len(PART_NAMES)), np.int64)
    for k in range(len(PART_NAMES)):
        texts = [[row[p % len(row)].as_tuple()[k] for p in range(PARAPHRASES)] for row in descriptions]
        distinct = sorted({t for row in texts for t in row})
        number = {text: i for i, text in enumerate(distinct)}
        index[:, :, k] = [[number[t] for t in row] for row in texts]
        sentences.append(distinct)
        embeddings.append(part_inputs(encoder, [PART_NAMES[k]] * len(distinct), distinct, words, side))
    names = sorted({key for row in keys for key in row})
    numbers = {key: i for i, key in enumerate(names)}
    return StyleTexts(
        sentences, embeddings, index, np.array([[numbers[key] for key in row] for row in keys]), names
    )


def _read(path: Path, remedy: str) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: not a readable JSON file.", remedy) from error


def _optional(folder: Path | None, name: str) -> dict[str, Any]:
    if folder is None or not (folder / name).exists():
        return {}
    return _read(folder / name, "Build it again, or delete it.")
