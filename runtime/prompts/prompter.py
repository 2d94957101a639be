"""From a prompt to the Z^t of one model: expander, text encoder and part network."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np
from numpy.typing import NDArray

from runtime.errors import UsageError
from runtime.motion.perceptual_weights import perceptual_weights
from runtime.motion.style import Shares, StyleMix, even_weights, mixes
from runtime.prompts.blend import BlendedPrompt, Weights, Words, mix_of_parts
from runtime.prompts.content import PromptEncoder
from runtime.prompts.edit_targets import blended_targets, edit_targets, edited_parts, left_to_network
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.expander import Expander, Expansion
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.phrasing import ModelPhrasing, adherence_of, phrasing_of
from runtime.prompts.text_encoder import library_encoder, text_encoder_of

if TYPE_CHECKING:
    from runtime.motion.model import MotionModel

EXPANDERS = ("library", "gpt")


class Prompter:
    """Turns prompts, descriptions and blends into style codes for `model`; files are read at first use.

    `expander` is one of EXPANDERS. `text_encoder` is the folder of the encoder that the model was trained with, if it is
    neither shipped nor in the model folder. `report` receives remarks such as what the model hardly shows, `expanded` each
    prompt with its six descriptions. `phrasing` replaces sentences (default: the model's). Raises UsageError, ModelError.
    """

    def __init__(
        self,
        model: MotionModel,
        expander: str = "library",
        report: Callable[[str], None] = lambda _: None,
        text_encoder: Path | None = None,
        expanded: Callable[[str, PartDescriptions], object] = lambda *_: None,
        phrasing: ModelPhrasing | None = None,
    ) -> None:
        self.phrasing = phrasing_of(model.name) if phrasing is None else phrasing
        self.text_encoder = text_encoder_of(model.metadata, model.folder, text_encoder)
        self.encoder = PromptEncoder(self.text_encoder, model.prompt_path, self.phrasing)
        self._expander = self._open(expander)
        self._report, self._expanded = report, expanded
        self._adherence = adherence_of(model.name)
        self._model = model
        self._weights_of_pairs: dict[tuple[bytes, bytes], Shares] = {}

    def listening(
        self, report: Callable[[str], None], expanded: Callable[[str, PartDescriptions], object]
    ) -> Prompter:
        """Return a copy with other callbacks, which shares the loaded data."""
        other = copy.copy(self)
        other._report, other._expanded = report, expanded
        return other

    @cached_property
    def library(self) -> LibraryExpander:
        """The library expander, with the shipped prompt library."""
        return LibraryExpander(library_encoder(self.text_encoder))

    def expand(self, prompt: str) -> Expansion:
        """Return six descriptions of a prompt; PromptError if it cannot be used."""
        expansion = self._expander.expand(prompt)
        self._expanded(prompt, expansion.descriptions)
        note = f"{expansion.note} {self._note(expansion.descriptions)}".strip()
        if note:
            self._report(f"“{prompt}”: {note}")
        return expansion

    @overload
    def __call__(self, words: Words) -> NDArray[np.float32]: ...

    @overload
    def __call__(self, words: BlendedPrompt) -> StyleMix: ...

    def __call__(self, words: Words | BlendedPrompt) -> NDArray[np.float32] | StyleMix:
        """Return Z^t `(6, 64)`, or the mix of a blend; PromptError when the words cannot be used."""
        if isinstance(words, BlendedPrompt):
            return self._blend(self(words.a), self(words.b), words.weights)
        return self._read(words)[1]

    def style(self, words: Words | BlendedPrompt, exact_legs: bool = True) -> StyleMix:
        """Return the style of words or a blend; `exact_legs` adds the edits of all parts, for what the network does not show."""
        if isinstance(words, BlendedPrompt):
            (a, z_a), (b, z_b) = self._read(words.a, exact_legs), self._read(words.b, exact_legs)
            mix, edits = self._blend(z_a, z_b, words.weights), blended_targets(a, b, words.weights)
        else:
            descriptions, z = self._read(words, exact_legs)
            mix, edits = StyleMix((1.0,), (z,)), edit_targets(descriptions)
        return replace(mix, edits=edits) if exact_legs else mix

    def _read(self, words: Words, exact_legs: bool = False) -> tuple[PartDescriptions, NDArray[np.float32]]:
        """Return the six descriptions and their code, under the edits of `exact_legs`."""
        if isinstance(words, PartDescriptions):
            if note := self._note(words):
                self._report(note)
        else:
            words = self.expand(words).descriptions
        return words, self.encoder.encode(left_to_network(words) if exact_legs else words)

    def _note(self, descriptions: PartDescriptions) -> str:
        read = self.phrasing.followed(descriptions)
        return self._adherence.note(descriptions, read, edited_parts(descriptions))

    def _blend(self, a: NDArray[np.float32], b: NDArray[np.float32], weights: Weights) -> StyleMix:
        """Return the mix with these fractions of the visible change; a pair is measured once."""
        if mixes(weights):
            pair = a.tobytes(), b.tobytes()
            if pair not in self._weights_of_pairs:
                self._weights_of_pairs[pair] = perceptual_weights(self._model, a, b)
            weights = even_weights(self._weights_of_pairs[pair], weights)
        return mix_of_parts(a, b, weights)

    def _open(self, name: str) -> Expander:
        if name == "library":
            return self.library
        if name == "gpt":
            from runtime.prompts.gpt.expander import GptExpander

            return GptExpander()
        remedy = f"Choose {' or '.join(EXPANDERS)}."
        raise UsageError(f" {name}: there is no such expander.", remedy, "expander")
