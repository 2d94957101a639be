"""Exports of the selected take in every form that the command writes: on a worker thread, with progress and an end."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.errors import SportError, UsageError
from runtime.safe_read import printable
from runtime.takes.options import ExportOptions
from runtime.terrain.height_map import Terrain
from viewer.exports.state import FORMATS, SIZES, ExportForm, ExportState
from viewer.gui.dialogs import Dialogs, Kind
from viewer.jobs import Jobs
from viewer.messages import Messages
from viewer.stage.stage import Stage
from viewer.takes.state import ClipItem
from viewer.takes.takes import Takes, file_stem, free_path

if TYPE_CHECKING:
    from runtime.takes.clip import Clip

SLOT = "export of a take"
# options by the names of the window
NAMES = {
    "fps": "Frames a second",
    "unit": "Unit",
    "start_s": "Range",
    "in_place": "In place",
    "ground_root": "Root on the ground",
    "at_origin": "At the origin",
    "rest_frame": "Rest pose first",
    "ground": "Ground",
    "size": "Size",
    "distance": "Distance",
    "camera": "Camera",
}


@dataclass
class Exporting:
    """Actions of the export window."""

    state: ExportState
    takes: Takes
    stage: Stage
    messages: Messages
    jobs: Jobs
    dialogs: Dialogs
    _cancel: threading.Event = field(default_factory=threading.Event)
    _proposed: str = ""

    @property
    def busy(self) -> bool:
        """Whether a take is being written."""
        return self.jobs.busy(SLOT)

    def open(self) -> None:
        """Show the window for the selected take."""
        if self.takes.state.current is None:
            self.messages.warn(
                "Nothing to export yet: record a take with R, or keep the last seconds with T."
            )
            return
        self.state.open = True
        self.propose()

    def propose(self) -> None:
        """Put a free name with the ending of the chosen format into the field."""
        item = self.takes.state.current
        if item is None:
            return
        folder = Path(self.takes.settings.export_folder)
        name = free_path(folder.expanduser() / f"{file_stem(item.name)}{self.state.form.suffix}").name
        self.state.path = self._proposed = printable(folder / name)

    def choose_format(self, suffix: str) -> None:
        """Write another format; a path that was typed keeps its name."""
        typed = self.state.path != self._proposed
        self.state.form.suffix = suffix
        if typed:
            self.state.path = str(Path(self.state.path).with_suffix(suffix))
        else:
            self.propose()

    def browse(self) -> None:
        """Choose where to write by a dialog."""

        def chosen(path: Path) -> None:
            if path.suffix.lower() in FORMATS:
                self.state.form.suffix = path.suffix.lower()
            self.state.path = printable(path)

        suffix = self.state.form.suffix
        start = Path(self.state.path).expanduser()
        self.dialogs.ask(Kind.SAVE, "Export the take", start, chosen, (FORMATS[suffix], f"*{suffix}"))

    # --- writing

    def export(self) -> None:
        """Write the selected take as chosen."""
        item = self.takes.state.current
        if item is None or self.busy:
            return
        try:
            path = self._path()
            work = self._work(item, path, self.state.form)
        except SportError as error:
            self.messages.error(_named(error))
            self._failed(_named(error))
            return

        def named() -> str:
            try:
                return work()
            except UsageError as error:
                raise _named(error) from error

        self.state.report, self.state.progress = "", (0, 0)
        self._cancel.clear()
        self.jobs.submit(SLOT, named, lambda text: self._done(item, path, text), self._failed)

    def cancel(self) -> None:
        """Give up the film that is being made; nothing of it stays."""
        self._cancel.set()

    def _path(self) -> Path:
        form = self.state.form
        if self.state.path == self._proposed:
            self.propose()  # another program may have taken the name since
        text = self.state.path.strip().strip('"')
        if not text or "\0" in text:
            raise UsageError("Export: the path is empty.", "Write a path such as ~/sport-clips/walk.glb.")
        path = Path(text).expanduser()
        if path.is_dir():
            raise UsageError(f"Export: {path} is a folder.", "Add the name of a file.")
        return path if path.suffix.lower() == form.suffix else path.with_name(path.name + form.suffix)

    def _work(self, item: ClipItem, path: Path, form: ExportForm) -> Callable[[], str]:
        """What the worker does, with everything it needs; UsageError for options that do not go together."""
        from runtime.takes.export import check_export

        clip, options = item.named_clip, self._options(form)
        beside = path.with_name(f"{path.stem}-ground{form.ground}") if form.ground.startswith(".") else None
        if not form.film:
            check_export(path, options, beside)
        ground = self._ground_of(item)
        if form.film:
            film = self._film_options(form)
            return lambda: self._film(clip, ground(), path, options, film)
        return lambda: self._motion(clip, path, options, ground(), beside)

    def _options(self, form: ExportForm) -> ExportOptions:
        playback, start, end = self.takes.state.playback, 0.0, None
        current = self.takes.state.current
        marked = playback is not None and current is not None and playback.clip is current.clip
        if form.trimmed and marked and playback is not None and playback.trimmed:
            start, end = playback.start_s, playback.end_s
        motion = not form.film
        options = ExportOptions(
            fps=float(form.fps),
            unit=form.unit,
            in_place=form.in_place and motion,
            ground_root=form.ground_root and motion,
            at_origin=form.at_origin and motion,
            rest_frame=form.rest_frame and motion,
            loop=form.loop and form.suffix != ".obj",
            start_s=start,
            end_s=end,
            with_ground=form.ground == "inside" and form.suffix in (".glb", ".fbx"),
            character=self.stage.character_path if form.own_character else None,
        )
        options.check()
        return options

    def _film_options(self, form: ExportForm) -> Any:
        from viewer.filming.film import FilmOptions

        width, height = SIZES[form.size]
        options = FilmOptions(
            width, height, float(form.film_fps), form.camera, form.distance, form.captions, form.quality
        )
        options.check()
        return options

    def _ground_of(self, item: ClipItem) -> Callable[[], Terrain]:
        """What finds the ground that a take was made on."""
        driven = item.drive.ground(0) if item.drive is not None else None
        if driven is not None:
            return lambda: driven.terrain
        if item.clip.terrain == self.stage.state.terrain_spec or not item.recorded:
            shown = self.stage.state.terrain
            return lambda: shown
        settings, load, spec = self.stage.settings, self.stage.services.load_terrain, item.clip.terrain
        return lambda: load(spec, settings.height_map_cell_m, settings.height_map_height_m)

    def _motion(
        self, clip: Clip, path: Path, options: ExportOptions, terrain: Terrain, beside: Path | None
    ) -> str:
        from runtime.takes.export import save_motion

        return " ".join(w.text for w in save_motion(clip, path, options, terrain, beside))

    def _film(self, clip: Clip, terrain: Terrain, path: Path, export: ExportOptions, film: Any) -> str:
        """Make a film on the worker; "" when it was given up."""
        from dataclasses import replace

        from runtime.character.character import load_character
        from runtime.takes.prepare import on_its_ground, prepare
        from viewer.filming.film import make_film

        take = prepare(on_its_ground(clip), replace(export, fps=clip.fps), terrain)
        character = None if export.character is None else load_character(export.character)

        def progress(done: int, total: int) -> None:
            self.state.progress = (done, total)

        done = make_film(
            take.clip, terrain, path, film, character=character, progress=progress, cancel=self._cancel
        )
        if done.cancelled:
            return ""
        text = f"{path}: {done.frames} frames at {film.fps:g} fps, {done.seconds:.1f} s"
        return text if take.loop is None else f"{text}; {take.loop.describe()}"

    # --- what becomes of it

    def _done(self, item: ClipItem, path: Path, text: str) -> None:
        if not text:
            self.state.report, self.state.report_good = "Cancelled: nothing was written.", True
            self.messages.note(f"The export of {item.name} was cancelled.")
            return
        if self.state.form.suffix in (".bvh", ".glb", ".fbx"):
            item.saved = path
            item.drop_journal()
        self.takes.settings.export_folder = str(path.parent)
        self.state.report, self.state.report_good = f"Saved {printable(text)}", True
        self.messages.note(f"Saved {text}")
        self.propose()

    def _failed(self, error: Exception) -> None:
        self.state.report, self.state.report_good = printable(error), False


def _named(error: SportError) -> SportError:
    """The same mistake by the names of the window."""
    if not isinstance(error, UsageError) or not error.parameter:
        return error
    name = NAMES.get(error.parameter, error.parameter.replace("_", " ").capitalize())
    return UsageError(name + error.problem.removeprefix(error.parameter), error.remedy)
