"""Pending prompt requests, and how their answers change a blend and a session."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.motion.style import LINEAR
from runtime.prompts.answer import Request
from runtime.prompts.parts import PartDescriptions
from runtime.session.prompt_blend import Answer, PromptBlend, Side
from runtime.session.session import Session
from viewer.messages import Level

FIRST_WEIGHT = 0.5  # weight of a new prompt B in unlocked parts, so that it shows
MAX_LABEL_LETTERS = 40  # characters of a prompt in its step's label
Codes = Mapping[PartDescriptions, NDArray[np.float32]]  # (6, 64) of six descriptions


@dataclass
class Question:
    """A request on one side, until its final answer arrives."""

    request: Request
    label: str  # of the undo step
    remembered: bool = False  # in the list of recent prompts
    number: int = 0
    answered: bool = False  # a better answer is on its way

    @property
    def prompt(self) -> str:
        """The prompt, or "" if six descriptions were edited."""
        return self.request if isinstance(self.request, str) else ""

    def held_by(self, answer: Answer | None) -> bool:
        """Return whether an answer belongs to this question."""
        return answer is not None and answer.question == self.number


def quoted(prompt: str) -> str:
    """Return a prompt for a step's label: on one line, shortened if long."""
    line = " ".join(prompt.split())
    return f"“{line if len(line) <= MAX_LABEL_LETTERS else line[: MAX_LABEL_LETTERS - 1] + '…'}”"


def with_first_answer(blend: PromptBlend, side: Side, question: Question, answer: Answer) -> PromptBlend:
    """Return the blend with the first answer to a question; edited words are locked."""
    before = blend.answers[side]
    if not question.prompt:
        words = answer if before is None else before.with_words(answer)
        return blend.with_answer(side, words).locking_edits(before)
    kept = answer if before is None else answer.keeping(blend.locked_on(side), before)
    blend = blend.with_answer(side, kept)
    return blend.with_all_weights(FIRST_WEIGHT) if side is Side.B and not any(blend.weights) else blend


def with_better_answer(blend: PromptBlend, side: Side, question: Question, answer: Answer) -> PromptBlend:
    """Return the blend with the first answer to a question replaced by a better one, if that is still in force.

    Parts locked since the first answer keep its words.
    """
    first = blend.answers[side]
    if first is None or not question.held_by(first):
        return blend
    return blend.with_answer(side, answer.keeping(blend.locked_on(side), first))


def words_of_all(sessions: Sequence[Session]) -> list[PartDescriptions]:
    """Return all descriptions in use by the live character or a variant in any of the sessions, without duplicates."""
    blends = [
        blend for s in sessions for blend in (s.live.prompt, *(variant.prompt for variant in s.variants))
    ]
    return list(dict.fromkeys(a.words for blend in blends for a in blend.answers if a is not None))


def with_codes(session: Session, codes: Codes) -> Session:
    """Return the session with the codes of another model for all prompts of `words_of_all`."""

    def coded(blend: PromptBlend) -> PromptBlend:
        a, b = (
            answer and dataclasses.replace(answer, z=codes.get(answer.words, answer.z))
            for answer in blend.answers
        )
        return dataclasses.replace(blend, answers=(a, b), shares=LINEAR)

    live = dataclasses.replace(session.live, prompt=coded(session.live.prompt))
    variants = tuple(dataclasses.replace(v, prompt=coded(v.prompt)) for v in session.variants)
    return dataclasses.replace(session, live=live, variants=variants)


def same_answers(a: PromptBlend, b: PromptBlend) -> bool:
    """Return whether two blends have the same prompts, words and codes."""
    return all(
        x is y or (x and y and (x.prompt, x.words) == (y.prompt, y.words) and np.array_equal(x.z, y.z))
        for x, y in zip(a.answers, b.answers, strict=True)
    )


def answer_message(
    answer: Answer, prompt: str, model: str, followed: bool, kept: Sequence[str] = ()
) -> tuple[str, Level]:
    """Return the message and its level for an answer; `followed` if the library had answered first.

    `kept` are the locked parts that keep their words.
    """
    text, level = _of_answer(answer, prompt, model, followed)
    parts = ", ".join(part.replace("_", " ") for part in kept)
    return f"{text} Locked, so kept: {parts}." if kept else text, level


def _of_answer(answer: Answer, prompt: str, model: str, followed: bool) -> tuple[str, Level]:
    if not answer.final:
        return f"The library answered at once; waiting for {model}.", Level.NOTE
    if answer.source == "gpt":
        return f"{model} answered: {prompt}.", Level.NOTE
    if answer.note:
        return answer.note, Level.WARNING if followed else Level.NOTE
    if answer.nearest:
        text, similarity = answer.nearest[0]
        return f"Library: {prompt} is {similarity:.0%} like “{text}”.", Level.NOTE
    return f"{prompt} itself describes the parts.", Level.NOTE
