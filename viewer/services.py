"""What the application is given: loaders of models, terrains, characters, prompts and the renderer.

Tests and other front ends put their own in. Everything heavy is imported when it is called.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from sport.runtime.errors import FileError, UsageError
from sport.runtime.prompts.expander import Expander
from sport.runtime.prompts.gpt.settings import GptSettings
from sport.runtime.prompts.parts import PartDescriptions
from sport.runtime.terrain.height_map import Terrain
from sport.viewer.stage.simulation import ControllerLike

DEFAULT_CHARACTER = "character/mannequin.glb"
READY_PROMPTS = "prompts/styles.json"
LIBRARY = "prompts/library.json"


class PromptWorkerLike(Protocol):
    """What the viewer needs of `sport.runtime.prompts.service.PromptWorker`."""

    @property
    def busy(self) -> bool:
        """Whether a request waits or is being worked on."""
        ...

    def submit(self, prompt: str | PartDescriptions) -> None:
        """Ask for a style."""
        ...

    def withdraw(self) -> None:
        """Forget what was asked."""
        ...

    def use(self, expander: Expander) -> None:
        """Expand by another expander from the next prompt on."""
        ...

    def poll(self) -> Any:
        """The newest answer, or None."""
        ...

    def close(self, timeout_s: float = 2.0) -> None:
        """Stop working, waiting at most so long for the text in hand."""
        ...


class LibraryLike(Expander, Protocol):
    """What the viewer needs of `sport.runtime.prompts.english.library.LibraryExpander`."""

    def nearest(self, text: str) -> tuple[tuple[str, float], ...]:
        """The library's prompts most like `text` with their similarity, best first."""
        ...


@dataclass(frozen=True)
class Loaded:
    """A model ready to run: its controller, a prompt worker for each of two prompts, and their library.

    `name` and `provider` are what the status line says of it, `notice` what it says once when the model is there.
    """

    controller: ControllerLike
    prompts: tuple[PromptWorkerLike, PromptWorkerLike]
    library: LibraryLike
    name: str
    provider: str
    notice: str = ""


@dataclass(frozen=True)
class Services:
    """Loaders, each called on a worker thread except `make_renderer`, `terrain_names`, `quality_names`, `ready_prompts`."""

    load_model: Callable[[Path | None, Terrain, int, GptSettings | None], Loaded]
    load_terrain: Callable[[str, float, float], Terrain]
    load_character: Callable[[Path | None], Any]
    make_renderer: Callable[[Any, str], Any]  # (context, quality name or "")
    terrain_names: Callable[[], tuple[str, ...]]
    quality_names: Callable[[], tuple[str, ...]]
    ready_prompts: Callable[[], tuple[str, ...]]
    library_prompts: Callable[[], tuple[str, ...]]
    open_expander: Callable[[LibraryLike, GptSettings], Expander]
    check_endpoint: Callable[[GptSettings, threading.Event], str]


def default_services() -> Services:
    """The project's own."""
    return Services(
        load_model=load_model,
        load_terrain=load_terrain,
        load_character=load_character,
        make_renderer=make_renderer,
        terrain_names=terrain_names,
        quality_names=lambda: ("software", "high"),
        ready_prompts=ready_prompts,
        library_prompts=library_prompts,
        open_expander=open_expander,
        check_endpoint=check_endpoint,
    )


def load_model(directory: Path | None, terrain: Terrain, seed: int, gpt: GptSettings | None = None) -> Loaded:
    """The exported model of `directory` (the shipped one by default) with its prompt encoder.

    Prompts are expanded by the library, or by the language model `gpt` with the library behind it.
    """
    from sport.runtime.motion.controller import Controller
    from sport.runtime.motion.model import load_model as load
    from sport.runtime.prompts.prompter import Prompter
    from sport.runtime.prompts.service import PromptWorker

    model = load(directory)
    prompter = Prompter(model)
    library = prompter.library
    expander = library if gpt is None else open_expander(library, gpt)
    workers = PromptWorker(expander, prompter.encoder), PromptWorker(expander, prompter.encoder)
    return Loaded(
        Controller(model, terrain, seed), workers, library, model.name, model.provider, model.notice
    )


def open_expander(library: LibraryLike, gpt: GptSettings) -> Expander:
    """A language model with the library behind it."""
    from sport.runtime.prompts.gpt.fallback import open_expander as open_fallback

    return open_fallback(library, gpt)


def check_endpoint(gpt: GptSettings, stop: threading.Event) -> str:
    """Ask a language model one question; what it did."""
    from sport.runtime.prompts.gpt.check import check_endpoint as check

    return check(gpt, stop)


def load_terrain(spec: str, cell_m: float, height_m: float) -> Terrain:
    """A terrain by name or file."""
    from sport.runtime.terrain.library import load_terrain as load

    return load(spec, cell_m, height_m)


def terrain_names() -> tuple[str, ...]:
    """Names of the ready terrains."""
    from sport.runtime.terrain.library import TERRAIN_NAMES

    return TERRAIN_NAMES


def load_character(path: Path | None) -> Any:
    """The character of a GLB file; the shipped mannequin by default."""
    from sport.runtime.assets import asset_path
    from sport.runtime.character.character import load_character as load

    return load(asset_path(DEFAULT_CHARACTER) if path is None else path)


def make_renderer(ctx: Any, quality: str) -> Any:
    """The project's renderer; "" lets it choose the quality for this machine."""
    from sport.viewer.render.quality import HIGH, SOFTWARE
    from sport.viewer.render.renderer import Renderer

    presets = {preset.name: preset for preset in (SOFTWARE, HIGH)}
    if quality and quality not in presets:
        raise UsageError(
            f"quality '{quality[:40]}': there is no such preset.", f"Choose {' or '.join(presets)}."
        )
    return Renderer(ctx, presets.get(quality))


def ready_prompts() -> tuple[str, ...]:
    """The prompt of each style of the shipped library, without repetitions."""
    from sport.runtime.assets import asset_path

    path = asset_path(READY_PROMPTS)
    try:
        styles = json.loads(path.read_text(encoding="utf-8"))
        prompts = [style["prompt"] for style in styles.values()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileError(f"{path}: no library of prompts ({error}).", "Install the program again.") from error
    return tuple(dict.fromkeys(str(prompt) for prompt in prompts))


def library_prompts() -> tuple[str, ...]:
    """Every prompt of the shipped library, to suggest while one is typed: entries first, then other words for them."""
    from sport.runtime.assets import asset_path
    from sport.runtime.prompts.english.library_data import load_library, load_styles

    entries = load_library(asset_path(LIBRARY), load_styles(asset_path(READY_PROMPTS)))
    prompts = [entry.prompt for entry in entries] + [text for entry in entries for text in entry.also]
    return tuple({" ".join(text.casefold().split()): text for text in reversed(prompts)}.values())[::-1]
