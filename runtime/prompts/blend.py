"""Two prompts blended part by part: the words of a blend and the weights of its parts (`runtime.motion.style` mixes codes)."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from runtime.arrays import Float32Array
from runtime.errors import PromptError
from runtime.motion.style import StyleMix
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import parse_json
from runtime.skeleton import PART_NAMES

Words = str | PartDescriptions  # a prompt, or six part descriptions
Weights = tuple[float, ...]  # one for each of PART_NAMES: 0 is prompt A, 1 is prompt B

ALL_A: Weights = (0.0,) * len(PART_NAMES)
_FORM = f"Write left_arm=1,torso=0.5; the parts are {', '.join(PART_NAMES)}."


def check_weights(weights: Mapping[str, Any]) -> Weights:
    """Return weights in the order of `PART_NAMES`, 0 for parts not named; PromptError names an invalid part."""
    for part, value in weights.items():
        if part not in PART_NAMES:
            raise PromptError(f"Blend weights: there is no body part '{str(part)[:40]}'.", _FORM)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not 0.0 <= value <= 1.0:
            shown = str(value)[:40] if number else type(value).__name__
            raise PromptError(
                f"Blend weight of {part}: {shown!r}, expected 0 (prompt A) to 1 (prompt B).", _FORM
            )
    return tuple(float(weights.get(part, 0.0)) for part in PART_NAMES)


def mix_of_parts(z_a: Float32Array, z_b: Float32Array, weights: Sequence[float]) -> StyleMix:
    """Return the mix in which part k is `weights[k]` (0 to 1) of the way from prompt A to prompt B.

    Each code of the mix takes every part from either A or B; parts switch to B in order of weight. Equal weights give linear
    interpolation, weights of 0 and 1 a single code. Raises PromptError for different shapes or a weight outside 0..1.
    """
    a, b = np.asarray(z_a, np.float32), np.asarray(z_b, np.float32)
    if a.shape != b.shape or a.ndim != 2 or len(a) != len(PART_NAMES):
        raise PromptError(
            f"Blend: codes of shape {a.shape} and {b.shape}, expected two of ({len(PART_NAMES)}, D).",
            "Encode both prompts with the same model.",
        )
    w = np.array(check_weights(dict(zip(PART_NAMES, weights, strict=True))))
    steps = [0.0, *sorted(set(w.tolist()) - {0.0, 1.0}), 1.0]
    shares, codes = [], []
    for low, high in pairwise(steps):
        shares.append(high - low)
        codes.append(np.where((w >= high)[:, None], b, a))
    return StyleMix(tuple(shares), tuple(codes))


def parse_weights(text: str) -> Weights:
    """Parse weights such as "left_arm=1,torso=0.5", or one number for all parts; PromptError shows the form."""
    values: dict[str, Any] = {}
    entries = [entry.strip() for entry in text.split(",")]
    if len(entries) == 1 and "=" not in entries[0]:
        entries = [f"{part}={entries[0]}" for part in PART_NAMES]
    for entry in entries:
        part, _, number = entry.partition("=")
        try:
            values[part.strip()] = float(number)
        except ValueError:
            raise PromptError(f"Blend weights: '{entry[:60]}' is not PART=NUMBER.", _FORM) from None
    return check_weights(values)


@dataclass(frozen=True)
class BlendedPrompt:
    """Prompts A and B with the weight of B in each part, as a take stores them for exact replay.

    Each is a prompt, or six descriptions if the words were edited or came from a language model.
    """

    a: Words
    b: Words
    weights: Weights

    def __post_init__(self) -> None:
        if len(self.weights) != len(PART_NAMES):
            raise PromptError(f"Blend: {len(self.weights)} weights, expected {len(PART_NAMES)}.", _FORM)
        check_weights(dict(zip(PART_NAMES, self.weights, strict=True)))

    def to_json(self) -> str:
        """Return the JSON text that `read_words` reads."""
        value = {
            "a": _plain(self.a),
            "b": _plain(self.b),
            "weights": dict(zip(PART_NAMES, self.weights, strict=True)),
        }
        return json.dumps(value, ensure_ascii=False)


def write_words(words: Words | BlendedPrompt) -> str:
    """Return the text that a take stores for a prompt event; `read_words` reads it."""
    return words if isinstance(words, str) else words.to_json()


def read_words(text: str) -> Words | BlendedPrompt:
    """Parse the prompt event of a take: a prompt, six descriptions, or a blend of two. Raises PromptError."""
    try:
        value = parse_json(text)
    except ValueError:
        return text
    if not isinstance(value, dict):
        return text
    if set(value) != {"a", "b", "weights"}:
        return PartDescriptions.from_mapping(value)
    if not isinstance(value["weights"], dict):
        raise PromptError("Blend weights: not a JSON object.", _FORM)
    return BlendedPrompt(_words(value["a"]), _words(value["b"]), check_weights(value["weights"]))


def _plain(words: Words) -> str | dict[str, str]:
    return words if isinstance(words, str) else words.to_mapping()


def _words(value: Any) -> Words:
    if isinstance(value, str):
        return value
    if isinstance(value, dict):
        return PartDescriptions.from_mapping(value)
    raise PromptError("Blend: expected a prompt or six descriptions.", "Write a string or an object.")
