"""The training styles' six-part descriptions as rows of text embeddings: one row per (style, mirrored)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.errors import FileError
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.text_encoder import TextEncoderLike
from training.frames import FrameTable


@dataclass
class StyleTexts:
    """`embeddings` `(rows, P, 6, 384)`; rows with fewer paraphrases repeat theirs. `clip_rows` `(clips,)`."""

    keys: list[tuple[str, bool]]
    embeddings: np.ndarray
    clip_rows: np.ndarray
    descriptions: list[list[PartDescriptions]]


def load_style_texts(table: FrameTable, path: Path, encoder: TextEncoderLike) -> StyleTexts:
    """Embed every description; FileError names a style of the data that has none."""
    try:
        library = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(
            f"{path}: not a readable JSON file.", "Restore assets/prompts/styles.json."
        ) from error
    keys = sorted({(s, bool(m)) for s, m in zip(table.styles, table.mirrored, strict=True)})
    descriptions = []
    for style, mirrored in keys:
        if style not in library:
            raise FileError(f"{path}: no descriptions for the style '{style}'.", "Add an entry for it.")
        parts = [PartDescriptions.from_mapping(d) for d in library[style]["descriptions"]]
        descriptions.append([d.mirrored() for d in parts] if mirrored else parts)
    most = max(len(d) for d in descriptions)
    texts = [t for row in descriptions for k in range(most) for t in row[k % len(row)].as_tuple()]
    embedded = np.asarray(encoder.encode(texts)).reshape(len(keys), most, 6, -1)
    index = {key: row for row, key in enumerate(keys)}
    rows = [index[(s, bool(m))] for s, m in zip(table.styles, table.mirrored, strict=True)]
    return StyleTexts(keys, embedded.astype(np.float32), np.array(rows), descriptions)
