"""What the content encoder reads of a sentence: its embedding, its direction words, and its side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from runtime.errors import ModelError
from runtime.prompts.direction_words import GROUPS, with_direction_words
from runtime.prompts.one_side import one_sided
from runtime.prompts.text_encoder import TextEncoderLike
from runtime.skeleton import PART_NAMES


def input_sizes(dimensions: int) -> dict[int, tuple[bool, bool]]:
    """Length of a sentence's input, for embeddings of `dimensions`, to whether it holds direction words and a side."""
    pairs = [(words, side) for words in (False, True) for side in (False, True)]
    return {dimensions + words * len(GROUPS) + side: (words, side) for words, side in pairs}


def sentence_inputs(encoder: TextEncoderLike, texts: Sequence[str], size: int) -> NDArray[np.float32]:
    """`(6, size)`: the inputs of six descriptions in the order of `PART_NAMES`; ModelError when no input has that size."""
    sizes = input_sizes(encoder.dimensions)
    if size not in sizes:
        raise ModelError(
            f"prompt.onnx reads {size} numbers of a sentence, expected one of {sorted(sizes)} of {encoder.name}.",
            "Choose a model that was trained with this text encoder.",
        )
    return part_inputs(encoder, PART_NAMES, texts, *sizes[size])


def part_inputs(
    encoder: TextEncoderLike, parts: Sequence[str], texts: Sequence[str], words: bool, side: bool
) -> NDArray[np.float32]:
    """`(N, D)`: the inputs of sentences, each of the part of the same place in `parts`."""
    signs: Sequence[float] = ()
    if side:
        sided = [one_sided(part, text) for part, text in zip(parts, texts, strict=True)]
        texts, signs = [text for text, _ in sided], [sign for _, sign in sided]
    vectors = np.asarray(encoder.encode(texts), np.float32)
    if words:
        vectors = with_direction_words(texts, vectors)
    return np.concatenate([vectors, np.asarray(signs, np.float32)[:, None]], axis=1) if side else vectors
