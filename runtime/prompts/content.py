"""Six descriptions to the content code Z^t: text embeddings through the body-part text network (Sec. III-C).

For each sentence the network reads its embedding, its direction words, and its side.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from runtime.errors import ModelError
from runtime.motion.model_files import run_graph
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.prompts.phrasing import ModelPhrasing
from runtime.prompts.text_encoder import TextEncoderLike, open_session
from runtime.skeleton import PART_NAMES

if TYPE_CHECKING:
    import onnxruntime

PARTS = len(PART_NAMES)


class PromptEncoder:
    """Encodes six descriptions to Z^t: text encoder and body-part network.

    `onnx_path` is a network with input `embeddings` (N, 6, D) and output `z` (N, 6, 64), loaded at the first `encode`; D must be
    that of `text_encoder`, with or without direction words and side. `phrasing` replaces sentences that the model shows badly.
    """

    def __init__(
        self, text_encoder: TextEncoderLike, onnx_path: Path, phrasing: ModelPhrasing | None = None
    ) -> None:
        self._text_encoder = text_encoder
        self._path = onnx_path
        self._phrasing = ModelPhrasing() if phrasing is None else phrasing

    def encode(self, descriptions: PartDescriptions) -> NDArray[np.float32]:
        """Return Z^t `(6, 64)` of six descriptions; ModelError if the network is damaged or its output is not finite."""
        texts = self._phrasing.followed(descriptions).as_tuple()
        session = self._session
        embeddings = sentence_inputs(self._text_encoder, texts, session.get_inputs()[0].shape[2])
        (given,) = run_graph(session, self._path, ["z"], {"embeddings": embeddings[None]})
        z = np.asarray(given, np.float32)
        if z.ndim != 3 or z.shape[:2] != (1, PARTS) or not np.isfinite(z).all():
            raise ModelError(
                f"{self._path}: gave z of shape {z.shape}, expected {(1, PARTS)} times finite numbers.",
                "Choose another model, or export this one again.",
            )
        return z[0]

    @cached_property
    def _session(self) -> onnxruntime.InferenceSession:
        session = open_session(self._path)
        shapes = {i.name: list(i.shape) for i in session.get_inputs()}
        size = self._text_encoder.dimensions
        expected = [[PARTS, length] for length in input_sizes(size)]
        known = list(shapes) == ["embeddings"] and shapes["embeddings"][1:] in expected
        if not known or "z" not in {o.name for o in session.get_outputs()}:
            raise ModelError(
                f"{self._path}: inputs {shapes}, expected embeddings (N, {PARTS}, {size}) "
                f"of {self._text_encoder.name} and an output z.",
                "Choose a model that was trained with this text encoder.",
            )
        return session


# One input each. Trained models depend on these groups and their order: change them only together with the models.
GROUPS: tuple[tuple[str, frozenset[str]], ...] = tuple(
    (name, frozenset(words.split()))
    for name, words in (
        ("left", "left leftward leftwards"),
        ("right", "right rightward rightwards"),
        ("forward", "forward forwards ahead front"),
        ("back", "back backward backwards behind rear"),
        ("up", "up upward upwards raised lifted lifting rising high higher overhead above top sky"),
        (
            "down",
            "down downward downwards lowered low lower drooping bowed falling dropped sunken ground floor",
        ),
        ("out", "out outward outwards away apart wide widely broad broadly spread sideways"),
        ("in", "inward inwards close together narrow near tight crossed across folded tucked"),
        ("much", "far deep deeply strongly sharply very fully heavily hard big long large clearly giant"),
        ("little", "slight slightly little gently lightly softly small short moderately hardly barely"),
        ("bent", "bent bend bending crouched crouching hunched curled rounded slumped"),
        ("straight", "straight stretched upright extended level straightened reaching"),
        ("fast", "fast quick quickly brisk briskly abruptly lively energetically energetic pumping"),
        ("slow", "slow slowly weary wearily careful carefully cautious cautiously trudging tired"),
        ("still", "still stiff stiffly held rigid motionless frozen steady fixed"),
        ("moving", "swinging swaying waving bouncing bobbing flapping nodding rocking shaking swing sway"),
        ("turned", "turned turning turn rotated twisted twisting facing looking pointing"),
        ("tilted", "tilted tilting leaning lean leant tipped"),
        ("not", "not no without never"),
        ("head", "head ear ears face crown forehead brow eyes mouth"),
        ("chest", "chest heart shoulder shoulders chin breast"),
        ("hips", "hip hips waist pocket pockets belly stomach"),
        ("knee", "knee knees thigh thighs"),
        ("foot", "foot feet toe toes heel heels ankle step steps stepping"),
    )
)
MIN_PRESENT_VALUE = 0.1  # about twice the size of an embedding's components


def direction_words(texts: Sequence[str]) -> NDArray[np.float32]:
    """Return `(N, len(GROUPS))` numbers: `MIN_PRESENT_VALUE` if a text contains a word of the group, else 0."""
    found = np.zeros((len(texts), len(GROUPS)), np.float32)
    for row, text in zip(found, texts, strict=True):
        words = frozenset(re.findall(r"[a-z]+", text.lower()))
        row[:] = [MIN_PRESENT_VALUE if words & group else 0.0 for _, group in GROUPS]
    return found


_SIDE = re.compile(r"\b(left|right)(?:wards?)?\b", re.IGNORECASE)
_BOTH = re.compile(
    r"\b(?:left (?:and|or|to|then) (?:the )?right|right (?:and|or|to|then) (?:the )?left)\b", re.IGNORECASE
)


def one_sided(part: str, text: str) -> tuple[str, float]:
    """Return a part's sentence phrased for the left side, and its sign.

    A limb's sign is 1. For torso and head it is 1 to the left, -1 to the right (the first side named counts), and 0 if
    no side is named, or both alike ("from left to right").
    """
    if part.startswith("left_"):
        return text, 1.0
    if part.startswith("right_"):
        return mirror_text(text), 1.0
    side = _SIDE.search(_BOTH.sub("", text))
    if side is None:
        return text, 0.0
    return (text, 1.0) if side.group(1).lower() == "left" else (mirror_text(text), -1.0)


def input_sizes(dimensions: int) -> dict[int, tuple[bool, bool]]:
    """Return the possible input lengths of a sentence, each with whether it includes direction words and a side."""
    pairs = [(words, side) for words in (False, True) for side in (False, True)]
    return {dimensions + words * len(GROUPS) + side: (words, side) for words, side in pairs}


def sentence_inputs(encoder: TextEncoderLike, texts: Sequence[str], size: int) -> NDArray[np.float32]:
    """Return the network inputs `(6, size)` of six descriptions in the order of `PART_NAMES`; ModelError for an unknown size."""
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
    """Return the network inputs `(N, D)` of sentences, each for the body part at its index in `parts`."""
    signs: Sequence[float] = ()
    if side:
        sided = [one_sided(part, text) for part, text in zip(parts, texts, strict=True)]
        texts, signs = [text for text, _ in sided], [sign for _, sign in sided]
    vectors = np.asarray(encoder.encode(texts), np.float32)
    if words:
        vectors = np.concatenate([vectors, direction_words(texts)], axis=1)
    return np.concatenate([vectors, np.asarray(signs, np.float32)[:, None]], axis=1) if side else vectors
