"""Interface of prompt expanders: from a free prompt to six descriptions.

`library.LibraryExpander` needs no key and no network. An expander based on a language model implements the same
`Expander` protocol and answers with source "gpt"; nothing else changes for its callers.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

from runtime.errors import PromptError
from runtime.prompts.parts import PartDescriptions, check_text

MAX_PROMPT_CHARACTERS = 1000
DEFAULT_PROMPT = "walking in a relaxed, everyday way"  # in use until the first prompt


class PromptCancelledError(PromptError):
    """Raised if a request was cancelled before it was answered."""

    def __init__(self) -> None:
        super().__init__("The prompt was cancelled before the language model answered.")


@dataclass(frozen=True)
class Expansion:
    """Six descriptions and their origin.

    `source` is "library", "gpt", or "explicit" if the prompt or the user described the parts; `nearest` lists library
    prompts with their cosine similarity, best first; `note` is a sentence for the user, or ""; `explicit_parts` are the
    parts that the prompt itself describes.
    """

    descriptions: PartDescriptions
    source: Literal["library", "gpt", "explicit"]
    nearest: tuple[tuple[str, float], ...] = ()
    note: str = ""
    explicit_parts: tuple[str, ...] = ()


class Expander(Protocol):
    """Anything that turns a prompt into six body-part descriptions."""

    def expand(self, prompt: str) -> Expansion:
        """Return descriptions for `prompt`; PromptError if the prompt cannot be used."""
        ...


def check_prompt(prompt: object) -> str:
    """Return the prompt with its white space collapsed; PromptError if it is empty, too long or has control characters."""
    return check_text(prompt, "prompt", MAX_PROMPT_CHARACTERS)
