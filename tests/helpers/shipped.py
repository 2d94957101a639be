"""Shipped assets, loaded once per test process; a test that modifies one must load its own."""

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
    """Return the default network of the program."""
    return load_model()


@cache
def shipped_prompter() -> Prompter:
    """Return the encoder of words to codes of `shipped_model()`."""
    return Prompter(shipped_model())


@cache
def shipped_encoder() -> TextEncoder:
    """Return the text encoder."""
    return TextEncoder()


@cache
def shipped_library() -> LibraryExpander:
    """Return the prompt library."""
    return LibraryExpander(shipped_encoder())


@cache
def mannequin() -> Character:
    """Return the default character of the program."""
    return load_character(MANNEQUIN)
