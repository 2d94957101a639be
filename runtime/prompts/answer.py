"""One answered prompt: its descriptions, those in use, and their style code."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runtime.prompts.blend import Words
from runtime.prompts.expander import Expansion
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES

Request = str | PartDescriptions


@dataclass(frozen=True)
class Answer:
    """An answered prompt: the expander's descriptions `said`, the `words` in use (edited or kept), and their code."""

    prompt: str  # "" when only the six fields were written
    said: PartDescriptions
    words: PartDescriptions
    z: NDArray[np.float32] = field(compare=False)  # (6, 64), of `words`
    source: str = "explicit"  # "library", "gpt" or "explicit"
    nearest: tuple[tuple[str, float], ...] = ()
    note: str = ""
    milliseconds: float = 0.0
    final: bool = True  # False: a better answer is on its way
    question: int = 0  # number of the question that it answers, as its asker counts

    @staticmethod
    def of(
        request: Request,
        expansion: Expansion,
        z: NDArray[np.float32],
        milliseconds: float = 0.0,
        final: bool = True,
    ) -> Answer:
        """Return the answer for an expanded prompt, or six descriptions, with its code (6, 64)."""
        said = expansion.descriptions
        return Answer(
            request if isinstance(request, str) else "",
            said,
            said,
            z,
            expansion.source,
            expansion.nearest,
            expansion.note,
            milliseconds,
            final,
        )

    def with_words(self, words: Answer) -> Answer:
        """Return this prompt's answer with the words and code of another answer."""
        return dataclasses.replace(self, words=words.words, z=words.z, final=True, question=words.question)

    def keeping(self, parts: Collection[str], before: Answer) -> Answer:
        """Return this answer with `parts` kept from `before`; a part's code depends on its own words alone."""
        if not parts:
            return self
        words = {part: getattr(before.words, part) for part in parts}
        kept = np.array([part in parts for part in PART_NAMES])[:, None]
        return dataclasses.replace(
            self, words=dataclasses.replace(self.words, **words), z=np.where(kept, before.z, self.z)
        )

    @property
    def edited(self) -> tuple[str, ...]:
        """The parts whose words differ from the expander's."""
        return tuple(part for part in PART_NAMES if getattr(self.words, part) != getattr(self.said, part))

    @property
    def replayable(self) -> Words:
        """The request that reproduces the words: the prompt if the library answered it, else the six descriptions."""
        by_prompt = self.prompt and self.source != "gpt" and not self.edited
        return self.prompt if by_prompt else self.words
