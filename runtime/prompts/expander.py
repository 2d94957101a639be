"""The step from a free prompt to six descriptions, behind one interface.

`library.LibraryExpander` needs no key and no network. An expander that asks a language model implements the same
`Expander` protocol and answers with source "gpt"; nothing else changes for its callers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from runtime.errors import PromptError
from runtime.prompts.parts import PartDescriptions, check_text

MAX_PROMPT_CHARACTERS = 1000
DEFAULT_PROMPT = "walking in a relaxed, everyday way"  # what the character does until another prompt comes


class PromptCancelledError(PromptError):
    """The question was withdrawn before it was answered."""

    def __init__(self) -> None:
        super().__init__("The prompt was withdrawn before the language model answered.")


@dataclass(frozen=True)
class Expansion:
    """Six descriptions and where they come from.

    `source` is "library", "gpt", or "explicit" when the prompt itself (or the user) said what the parts do;
    `nearest` lists library prompts with their cosine similarity, best first; `note` is a sentence for the user, or "";
    `explicit_parts` are the parts that the prompt described in so many words.
    """

    descriptions: PartDescriptions
    source: Literal["library", "gpt", "explicit"]
    nearest: tuple[tuple[str, float], ...] = ()
    note: str = ""
    explicit_parts: tuple[str, ...] = ()


class Expander(Protocol):
    """Anything that turns a prompt into six body-part descriptions."""

    def expand(self, prompt: str) -> Expansion:
        """Return descriptions for `prompt`; PromptError when the prompt cannot be used."""
        ...


def check_prompt(prompt: object) -> str:
    """Return the prompt with its white space collapsed; PromptError when empty, over-long or with control characters."""
    return check_text(prompt, "prompt", MAX_PROMPT_CHARACTERS)
