"""What the application is given: loaders of models, terrains, characters, prompts and the renderer.

Tests and other front ends put their own in. Everything heavy is imported when it is called.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from runtime.controls import Controls
from runtime.pose import Pose
from runtime.prompts.expander import Expander
from runtime.prompts.gpt.settings import GptSettings
from runtime.prompts.parts import PartDescriptions
from runtime.terrain.height_map import Terrain
from viewer.render.quality import PRESETS

STYLES = "prompts/styles.json"
LIBRARY = "prompts/library.json"
BETWEEN_FRAMES_S = 0.004  # in which the window draws while a blend is measured


class ControllerLike(Protocol):
    """What the viewer needs of `runtime.motion.controller.Controller`."""

    temperature: float
    strength: float
    response: float
    message: str  # what went wrong in the last step, "" when nothing did
    seed: int

    @property
    def blocked(self) -> str | None:
        """Why the character does not go on; None where it does."""

    @property
    def traversal(self) -> str:
        """What it is over by keyframed motion, as in `runtime.traversal`; "" where the motion is the network's."""

    @property
    def trajectory(self) -> Any:
        """`positions` (12, 3) and `directions` (12, 2) in world space."""

    def step(self, controls: Controls) -> Pose:
        """Advance by 1/60 s."""

    def set_style(self, z: Any, transition_seconds: float) -> None:
        """Blend to the style code `(6, 64)`."""

    def set_terrain(self, terrain: Terrain) -> None:
        """Walk on another ground."""

    def reset(self, x: float, z: float, yaw: float) -> Any:
        """Stand at a place."""

    def twin(self) -> ControllerLike:
        """Another character of the same model; may be called and used on another thread."""


class CrowdLike(Protocol):
    """What the viewer needs of `runtime.motion.controller.Crowd`."""

    def step(self, controls: Controls) -> list[Pose]:
        """Advance all by 1/60 s."""

    def set_terrain(self, terrain: Terrain) -> None:
        """Let all walk on another ground."""

    def close(self) -> None:
        """They are no longer needed."""


class PromptWorkerLike(Protocol):
    """What the viewer needs of `runtime.prompts.service.PromptWorker`."""

    def submit(self, prompt: str | PartDescriptions) -> None:
        """Ask for a style in place of an older request."""

    def answer(self, prompt: str | PartDescriptions) -> Any:
        """The final answer on the thread that asks, without a word to who polls; raises what it meets."""

    def withdraw(self) -> None:
        """Forget what was asked."""

    def use(self, expander: Expander) -> None:
        """Expand by another expander from the next prompt on."""

    def poll(self) -> Any:
        """The newest answer to the newest request, or None."""

    def close(self, timeout_s: float = 2.0) -> bool:
        """Stop working, waiting at most so long for the text in hand; whether it has stopped."""


class LibraryLike(Expander, Protocol):
    """What the viewer needs of `runtime.prompts.english.library.LibraryExpander`."""

    def nearest(self, text: str) -> tuple[tuple[str, float], ...]:
        """The library's prompts most like `text` with their similarity, best first."""


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
    perceptual_weights: Callable[[Any, Any], tuple[float, ...]] | None = None  # makes a blend's change even


def load_model(directory: Path | None, terrain: Terrain, seed: int, gpt: GptSettings | None = None) -> Loaded:
    """The exported model of `directory` (the shipped one by default) with its prompt encoder.

    Prompts are expanded by the library, or by the language model `gpt` with the library behind it.
    """
    from runtime.motion.controller import Controller
    from runtime.motion.model import load_model as load
    from runtime.motion.perceptual_weights import perceptual_weights
    from runtime.prompts.prompter import Prompter
    from runtime.prompts.service import PromptWorker

    model = load(directory)
    prompter = Prompter(model)
    library = prompter.library
    expander = library if gpt is None else open_expander(library, gpt)
    workers = PromptWorker(expander, prompter.encoder), PromptWorker(expander, prompter.encoder)
    controller = Controller(model, terrain, seed)
    return Loaded(
        controller, workers, library, model.name, model.provider, model.notice,
        lambda a, b: perceptual_weights(model, a, b, pause=BETWEEN_FRAMES_S),
    )  # fmt: skip


def open_expander(library: LibraryLike, gpt: GptSettings) -> Expander:
    """A language model with the library behind it."""
    from runtime.prompts.gpt.expander import open_expander as open_fallback

    return open_fallback(library, gpt)


def check_endpoint(gpt: GptSettings, stop: threading.Event) -> str:
    """Ask a language model one question; what it did."""
    from runtime.prompts.gpt.expander import check_endpoint as check

    return check(gpt, stop)


def make_crowd(members: list[ControllerLike]) -> CrowdLike:
    """Characters of one model that are stepped together."""
    from runtime.motion.controller import Crowd

    return Crowd(members)  # type: ignore[arg-type]


def load_terrain(spec: str, cell_m: float, height_m: float) -> Terrain:
    """A terrain by name or file."""
    from runtime.terrain.library import load_terrain as load

    return load(spec, cell_m, height_m)


def terrain_names() -> tuple[str, ...]:
    """Names of the ready terrains."""
    from runtime.terrain.library import TERRAIN_NAMES

    return TERRAIN_NAMES


def load_character(path: Path | None, joint_map: Path | None = None) -> Any:
    """The character of a GLB file; the shipped mannequin by default. `joint_map` is read in place of the one beside it."""
    from runtime.assets import asset_path
    from runtime.character.character import DEFAULT_CHARACTER
    from runtime.character.character import load_character as load
    from runtime.character.joint_map import read_joint_map

    joints = None if joint_map is None else read_joint_map(joint_map)
    character = load(asset_path(DEFAULT_CHARACTER) if path is None else path, joints)
    _ = character.body  # fitted here, on a worker, not in the first frame
    return character


def make_renderer(ctx: Any, quality: str) -> Any:
    """The project's renderer with a preset by name; "" lets it choose for this machine."""
    from viewer.render.renderer import Renderer

    return Renderer(ctx, PRESETS.get(quality))


def library_prompts() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Prompts of the shipped library: one for each style, to choose from, and all of them, to suggest."""
    from runtime.assets import asset_path
    from runtime.prompts.english.library_data import load_library, load_styles

    styles = load_styles(asset_path(STYLES))
    entries = load_library(asset_path(LIBRARY), styles)
    prompts = [entry.prompt for entry in entries] + [text for entry in entries for text in entry.also]
    once = {" ".join(text.casefold().split()): text for text in reversed(prompts)}
    return tuple(dict.fromkeys(style.prompt for style in styles.values())), tuple(once.values())[::-1]


@dataclass(frozen=True)
class Services:
    """Loaders, called on worker threads except `make_renderer` (context, quality or "") and `terrain_names`."""

    load_model: Callable[[Path | None, Terrain, int, GptSettings | None], Loaded] = load_model
    load_terrain: Callable[[str, float, float], Terrain] = load_terrain
    load_character: Callable[[Path | None, Path | None], Any] = load_character
    make_renderer: Callable[[Any, str], Any] = make_renderer
    terrain_names: Callable[[], tuple[str, ...]] = terrain_names
    make_crowd: Callable[[list[ControllerLike]], CrowdLike] = make_crowd
    library_prompts: Callable[[], tuple[tuple[str, ...], tuple[str, ...]]] = library_prompts
    open_expander: Callable[[LibraryLike, GptSettings], Expander] = open_expander
    check_endpoint: Callable[[GptSettings, threading.Event], str] = check_endpoint
