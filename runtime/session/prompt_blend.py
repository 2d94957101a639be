"""The style of a character as plain data: an answered prompt or a blend of two."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from runtime.motion.style import LINEAR, Shares, StyleMix, even_weights, turned_round
from runtime.prompts.answer import Answer as Answer
from runtime.prompts.blend import ALL_A, BlendedPrompt, Weights, Words, mix_of_parts, write_words
from runtime.prompts.edit_targets import blended_targets, edit_targets
from runtime.skeleton import PART_NAMES


class Side(IntEnum):
    """The side of a blend: prompt A, or prompt B."""

    A = 0
    B = 1


@dataclass(frozen=True)
class PromptBlend:
    """The style of a character: prompt A, optionally prompt B with a weight per part, and the parts whose words are locked."""

    answers: tuple[Answer | None, Answer | None] = (None, None)
    weights: Weights = ALL_A
    locked: frozenset[str] = frozenset()
    # weights of B at even fractions of the visible change from A, once measured
    shares: Shares = field(default=LINEAR, compare=False)

    @property
    def a(self) -> Answer | None:
        return self.answers[Side.A]

    @property
    def b(self) -> Answer | None:
        return self.answers[Side.B]

    def prompt(self, side: Side) -> str:
        """Return the prompt on a side; "" before its first answer."""
        answer = self.answers[side]
        return "" if answer is None else answer.prompt

    def with_answer(self, side: Side, answer: Answer | None) -> PromptBlend:
        answers = (answer, self.b) if side is Side.A else (self.a, answer)
        return dataclasses.replace(self, answers=answers, shares=LINEAR)

    def locking_edits(self, before: Answer | None) -> PromptBlend:
        """Return the blend with each part whose words changed since `before` locked if they were edited, else unlocked."""
        if self.a is None or before is None:
            return self
        changed = {p for p in PART_NAMES if getattr(self.a.words, p) != getattr(before.words, p)}
        return dataclasses.replace(self, locked=self.locked - changed | changed & set(self.a.edited))

    def locked_on(self, side: Side) -> frozenset[str]:
        """Return the locked parts that new answers on a side must not change; for prompt B only those in which it shows."""
        if side is Side.A:
            return self.locked
        return frozenset(p for p, w in zip(PART_NAMES, self.weights, strict=True) if w > 0.0) & self.locked

    @property
    def blended(self) -> bool:
        """Whether prompt B shows in any part."""
        return None not in self.answers and any(weight > 0.0 for weight in self.weights)

    def style(self, exact_legs: bool = True) -> StyleMix | None:
        """Return the mixed style, or None before the first answer; `exact_legs` adds body edits for what the network does not show."""
        if self.a is None:
            return None
        if self.b is None or not self.blended:
            mix, edits = StyleMix((1.0,), (self.a.z,)), edit_targets(self.a.words)
        else:
            mix = mix_of_parts(self.a.z, self.b.z, even_weights(self.shares, self.weights))
            edits = blended_targets(self.a.words, self.b.words, self.weights)
        return dataclasses.replace(mix, edits=edits) if exact_legs else mix

    def replayable(self) -> Words | BlendedPrompt:
        """Return the words that a take stores to replay this style."""
        if self.a is None or self.b is None or not self.blended:
            return "" if self.a is None else self.a.replayable
        return BlendedPrompt(self.a.replayable, self.b.replayable, self.weights)

    def turned_round(self) -> PromptBlend:
        """Return the same style with prompts A and B swapped."""
        flipped, shares = tuple(1.0 - weight for weight in self.weights), turned_round(self.shares)
        return dataclasses.replace(self, answers=self.answers[::-1], weights=flipped, shares=shares)

    def typed(self) -> str:
        """Return the prompts as typed, if `replayable` stores descriptions instead of them; else ""."""
        sides = [side for side in ((self.a, self.b) if self.blended else (self.a,)) if side is not None]
        if all(side.replayable == side.prompt for side in sides):
            return ""
        return (
            " + ".join(side.prompt or "own words" for side in sides) if any(s.prompt for s in sides) else ""
        )

    @property
    def prompt_text(self) -> str:
        """Return `replayable` as the text that a take stores."""
        return write_words(self.replayable())

    def spelled_out(self) -> str:
        """Return the six descriptions, or a blend of two sets, as text that needs no library to be read."""
        if self.a is None or self.b is None or not self.blended:
            return "" if self.a is None else self.a.words.to_json()
        return BlendedPrompt(self.a.words, self.b.words, self.weights).to_json()

    def with_weight(self, part: str, weight: float) -> PromptBlend:
        i = PART_NAMES.index(part)
        return dataclasses.replace(self, weights=(*self.weights[:i], weight, *self.weights[i + 1 :]))

    def with_all_weights(self, weight: float) -> PromptBlend:
        """Return the blend with a new weight of prompt B in every part that is not locked."""
        pairs = zip(PART_NAMES, self.weights, strict=True)
        return dataclasses.replace(
            self, weights=tuple(old if part in self.locked else weight for part, old in pairs)
        )

    @property
    def master_weight(self) -> float:
        """Mean weight of prompt B over the unlocked parts (over all if every part is locked)."""
        free = [w for part, w in zip(PART_NAMES, self.weights, strict=True) if part not in self.locked]
        return float(np.mean(free or self.weights))
