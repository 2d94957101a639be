"""What the status line says of an answered prompt."""

from __future__ import annotations

from collections.abc import Sequence

from viewer.messages import Level
from viewer.prompt.style_edit import Answer


def answer_message(
    answer: Answer, prompt: str, model: str, followed: bool, kept: Sequence[str] = ()
) -> tuple[str, Level]:
    """Text and level for an answer to `prompt`, as it is named; `followed` when the library had answered before.

    `kept` are the parts whose locked words go on.
    """
    text, level = _of_answer(answer, prompt, model, followed)
    parts = ", ".join(part.replace("_", " ") for part in kept)
    return f"{text} Locked, so kept: {parts}." if kept else text, level


def _of_answer(answer: Answer, prompt: str, model: str, followed: bool) -> tuple[str, Level]:
    if not answer.final:
        return f"The library answered at once; {model} is being asked.", Level.NOTE
    if answer.source == "gpt":
        return f"{model} answered: {prompt}.", Level.NOTE
    if answer.note:
        return answer.note, Level.WARNING if followed else Level.NOTE
    if answer.nearest:
        text, similarity = answer.nearest[0]
        return f"Library: {prompt} is {similarity:.0%} like “{text}”.", Level.NOTE
    return f"{prompt} itself says what the parts do.", Level.NOTE
