"""Ground, character, model and quality: loading them without losing the ones in use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sport.runtime.prompts.gpt.settings import GptSettings
from sport.runtime.terrain.height_map import Terrain
from sport.viewer.jobs import Jobs
from sport.viewer.prompt.expanders import Expanders
from sport.viewer.prompt.prompting import Prompting
from sport.viewer.prompt.suggester import Suggester
from sport.viewer.services import Loaded, Services
from sport.viewer.state import AppState


@dataclass
class Scene:
    """Actions of the scene panel."""

    state: AppState
    jobs: Jobs
    services: Services
    prompting: Prompting
    expanders: Expanders
    suggester: Suggester
    ctx: Any  # OpenGL context
    renderer: Any
    _character: Any = None
    character_path: Path | None = None

    def load_terrain(self, spec: str) -> None:
        """Show and walk on a terrain, by name or file; the old one stays until the new one is there."""
        settings, scene = self.state.settings, self.state.scene
        spec = str(Path(spec).expanduser()) if spec.startswith("~") else spec
        scene.loading = spec
        cell, height = settings.height_map_cell_m, settings.height_map_height_m
        self.jobs.submit(
            "terrain",
            lambda: self.services.load_terrain(spec, cell, height),
            lambda terrain: self._take_terrain(spec, terrain),
            lambda _: self._stop_loading(),
        )

    def _take_terrain(self, spec: str, terrain: Terrain) -> None:
        self._stop_loading()
        self.renderer.set_terrain(terrain)
        state = self.state
        state.terrain = terrain
        state.scene.terrain_spec = spec
        if spec in state.scene.terrain_names:
            state.settings.terrain = spec
        if state.simulation.controller is not None:
            state.simulation.controller.set_terrain(terrain)
        self.reset_character()

    def _stop_loading(self) -> None:
        self.state.scene.loading = ""

    def reset_character(self) -> None:
        """Put the character back to the start, facing +Z."""
        from sport.viewer.stage.simulation import Simulation

        simulation = self.state.simulation
        if simulation.controller is not None:
            simulation.reset(0.0, 0.0, 0.0)
        else:
            self.state.simulation = Simulation.standing(self.state.terrain)

    def load_character(self, path: Path | None) -> None:
        """Show another skinned character; None is the shipped one."""
        self.jobs.submit(
            "character",
            lambda: self.services.load_character(path),
            lambda character: self._take_character(path, character),
        )

    def _take_character(self, path: Path | None, character: Any) -> None:
        self.renderer.set_character(character)
        self._character, self.character_path = character, path
        self.state.scene.character = "Mannequin" if path is None else path.stem
        if path is not None:
            self.state.messages.note(f"Character {path.name} loaded.")

    def load_model(self, directory: Path | None, seed: int) -> None:
        """Load the networks; the character stands until they are there."""
        terrain, gpt = self.state.terrain, self.expanders.wanted()
        self.jobs.submit(
            "model",
            lambda: self.services.load_model(directory, terrain, seed, gpt),
            lambda loaded: self._take_model(loaded, gpt),
            self._lose_model,
        )

    def _lose_model(self, _: Exception) -> None:
        self.state.prompt.available = self.state.prompt.loading = False

    def _take_model(self, loaded: Loaded, gpt: GptSettings | None) -> None:
        state = self.state
        loaded.controller.set_terrain(state.terrain)  # it may have changed while the model was loading
        state.simulation.use(loaded.controller)
        state.prompt.available = True
        state.model_name, state.provider = loaded.name, loaded.provider
        if loaded.notice:
            state.messages.note(loaded.notice)
        self.set_temperature(state.settings.temperature)
        self.set_strength(state.settings.strength)
        self.suggester.nearest = loaded.library.nearest
        self.expanders.use(loaded, gpt)

    def set_temperature(self, temperature: float) -> None:
        """How lively the sampler is; 0 always takes the mean."""
        self.state.settings.temperature = temperature
        controller = self.state.simulation.controller
        if controller is not None and hasattr(controller, "temperature"):
            controller.temperature = temperature

    def set_strength(self, strength: float) -> None:
        """How far styles go from plain walking, from the next frame on; 1 is as the model shows them."""
        self.state.settings.strength = strength
        controller = self.state.simulation.controller
        if controller is not None and hasattr(controller, "strength"):
            controller.strength = strength

    def set_quality(self, name: str) -> None:
        """Render with another preset, "" for the one that fits this machine."""
        renderer = self.services.make_renderer(self.ctx, name)
        renderer.set_terrain(self.state.terrain)
        if self._character is not None:
            renderer.set_character(self._character)
        self.renderer.release()
        self.renderer = renderer
        self.state.settings.quality = name
        self.state.scene.quality = renderer.quality.name
