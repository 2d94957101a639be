"""What the viewer remembers between runs: a small JSON file in the person's configuration directory."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sport.runtime.atomic import write_atomic
from sport.runtime.motion.controller import TEMPERATURE
from sport.runtime.prompts.gpt.settings import has_credentials

MAX_BYTES = 1_000_000
MAX_LIST = 50  # entries of a list
MAX_TEXT = 4096  # characters of a text
FILE_NAME = "settings.json"
MAPPINGS_NAME = "gamecontrollerdb.txt"

_CHOICES: dict[str, tuple[Any, ...]] = {
    "export_fps": (60, 30),
    "export_unit": ("cm", "m"),
    "camera": ("follow", "orbit"),
    "quality": ("", "software", "high"),
    "expander": ("", "library", "gpt"),
}
_RANGES: dict[str, tuple[float, float]] = {
    "width": (320, 8192),
    "height": (240, 8192),
    "ui_scale": (0.0, 4.0),
    "max_fps": (10.0, 1000.0),
    "blend_seconds": (0.1, 5.0),
    "keep_seconds": (1.0, 300.0),
    "temperature": (0.0, 2.0),
    "strength": (0.0, 1.5),
    "dead_zone": (0.0, 0.9),
    "height_map_cell_m": (0.01, 10.0),
    "height_map_height_m": (0.0, 100.0),
    "gpt_timeout_s": (1.0, 120.0),
}


@dataclass
class Settings:
    """Remembered choices; every field has a safe default."""

    width: int = 1280  # window, screen units
    height: int = 720
    ui_scale: float = 0.0  # 0: as the monitor says
    vsync: bool = True
    max_fps: float = 120.0
    quality: str = ""  # "": chosen by the renderer for this machine
    terrain: str = "hills"
    height_map_cell_m: float = 0.1
    height_map_height_m: float = 2.0
    camera: str = "follow"
    show_grid: bool = True
    show_trajectory: bool = True
    show_skeleton: bool = False
    show_contacts: bool = False
    temperature: float = TEMPERATURE
    strength: float = 1.0  # of styles, 1 as the model shows them
    blend_seconds: float = 0.8
    keep_seconds: float = 10.0  # what "save the last seconds" takes
    export_folder: str = "~/sport-clips"
    export_fps: int = 60
    export_unit: str = "cm"
    dead_zone: float = 0.15  # of a stick's travel
    invert_look: bool = False
    prompt_history: list[str] = field(default_factory=list)  # newest first
    expander: str = ""  # what answers prompts: "library", "gpt", or "" for what the environment says
    gpt_base_url: str = ""  # "": the environment's or OpenAI's; one with credentials is not kept
    gpt_model: str = ""
    gpt_timeout_s: float = 10.0
    # no field for the key: it stays in memory or in the environment


def config_directory(environment: dict[str, str] | None = None) -> Path:
    """Where settings live: $SPORT_CONFIG_DIR, else $XDG_CONFIG_HOME/sport-viewer, else ~/.config/sport-viewer."""
    env = os.environ if environment is None else environment
    if env.get("SPORT_CONFIG_DIR"):
        return Path(env["SPORT_CONFIG_DIR"])
    base = env.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "sport-viewer"


def load_settings(directory: Path) -> tuple[Settings, list[str]]:
    """Settings from `directory` and the complaints about it; whatever cannot be read keeps its default."""
    path = directory / FILE_NAME
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        return Settings(), []
    except OSError as error:
        return Settings(), [f"{path}: cannot be read ({error.strerror}); the default settings are used."]
    try:
        content = json.loads(data) if len(data) <= MAX_BYTES else None
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        return Settings(), [
            f"{path}: not a settings file (expected a JSON object); the default settings are used."
        ]
    settings, complaints = Settings(), []
    for entry in dataclasses.fields(Settings):
        if entry.name not in content:
            continue
        default = getattr(settings, entry.name)
        value = _checked(entry.name, content[entry.name], default)
        if value is None:
            complaints.append(
                f"{path}: field {entry.name} has the unusable value {str(content[entry.name])[:40]!r}; {default!r} is used."
            )
        else:
            setattr(settings, entry.name, value)
    return settings, complaints


def _checked(name: str, value: Any, default: Any) -> Any:
    """`value` as the type of `default` when it is allowed, else None."""
    if isinstance(default, bool):
        return value if isinstance(value, bool) else None
    if isinstance(default, str):
        return value if _is_text(value) and value in _CHOICES.get(name, (value,)) else None
    if isinstance(default, list):
        usable = isinstance(value, list) and len(value) <= MAX_LIST and all(map(_is_text, value))
        return list(value) if usable else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    if name in _CHOICES:
        return value if value in _CHOICES[name] else None
    low, high = _RANGES[name]
    return type(default)(value) if low <= value <= high else None


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) < MAX_TEXT and "\0" not in value


def save_settings(settings: Settings, directory: Path) -> None:
    """Write settings so that the file is whole or the old one; FileError when it cannot be written.

    An address that may hold credentials is left out.
    """
    values = dataclasses.asdict(settings)
    if has_credentials(settings.gpt_base_url):
        values["gpt_base_url"] = ""
    write_atomic(directory / FILE_NAME, json.dumps(values, indent=2) + "\n")
