"""Settings stored between runs, each with its range and widget: a small JSON file of the user."""

import copy
import dataclasses
import json
import os
import reprlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from runtime.atomic import write_atomic, write_new
from runtime.errors import FileError
from runtime.motion.controller import TEMPERATURE
from runtime.options import spec_of, specified
from runtime.prompts.gpt.settings import has_credentials
from runtime.safe_read import expanded, is_text, parse_json, read_bounded
from viewer.jobs import Jobs, Slot

MAX_FILE_BYTES = 1_000_000
MAX_LIST_ENTRIES = 50  # entries of a list
MAX_TEXT_CHARACTERS = 4096  # characters of a text
FILE_NAME = "settings.json"
WRITE_INTERVAL_S = 1.0
MAPPINGS_NAME = "gamecontrollerdb.txt"
_SLOT = Slot("settings")


QUALITIES = {"": "Automatic", "fast": "Fast", "software": "Software", "high": "High"}
LOOKS = {"own": "Own", "contrast": "Contrast", "parts": "Parts"}  # of the character
CAMERAS = {"follow": "Follow", "orbit": "Orbit"}
TAKE_ORDERS = {"": "In their order", "name": "By name", "length": "By length", "rating": "By rating"}
# of the orbit camera
VIEWS = {"front": "Front", "side": "Side", "three_quarters": "3/4", "feet": "Feet", "top": "Top"}
# what the mouse does in the view, see `viewer.input.bindings.NAVIGATION`
NAVIGATIONS = {"sport": "SPORT", "blender": "Blender", "maya": "Maya"}


@dataclass
class Settings:
    """Settings stored between runs; every field has a safe default."""

    width: int = specified(1280, 320, 8192)  # window, screen units
    height: int = specified(720, 240, 8192)
    ui_scale: float = specified(0.0, 0.0, 4.0)  # 0: the monitor's
    vsync: bool = True
    max_fps: float = specified(120.0, 10.0, 1000.0)
    quality: str = specified("", choices=QUALITIES, label="Quality")
    terrain: str = "hills"
    character: str = "walker"  # name of a shipped one, or a file
    height_map_cell_m: float = specified(
        0.1, 0.01, 10.0, label="Pixel %.2f m", speed=0.005,
        hint="Distance between neighbouring pixels. Drag, or double-click to type.",
    )  # fmt: skip
    height_map_height_m: float = specified(
        2.0, 0.01, 100.0, label="White %.2f m", speed=0.02,
        hint="Height of a white pixel; black lies at 0. Drag, or double-click to type.",
    )  # fmt: skip
    camera: str = specified("follow", choices=CAMERAS, label="Camera")
    look: str = specified(
        "own", choices=LOOKS, label="Look",
        hint="The character's own colours, light and dark, or a colour for each part that a prompt describes",
    )  # fmt: skip
    fit_to_motion: bool = specified(
        False, label="Fit to the motion",
        hint="The character gets the size of the motion. Off: it keeps its own, with steps and speed to match",
    )  # fmt: skip
    show_grid: bool = specified(True, label="Grid", hint="A metre grid on the ground (F5)")
    show_trajectory: bool = specified(
        True, label="Trajectory", hint="The path the character intends, one second back and ahead (F2)"
    )
    show_skeleton: bool = specified(False, label="Skeleton", hint="Bones through the skin (F3)")
    show_contacts: bool = specified(
        False, label="Contacts", hint="Which heels and toes stand on the ground (F4)"
    )
    show_ghosts: bool = specified(
        False, label="Ghosts", hint="Poses before the one shown; in a take also after it"
    )
    show_trails: bool = specified(
        False, label="Trails", hint="Lines of hands, feet, head and hips, blue where slow, red where fast"
    )
    ghost_frames: float = specified(
        10.0, 2.0, 60.0, label="a ghost every %.0f frames", whole=True, logarithmic=True
    )
    temperature: float = specified(
        TEMPERATURE, 0.0, 2.0, label="%.2f",
        hint="Temperature of the sampler: 0 always moves the same, 1 varies as the captures do, more is livelier",
    )  # fmt: skip
    response: float = specified(
        0.0, 0.0, 1.0, label="%.0f %%", factor=100.0, whole=True,
        hint="How quickly starts, stops and turns follow the stick: 0 with the weight of a body, 100 at once as in a game",
    )  # fmt: skip
    strength: float = specified(
        1.0, 0.0, 1.5, label="strength %.0f %%", factor=100.0, whole=True,
        hint="Style strength: 0 is plain walking, more than 100 exaggerates the style",
    )  # fmt: skip
    vmc_root: bool = specified(
        False, label="Way on the root", hint="/VMC/Ext/Root/Pos goes over the ground; the hips stay above it"
    )
    exact_legs: bool = specified(
        True, label="Exact edits",
        hint="Body edits add what the network does not show of a prompt: line of the feet, hips, heels,\nknees, lean, sway, elbows, swing, places of hands. Off: the network alone",
    )  # fmt: skip
    blend_seconds: float = specified(
        0.8, 0.1, 5.0, label="change over %.1f s", logarithmic=True,
        hint="How long the character takes to change from one style to the next",
    )  # fmt: skip
    keep_seconds: float = specified(10.0, 1.0, 300.0, label="%.0f seconds", whole=True, logarithmic=True)
    takes_order: str = specified("", choices=TAKE_ORDERS)
    export_folder: str = "~/sport-clips"
    export_fps: int = specified(60, choices={60: "60 fps", 30: "30 fps"})
    export_unit: str = specified("cm", choices={"cm": "cm", "m": "m"})
    export_form: str = ""  # of the export window, as JSON
    dead_zone: float = specified(
        0.15, 0.0, 0.9, label="%.0f %% of the travel", factor=100.0, whole=True,
        hint="How far a stick of the gamepad moves before it counts",
    )  # fmt: skip
    navigation: str = specified("sport", choices=NAVIGATIONS)
    pad_buttons: str = ""  # changed gamepad and keyboard bindings, see `viewer.input.bindings.bound`
    keys: str = ""
    invert_look: bool = specified(False, label="Invert look", hint="Stick and keys up look down")
    text_size: float = specified(1.0, choices={0.9: "Small", 1.0: "Normal", 1.15: "Large"})
    known_models: list[str] = field(default_factory=list)  # folders chosen here, newest first
    known_films: list[str] = field(default_factory=list)  # films chosen here, newest first
    model_folder: str = ""  # name of a shipped model or folder of an exported one; "": the default
    first_minute_seen: bool = False
    recent_sessions: list[str] = field(default_factory=list)  # newest first
    prompt_history: list[str] = field(default_factory=list)  # newest first
    # what answers prompts; "" for the environment's choice
    expander: str = specified("", choices={"": "", "library": "Library", "gpt": "Language model"})
    gpt_base_url: str = ""  # "": the environment's or OpenAI's; one with credentials is not stored
    gpt_model: str = ""
    gpt_timeout_s: float = specified(
        10.0, 1.0, 120.0, label="Wait up to %.0f s", whole=True, logarithmic=True
    )
    # no field for the key: it stays in memory or in the environment


def config_directory(environment: dict[str, str] | None = None) -> Path:
    """Return the settings folder: $SPORT_CONFIG_DIR, else $XDG_CONFIG_HOME/sport-viewer, else ~/.config/sport-viewer."""
    env = os.environ if environment is None else environment
    if env.get("SPORT_CONFIG_DIR"):
        return Path(env["SPORT_CONFIG_DIR"])
    base = env.get("XDG_CONFIG_HOME") or "~/.config"
    return expanded(base) / "sport-viewer"


def under_home(path: Path) -> str:
    """Return a path as text, with the home directory written as ~."""
    home = Path.home()
    return str(Path("~") / path.relative_to(home)) if path.is_relative_to(home) else str(path)


def load_settings(directory: Path) -> tuple[Settings, list[str]]:
    """Load the settings from `directory`, with messages about invalid ones, which get their defaults."""
    path = directory / FILE_NAME
    try:
        content = _read(path)
    except FileError as error:
        return Settings(), [f"{error.problem} The default settings are used."]
    settings, unusable = Settings(), []
    for entry in dataclasses.fields(Settings):
        if entry.name not in content:
            continue
        default = getattr(settings, entry.name)
        value = checked(entry.name, content[entry.name], default)
        if value is None:
            unusable.append(f"{entry.name} ({ascii(reprlib.repr(content[entry.name]))[1:-1]})")
        else:
            setattr(settings, entry.name, value)
    if unusable:
        return settings, [f"{path}: unusable values of {', '.join(unusable)}; the defaults are used."]
    return settings, []


def _read(path: Path) -> dict[str, Any]:
    """Return the fields of the file, of any type; none without a file. FileError when it holds no settings."""
    if not os.path.lexists(path):
        return {}
    try:
        content = parse_json(read_bounded(path, MAX_FILE_BYTES))
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise FileError(f"{path}: not a settings file (expected a JSON object).", "Remove it.")
    return content


def checked(name: str, value: Any, default: Any) -> Any:
    """Return `value` converted to the type of `default` if the setting `name` allows it, else None."""
    if isinstance(default, list):
        return list(filter(_is_text, value))[:MAX_LIST_ENTRIES] if isinstance(value, list) else None
    read = spec_of(Settings, name).read(value, default)
    same = value == default and isinstance(value, bool) == isinstance(default, bool)
    return read if same or read != default else None


def remembered(text: str, known: list[str], count: int = MAX_LIST_ENTRIES) -> list[str]:
    """Return the list with a text moved to the front, limited to `count` entries."""
    return [text, *(other for other in known if other != text)][:count]


def _is_text(value: Any) -> bool:
    return is_text(value) and len(value) < MAX_TEXT_CHARACTERS and "\0" not in value


@dataclass
class KeptSettings:
    """Writes changed settings to disk on a worker, at most `WRITE_INTERVAL_S` after a change."""

    settings: Settings
    directory: Path
    jobs: Jobs
    active: bool
    clock: Callable[[], float] = time.monotonic
    _written: Settings = field(init=False)  # the initial ones, or those last written
    _tried: Settings = field(init=False)  # a failed write is only reported once
    _next_s: float = 0.0

    def __post_init__(self) -> None:
        self._written = self._tried = copy.deepcopy(self.settings)

    def watch(self) -> None:
        """Write changed settings if due; call once per frame."""
        if self.active and self.clock() >= self._next_s and self.settings != self._tried:
            self._next_s = self.clock() + WRITE_INTERVAL_S
            self._write()

    def finish(self, until: float) -> bool:
        """Write changed settings until a time of `time.monotonic`; return whether they are on disk."""
        if self.active:
            self._write()
        return self.jobs.finish(_SLOT.what, until) and self._written == self._tried

    def _write(self) -> None:
        self._tried = now = copy.deepcopy(self.settings)

        def done(_: None) -> None:
            self._written = now

        work = partial(save_settings, now, self.directory, self._written)
        self.jobs.submit(_SLOT, work, done, writing="the file of settings")


def save_settings(settings: Settings, directory: Path, before: Settings | None = None) -> None:
    """Write settings completely or not at all; FileError if they cannot be written.

    With `before`, the settings at startup, only changes made since are written, since another run may have saved its
    own. A URL that may contain credentials is left out.
    """
    values = dataclasses.asdict(settings)
    if has_credentials(settings.gpt_base_url):
        values["gpt_base_url"] = ""
    path = directory / FILE_NAME
    content: dict[str, Any] = {}
    if before is not None:
        content = _read_or_keep_aside(path)
        values = {**content, **_changes(values, dataclasses.asdict(before), content)}
    if values != content:  # otherwise a write failure does not matter
        write_atomic(path, json.dumps(values, indent=2) + "\n")


def _read_or_keep_aside(path: Path) -> dict[str, Any]:
    """Return the fields of the file; a file with unusable values is kept under another name before it is replaced."""
    try:
        content = _read(path)
        kept = Settings()
        unusable = [
            name
            for name, value in content.items()
            if hasattr(kept, name) and checked(name, value, getattr(kept, name)) != value
        ]
    except FileError:  # reported at the start
        content, unusable = {}, [FILE_NAME]
    if unusable and path.is_file():
        stamp = time.strftime("%Y%m%d-%H%M%S")
        write_new(path.with_name(f"{path.name}.damaged-{stamp}"), read_bounded(path, MAX_FILE_BYTES))
    return content


def _changes(values: dict[str, Any], before: dict[str, Any], content: dict[str, Any]) -> dict[str, Any]:
    """Return the values to write: the file's content with changed fields, and with its unusable ones replaced."""
    found = {}
    for name, value in values.items():
        theirs = checked(name, content[name], value) if name in content else before[name]
        if theirs is None:
            found[name] = value
        elif value != before[name]:
            found[name] = _joined(value, theirs, before[name]) if isinstance(value, list) else value
    return found


def _joined(ours: list[str], theirs: list[str], before: list[str]) -> list[str]:
    added = [text for text in theirs if text not in before and text not in ours]
    return [*ours, *added][:MAX_LIST_ENTRIES]
