"""The stage room's slice of the state: the ground, the character that moves on it, and how it is shown."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from runtime.character.shape import BodyShape
from runtime.terrain.height_map import Terrain
from viewer.services import ControllerLike
from viewer.stage.simulation import Simulation


@dataclass
class StageState:
    """What is on the stage."""

    terrain: Terrain
    simulation: Simulation
    terrain_names: tuple[str, ...] = ()
    terrain_spec: str = ""  # name or path of the shown terrain
    file_path: str = ""  # the path field
    shape: BodyShape = field(default_factory=BodyShape)  # of the mannequin
    loading: str = ""  # the ground that is being loaded
    quality: str = ""  # name of the renderer's preset
    model_name: str = ""  # "" while loading
    provider: str = ""
    model_folder: Path | None = None  # asked for last; None: the default

    @property
    def controller(self) -> ControllerLike | None:
        """What moves the character; None until a model is loaded."""
        return self.simulation.controller
