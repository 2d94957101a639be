"""SPORT viewer: prompts to real-time locomotion. The names of this package are the public API; the packages behind it may change.

Nothing is imported before it is used: `import sport` and `sport --help` load neither numpy nor a network.
"""

from __future__ import annotations

TYPE_CHECKING = False  # importing `typing` would come before the command's signal handlers
if TYPE_CHECKING:  # "as": names that this package gives on
    from typing import Any

    from runtime.assets import asset_path as asset_path
    from runtime.character.character import load_character as load_character
    from runtime.character.joint_map import read_joint_map as read_joint_map
    from runtime.character.skinned_mesh import skin_vertices as skin_vertices
    from runtime.controls import Controls as Controls
    from runtime.controls import Gait as Gait
    from runtime.errors import SportError as SportError
    from runtime.formats.bvh_clip import load_clip_bvh as load_clip_bvh
    from runtime.formats.bvh_clip import save_bvh as save_bvh
    from runtime.generate import generate_clip as generate_clip
    from runtime.motion.controller import Controller as Controller
    from runtime.motion.model import MotionModel as MotionModel
    from runtime.motion.model import load_model as load_model
    from runtime.pose import Pose as Pose
    from runtime.prompts.blend import BlendedPrompt as BlendedPrompt
    from runtime.prompts.blend import mix_of_parts as mix_of_parts
    from runtime.prompts.blend import parse_weights as parse_weights
    from runtime.prompts.prompter import Prompter as Prompter
    from runtime.skeleton import SPORT_SKELETON as SPORT_SKELETON
    from runtime.takes.clip import Clip as Clip
    from runtime.takes.recorder import ClipRecorder as ClipRecorder
    from runtime.terrain.height_map import Terrain as Terrain
    from runtime.terrain.library import load_terrain as load_terrain

_MODULES = {
    "BlendedPrompt": "runtime.prompts.blend",
    "Clip": "runtime.takes.clip",
    "ClipRecorder": "runtime.takes.recorder",
    "Controller": "runtime.motion.controller",
    "Controls": "runtime.controls",
    "Gait": "runtime.controls",
    "MotionModel": "runtime.motion.model",
    "Pose": "runtime.pose",
    "Prompter": "runtime.prompts.prompter",
    "SPORT_SKELETON": "runtime.skeleton",
    "SportError": "runtime.errors",
    "Terrain": "runtime.terrain.height_map",
    "asset_path": "runtime.assets",
    "generate_clip": "runtime.generate",
    "load_character": "runtime.character.character",
    "load_clip_bvh": "runtime.formats.bvh_clip",
    "load_model": "runtime.motion.model",
    "load_terrain": "runtime.terrain.library",
    "mix_of_parts": "runtime.prompts.blend",
    "parse_weights": "runtime.prompts.blend",
    "read_joint_map": "runtime.character.joint_map",
    "save_bvh": "runtime.formats.bvh_clip",
    "skin_vertices": "runtime.character.skinned_mesh",
}
__all__ = [*_MODULES]


def __getattr__(name: str) -> Any:
    """Return a public name from the module that defines it."""
    if name not in _MODULES:
        raise AttributeError(f"module 'sport' has no attribute '{name}'")
    import importlib

    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
