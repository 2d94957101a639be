"""Loaders of models, grounds, characters, prompts and the renderer; tests replace them."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.assets import asset_path
from runtime.character.character import DEFAULT_CHARACTER
from runtime.character.character import load_character as read_character
from runtime.motion.controller import Controller, Crowd
from runtime.motion.model import load_model as read_model
from runtime.motion.perceptual_weights import perceptual_weights
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.expander import Expander
from runtime.prompts.gpt.expander import check_endpoint, open_expander
from runtime.prompts.gpt.settings import GptSettings
from runtime.prompts.library_data import load_library, load_styles
from runtime.prompts.prompter import Prompter
from runtime.prompts.service import PromptWorker
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import TERRAIN_NAMES, load_terrain
from viewer.render.quality import choose_quality
from viewer.render.renderer import Renderer

STYLES = "prompts/styles.json"
LIBRARY = "prompts/library.json"
BETWEEN_FRAMES_S = 0.004  # sleep for the window to draw while a blend is measured


@dataclass(frozen=True)
class Loaded:
    """A loaded model: its controller, a prompt worker for each of two prompts, and the prompt library.

    `name` and `provider` are shown in the status line.
    """

    controller: Controller
    prompts: tuple[PromptWorker, PromptWorker]
    library: LibraryExpander
    name: str
    provider: str
    perceptual_weights: Callable[[Any, Any], tuple[float, ...]] | None = None  # makes a blend's change even


def load_model(directory: Path | None, terrain: Terrain, seed: int, gpt: GptSettings | None = None) -> Loaded:
    """Load a model (default: the shipped one) with its prompt encoder.

    Prompts are expanded by the library, or by the language model `gpt` with the library as fallback.
    """
    model = read_model(directory)
    prompter = Prompter(model)
    library = prompter.library
    expander = library if gpt is None else open_expander(library, gpt)
    workers = PromptWorker(expander, prompter.encoder), PromptWorker(expander, prompter.encoder)
    return Loaded(
        Controller(model, terrain, seed), workers, library, model.name, model.provider,
        lambda a, b: perceptual_weights(model, a, b, pause=BETWEEN_FRAMES_S),
    )  # fmt: skip


def load_character(path: Path | None, joint_map: Path | None = None, unit: str = "") -> Any:
    """Load a character file (default: the mannequin); `joint_map` replaces the one in its folder."""
    source = asset_path(DEFAULT_CHARACTER) if path is None else path
    character = read_character(source, joint_map, unit or None)
    _ = character.body  # fitted here, on a worker, instead of in the first frame
    return character


def make_renderer(ctx: Any, quality: str) -> Any:
    """Create the renderer with a quality preset; "" chooses one for this machine."""
    return Renderer(ctx, choose_quality(ctx, quality))


def library_prompts() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the prompts of the shipped library: one per style for the list, and all of them for suggestions."""
    styles = load_styles(asset_path(STYLES))
    entries = load_library(asset_path(LIBRARY), styles).entries
    prompts = [entry.prompt for entry in entries] + [text for entry in entries for text in entry.also]
    once = {" ".join(text.casefold().split()): text for text in reversed(prompts)}
    return tuple(dict.fromkeys(style.prompt for style in styles.values())), tuple(once.values())[::-1]


@dataclass(frozen=True)
class Services:
    """The loaders, replaceable in tests; they run on worker threads, except `make_renderer` and `terrain_names`."""

    load_model: Callable[[Path | None, Terrain, int, GptSettings | None], Loaded] = load_model
    load_terrain: Callable[[str, float, float], Terrain] = load_terrain
    load_character: Callable[[Path | None, Path | None, str], Any] = load_character
    make_renderer: Callable[[Any, str], Any] = make_renderer
    terrain_names: Callable[[], tuple[str, ...]] = lambda: TERRAIN_NAMES
    make_crowd: Callable[[Sequence[Controller]], Crowd] = Crowd
    library_prompts: Callable[[], tuple[tuple[str, ...], tuple[str, ...]]] = library_prompts
    open_expander: Callable[[Expander, GptSettings], Expander] = open_expander
    check_endpoint: Callable[[GptSettings, threading.Event], str] = check_endpoint
