"""What ships, loaded once for every test of a process; a test that changes one of these loads its own."""

from functools import cache

from runtime.assets import asset_path
from runtime.character.character import Character, load_character
from runtime.motion.model import MotionModel, load_model
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.prompter import Prompter
from runtime.prompts.text_encoder import TextEncoder

MANNEQUIN = asset_path("character/mannequin.glb")


@cache
def shipped_model() -> MotionModel:
    """The network that the program begins with."""
    return load_model()


@cache
def shipped_prompter() -> Prompter:
    """From words to the codes of `shipped_model()`."""
    return Prompter(shipped_model())


@cache
def shipped_encoder() -> TextEncoder:
    """Embeddings of sentences."""
    return TextEncoder()


@cache
def shipped_library() -> LibraryExpander:
    """The prompt library."""
    return LibraryExpander(shipped_encoder())


@cache
def mannequin() -> Character:
    """The character that the program begins with."""
    return load_character(MANNEQUIN)
