"""Everything the application knows about itself, as plain data: panels read it, actions change it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from sport.runtime.skeleton import PART_NAMES
from sport.viewer.messages import Messages
from sport.viewer.prompt.style_edit import StyleEdit
from sport.viewer.settings import Settings
from sport.viewer.stage.simulation import Simulation

if TYPE_CHECKING:
    from sport.runtime.takes.clip import Clip
    from sport.runtime.terrain.height_map import Terrain
    from sport.viewer.takes.playback import Playback

FPS_HALF_LIFE_S = 0.5


@dataclass
class FieldState:
    """One text field for a prompt, with its suggestions."""

    text: str = ""
    focus_requested: bool = False
    suggesting: bool = False  # the list is open
    picked: int = -1  # line of the list that the arrow keys chose
    recalled: int = -1  # which prompt of the history stands in the field
    near: tuple[tuple[str, float], ...] = ()  # the library's prompts nearest to `near_to`
    near_to: str = ""


@dataclass
class PromptState:
    """The prompt panel: what was typed, and what the character moves by."""

    box: FieldState = field(default_factory=FieldState)  # prompt A
    other: FieldState = field(default_factory=FieldState)  # prompt B, to blend with
    parts: dict[str, str] = field(default_factory=lambda: dict.fromkeys(PART_NAMES, ""))  # the six fields
    edit: StyleEdit = field(default_factory=StyleEdit)  # what holds now
    asked: frozenset[str] = frozenset()  # sides ("a", "b") whose answer is on its way
    available: bool = True  # False when the model could not be loaded
    loading: bool = True
    tab_requested: str = ""  # "blend": shown from the next frame on
    search: str = ""
    ready: tuple[str, ...] = ()  # prompts to choose from
    library: tuple[str, ...] = ()  # prompts to suggest

    def applied(self, part: str) -> str:
        """The words that a part moves by; "" before the first answer."""
        return "" if self.edit.a is None else str(getattr(self.edit.a.words, part))


@dataclass
class ExpanderState:
    """Who answers prompts, and the language model's settings that are not remembered."""

    language_model: str = ""  # "model at host" while one is asked, "" when the library answers alone
    key: str = field(default="", repr=False)  # typed here: in memory only, never written
    problem: str = ""  # why no language model can be asked though one is wanted
    testing: bool = False
    report: str = ""  # what the last test said
    report_good: bool = False


@dataclass
class SceneState:
    """The scene panel."""

    terrain_names: tuple[str, ...] = ()
    terrain_spec: str = ""  # name or path of the shown terrain
    file_path: str = ""  # the path field
    loading: str = ""  # what is being loaded, for the panel
    quality_names: tuple[str, ...] = ()
    quality: str = ""
    character: str = ""


@dataclass
class ClipItem:
    """One clip in the list; `saved` is where it was last exported to."""

    clip: Clip
    saved: Path | None = None
    recorded: bool = False  # here, not opened from a file

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.clip.name


@dataclass
class ClipsState:
    """Recording, the clip list and what is played back."""

    items: list[ClipItem] = field(default_factory=list)
    selected: int = -1
    recording: bool = False
    recorded_s: float = 0.0
    memory_s: float = 0.0  # how much the rolling memory holds
    playback: Playback | None = None
    export_path: str = ""
    counter: int = 0  # for clip names

    @property
    def current(self) -> ClipItem | None:
        """The selected clip."""
        return self.items[self.selected] if 0 <= self.selected < len(self.items) else None


@dataclass
class Stats:
    """Smoothed times of frames, all by the clock on the wall."""

    frame_ms: float = 0.0  # work of one frame, without waiting
    fps: float = 0.0  # pictures a second
    steps_per_s: float = 0.0  # simulation steps a second; 60 is real time

    def add(self, work_s: float, interval_s: float, steps: int) -> None:
        """Take one frame: its work, the time since the frame before (both in seconds), and its simulation steps."""
        if interval_s <= 0.0:
            return
        share = 1.0 if self.fps == 0.0 else 1.0 - 0.5 ** (interval_s / FPS_HALF_LIFE_S)
        self.frame_ms += (work_s * 1e3 - self.frame_ms) * share
        self.fps += (1.0 / interval_s - self.fps) * share
        self.steps_per_s += (steps / interval_s - self.steps_per_s) * share


@dataclass
class AppState:
    """The one state of the application."""

    settings: Settings
    terrain: Terrain
    simulation: Simulation
    messages: Messages = field(default_factory=Messages)
    prompt: PromptState = field(default_factory=PromptState)
    expander: ExpanderState = field(default_factory=ExpanderState)
    scene: SceneState = field(default_factory=SceneState)
    clips: ClipsState = field(default_factory=ClipsState)
    stats: Stats = field(default_factory=Stats)
    model_name: str = ""  # "" while loading
    provider: str = ""
    device: str = "keyboard"  # name of the gamepad, or "keyboard"
    crouching: bool = False  # the toggle is on
    help_open: bool = False
    panels_open: bool = True
