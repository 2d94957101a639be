"""Six-part descriptions of training clips: paraphrases of every clip as indices into embedded sentences."""

from __future__ import annotations

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
from training.augmentation.catalogue import PartEdit, edits_of_key
from training.data.readers import read_json
from training.data.sources import style_library
from training.frames import FrameTable

LAYERS, CAPTIONS = "layers.json", "captions.json"  # descriptions of edited, and of captured clips
PARAPHRASES = 8
MEASURED = 2  # of these, measured ones, for a captured clip with captions
MIXED_FRACTION = 0.4  # of draws in which parts take different paraphrases


@dataclass
class StyleTexts:
    """Descriptions of all clips.

    `sentences[k]` are part k's distinct sentences with embeddings `embeddings[k]` `(U_k, D)`, which include direction
    words and side if the model uses them (`runtime.prompts.content`); `index` `(clips, PARAPHRASES, 6)` points into
    them. `keys` `(clips, 6)` identify the content of a part independently of its words; `names` are their names.
    """

    sentences: list[list[str]]
    embeddings: list[np.ndarray]
    index: np.ndarray
    keys: np.ndarray
    names: list[str]

    def of_rhythm(self) -> np.ndarray:
        """Return `(clips,)` bool: clips with an edit of rhythm and weight, which is visible only in steps."""
        return self._does(lambda edit: edit.does.of_steps)

    def of_pace(self) -> np.ndarray:
        """Return `(clips,)` bool: clips with an edit of step length or step rate."""
        return self._does(lambda edit: edit.kind in ("steps", "hesitation"))

    def _does(self, what: Callable[[PartEdit], bool]) -> np.ndarray:
        return np.array([any(map(what, edits_of_key(name))) for name in self.names])[self.keys].any(1)


def pick_paraphrases(index: Tensor, clips: Tensor) -> Tensor:
    """Draw sentence indices `(B, 6)` from `index` `(clips, P, 6)` for clips `(B,)`, or one clip per part `(B, 6)`."""
    count, parts = index.shape[1:]
    whose = clips if clips.ndim == 2 else clips[:, None]
    own = (torch.rand(len(clips), parts, device=clips.device) * count).long()
    same = own[:, :1].expand(-1, parts)
    choice = torch.where(torch.rand(len(clips), 1, device=clips.device) < MIXED_FRACTION, own, same)
    return index[whose, choice, torch.arange(parts, device=clips.device)]


@dataclass
class StyleTable:
    """Standardised Z^t of every training sentence: `parts[k]` `(U_k, 64)`; `index` `(clips, P, 6)` points into them."""

    parts: list[Tensor]
    index: Tensor

    def draw(self, clips: Tensor) -> Tensor:
        """Draw Z^t `(B, 384)` of random paraphrases of clips `(B,)`."""
        return self.of(pick_paraphrases(self.index, clips))

    def of(self, sentences: Tensor) -> Tensor:
        """Return Z^t `(B, 384)` of sentence indices `(B, 6)`."""
        return torch.cat([z[sentences[:, k]] for k, z in enumerate(self.parts)], dim=-1)

    def to(self, device: torch.device) -> StyleTable:
        return StyleTable([z.to(device) for z in self.parts], self.index.to(device))


def load_style_texts(
    table: FrameTable, path: Path, encoder: TextEncoderLike, clips: Path | None, words: bool, side: bool
) -> StyleTexts:
    """Gather and embed all descriptions; FileError names a style of the data that has none.

    `clips` is the folder of the clips: its `layers.json` has the descriptions of layered clips, its optional
    `captions.json` sentences measured on captured ones. `words` appends direction words, `side` describes every limb as left.
    """
    library = style_library(path)
    layers, captions = _optional(clips, LAYERS), _optional(clips, CAPTIONS)
    random = np.random.default_rng(0)
    descriptions: list[list[PartDescriptions]] = []
    keys: list[list[str]] = []
    for name, style, mirrored in zip(table.names, table.styles, table.mirrored, strict=True):
        if name in layers:  # edited clips and their mirror images have separate descriptions
            descriptions.append(_parsed(layers[name]["descriptions"]))
            keys.append(layers[name]["keys"])
            continue
        if style not in library:
            raise FileError(f"{path}: no descriptions for the style '{style}'.", "Add an entry for it.")
        measured = captions.get(name.removesuffix("_m"), [])[:MEASURED]
        written, room = library[style]["descriptions"], PARAPHRASES - len(measured)
        own = _parsed([written[int(k)] for k in random.permutation(len(written))[:room]] + measured)
        descriptions.append([d.mirrored() for d in own] if mirrored else own)
        keys.append([style + ("_m" if mirrored else "")] * len(PART_NAMES))
    names, numbers = np.unique(np.array(keys), return_inverse=True)
    sentences, columns = zip(*(_sentences(descriptions, k) for k in range(len(PART_NAMES))), strict=True)
    embeddings = [
        part_inputs(encoder, [part] * len(texts), texts, words, side)
        for part, texts in zip(PART_NAMES, sentences, strict=True)
    ]
    index = np.stack(columns, axis=-1)
    return StyleTexts(list(sentences), embeddings, index, numbers.reshape(len(keys), -1), names.tolist())


def _parsed(mappings: list[dict[str, str]]) -> list[PartDescriptions]:
    return [PartDescriptions.from_mapping(m) for m in mappings]


def _sentences(descriptions: list[list[PartDescriptions]], k: int) -> tuple[list[str], np.ndarray]:
    """Return the distinct sentences of part k, and the indices of each clip's, `(clips, PARAPHRASES)`."""
    texts = [[row[p % len(row)].as_tuple()[k] for p in range(PARAPHRASES)] for row in descriptions]
    distinct, index = np.unique(np.array(texts), return_inverse=True)
    return distinct.tolist(), index.reshape(len(texts), PARAPHRASES)


def _optional(folder: Path | None, name: str) -> dict[str, Any]:
    if folder is None or not (folder / name).exists():
        return {}
    return read_json(folder / name, "Build it again, or delete it.")
