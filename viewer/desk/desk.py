"""The desk as one: projects, dialogs and settings with what they need of the other rooms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from runtime.assets import DEFAULT_MODEL, model_folder, model_name
from viewer.desk.guide import Guide
from viewer.desk.state import DeskState
from viewer.exports.exporting import Exporting
from viewer.gui.dialogs import DialogKind, Dialogs
from viewer.jobs import Jobs
from viewer.messages import Messages
from viewer.projects.contents import Contents
from viewer.projects.projects import Projects
from viewer.prompt.prompting import Prompting
from viewer.settings import Settings
from viewer.stage.stage import Stage
from viewer.takes.takes import Takes


@dataclass
class Desk:
    """Actions of the menu over the view."""

    state: DeskState
    settings: Settings
    messages: Messages
    jobs: Jobs
    takes: Takes
    stage: Stage
    prompting: Prompting
    load_model: Callable[[Path | None, int], None]
    use_scale: Callable[[float], None]  # of the interface
    folder: Path  # the state folder
    dialogs: Dialogs = field(init=False)
    projects: Projects = field(init=False)
    exporting: Exporting = field(init=False)
    guide: Guide = field(init=False)

    def __post_init__(self) -> None:
        self.dialogs = Dialogs(self.messages)
        contents = Contents(
            self.takes,
            self.stage,
            self.prompting,
            self.settings,
            self.load_model,
            self.folder / "characters",
            [],
        )
        self.projects = Projects(
            self.state.projects,
            self.settings,
            self.messages,
            self.jobs,
            contents,
            self.dialogs,
            self.folder / "sessions",
        )
        self.exporting = Exporting(
            self.state.exports, self.takes, self.stage, self.messages, self.jobs, self.dialogs
        )
        self.guide = Guide(self.settings, self.prompting.state, self.takes)

    @property
    def files(self) -> dict[str, Callable[[Path], None]]:
        """What opens a file, by its suffix."""
        return self.projects.files

    def ask_file(self, open_files: Callable[[list[Path]], None]) -> None:
        """Choose a file of any kind that is opened here."""
        endings = sorted({*self.stage.files, *self.takes.files, *self.files})
        filters = ["All that opens", " ".join(f"*{ending}" for ending in endings), "All files", "*"]
        self._ask("Open a file", lambda path: open_files([path]), filters)

    def ask_for(self, title: str, endings: Sequence[str], done: Callable[[Path], None]) -> None:
        """Choose a file with one of these endings."""
        self._ask(title, done, [title, " ".join(f"*{ending}" for ending in endings), "All files", "*"])

    def _ask(self, title: str, done: Callable[[Path], None], filters: Sequence[str]) -> None:
        start = Path(self.settings.export_folder).expanduser()
        self.dialogs.ask(DialogKind.OPEN, title, start if start.is_dir() else Path.home(), done, filters)

    def begin(self, project: str | None, autosaving: bool) -> None:
        """Look for what other runs left, and open the project of the command line; "last" is the one open last."""
        self.projects.autosaving = autosaving
        if autosaving:
            self.projects.look(tell=True)
            if not self.settings.first_minute_seen:
                self.guide.begin()
        if project == "last":
            self.projects.open_last()
        elif project is not None:
            self.projects.open(Path(project))

    def poll(self, dt: float, moving: bool) -> None:
        """Notice changes, answers of dialogs and steps of the first minute; call once a frame."""
        self.projects.poll()
        self.guide.watch(dt, moving)

    @property
    def model_home(self) -> Path:
        """Where the dialog for a model begins."""
        folder = self.stage.state.model_folder
        return Path.home() if folder is None else folder.parent

    def chosen_model(self, offscreen: bool) -> Path | None:
        """The model to begin with: the one chosen in the settings, as long as it is there."""
        text = self.settings.model_folder
        if not text or offscreen:
            return None
        if not model_folder(text).is_dir():
            self.messages.warn(f"The model {text} is not there any more: {DEFAULT_MODEL} is used.")
            return None
        return model_folder(text)

    def choose_model(self, folder: Path | None) -> None:
        """Load another model, now and at the next start; None is the default."""
        controller = self.stage.state.controller
        folder = None if model_name(folder) == DEFAULT_MODEL else folder
        self.settings.model_folder = "" if folder is None else model_name(folder) or str(folder)
        self.load_model(folder, 0 if controller is None else controller.seed)
