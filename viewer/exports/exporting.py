"""Exports of the selected take in every form that the command writes: on a worker thread, with progress and an end."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.errors import SportError, UsageError
from runtime.formats.engines import ENGINES
from runtime.formats.options import ExportOptions
from runtime.formats.table import FORMATS, ExportCancelled, check_export, save_motion
from runtime.options import spec_of
from runtime.safe_read import printable
from runtime.terrain.height_map import Terrain
from viewer.exports.state import ExportForm, ExportState
from viewer.gui.dialogs import DialogKind, Dialogs
from viewer.jobs import Jobs
from viewer.messages import Messages
from viewer.stage.stage import Stage
from viewer.takes.state import ClipItem
from viewer.takes.takes import Takes, file_stem, free_path

if TYPE_CHECKING:
    from runtime.takes.clip import Clip

SLOT = "export of a take"


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
        typed, self.state.missing = self.state.path != self._proposed, ""
        self.state.choose(suffix=suffix)
        try:
            FORMATS[suffix].check_program(Path(f"take{suffix}"))
        except UsageError as error:
            self.state.missing = str(error).partition(": ")[2]
        if typed:
            self.state.path = str(Path(self.state.path).with_suffix(suffix))
        else:
            self.propose()

    def browse(self) -> None:
        """Choose where to write by a dialog."""

        def chosen(path: Path) -> None:
            if path.suffix.lower() in FORMATS:
                self.state.choose(suffix=path.suffix.lower())
            self.state.path = printable(path)

        suffix = self.state.form.suffix
        start = Path(self.state.path).expanduser()
        self.dialogs.ask(
            DialogKind.SAVE, "Export the take", start, chosen, (FORMATS[suffix].name, f"*{suffix}")
        )

    # --- writing

    def export(self) -> None:
        """Write the selected take as chosen."""
        item = self.takes.state.current
        if item is None or self.busy:
            return
        try:
            path, form, clip = self._path(), self.state.form, item.clip
            options = self._options(form, clip, path)
            work, whole = self._work(item, path, form, options), _is_whole(clip, form, options)
        except SportError as error:
            self.messages.error(_named(error))
            self._failed(_named(error))
            return

        def named() -> str:
            try:
                return work()
            except ExportCancelled:
                return ""
            except UsageError as error:
                raise _named(error) from error

        self.state.report, self.state.progress, self.state.writing = "", (0, 0), path.name
        self._cancel.clear()
        self.jobs.submit(
            SLOT,
            named,
            lambda text: self._done(item, clip, path, text, whole),
            self._failed,
            writing=f"the export of {item.name}",
            cancel=self.cancel,
        )

    def cancel(self) -> None:
        """Give up the file that is being written; nothing of it stays."""
        self._cancel.set()

    def _check(self) -> None:
        """Called on the worker: ends an export that was cancelled."""
        if self._cancel.is_set():
            raise ExportCancelled("The export was cancelled.")

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

    def _work(
        self, item: ClipItem, path: Path, form: ExportForm, options: ExportOptions
    ) -> Callable[[], str]:
        """What the worker does, with everything it needs; UsageError for options that do not go together."""
        clip, ground = item.named_clip, self._ground_of(item)
        if form.format.film:
            film = self._film_options(form, item, options.start_s)
            return lambda: self._film(clip, ground(), path, options, film)
        check_export(path, options)
        return lambda: " ".join(save_motion(clip, path, options, ground(), self._check))

    def _options(self, form: ExportForm, clip: Clip, path: Path) -> ExportOptions:
        """The options of the form that its format has, for a take that goes to a path."""
        playback, current = self.takes.state.playback, self.takes.state.current
        marked = playback is not None and current is not None and playback.clip is current.clip
        chosen: dict[str, Any] = {name: getattr(form, name) for name in form.format.options} | {
            "fps": form.fps or clip.fps,
            "strides": form.strides if form.loop else 1,
            "humanoid_names": form.humanoid_names and bool(form.engine and ENGINES[form.engine].bones),
            "with_ground": form.ground == "inside",
            "character": self.stage.character_path if form.own_character else None,
            "fit_to_motion": self.stage.settings.fit_to_motion,
        }
        chosen = {name: value for name, value in chosen.items() if form.has(name)}
        if form.trimmed and marked and playback is not None and playback.trimmed:
            chosen |= {"start_s": playback.start_s, "end_s": playback.end_s}
        if form.has("ground") and form.ground.startswith("."):
            chosen["ground_out"] = path.with_name(f"{path.stem}-ground{form.ground}")
        options = ExportOptions(**chosen)
        options.check()
        return options

    def _film_options(self, form: ExportForm, item: ClipItem, start_s: float) -> Any:
        """The options of a film that begins at a time of a take."""
        from viewer.filming.film import FilmOptions
        from viewer.filming.shots import KEYED, ShotView

        camera = self.stage.camera.current
        width, height = (int(side) for side in form.size.split("x"))
        keys = tuple(replace(key, seconds=max(key.seconds - start_s, 0.0)) for key in item.camera)
        if form.camera == KEYED and not keys:
            raise UsageError(
                "Camera: this take has no keys.", "Key views by “+ Pin” on its timeline, or choose another."
            )
        options = FilmOptions(
            width, height, form.film_fps, form.camera, form.distance, form.captions, form.quality,
            ShotView(camera.yaw, camera.pitch, camera.distance), form.fov_degrees, keys,
        )  # fmt: skip
        options.check()
        return options

    def _ground_of(self, item: ClipItem) -> Callable[[], Terrain]:
        """What finds the ground that a take was made on."""
        driven = item.drive.ground(0) if item.drive is not None else None
        own = item.ground if driven is None else driven.terrain
        if own is not None:
            return lambda: own
        if item.clip.terrain == self.stage.state.terrain_spec or not item.recorded:
            shown = self.stage.state.terrain
            return lambda: shown
        settings, load, spec = self.stage.settings, self.stage.services.load_terrain, item.clip.terrain
        return lambda: load(spec, settings.height_map_cell_m, settings.height_map_height_m)

    def _film(self, clip: Clip, terrain: Terrain, path: Path, export: ExportOptions, film: Any) -> str:
        """Make a film on the worker; "" when it was given up."""
        from runtime.formats.prepare import on_its_ground, prepare
        from viewer.filming.beside import film_beside
        from viewer.filming.film import film_of_take

        def progress(done: int, total: int) -> None:
            self.state.progress = (done, total)

        take = prepare(on_its_ground(clip), replace(export, fps=clip.fps), terrain)
        make = film_of_take if self.jobs.blocking else film_beside
        return make(take, terrain, path, export, film, progress, self._cancel)

    # --- what becomes of it

    def _done(self, item: ClipItem, clip: Clip, path: Path, text: str, whole: bool) -> None:
        if not text:
            self.state.report, self.state.report_good = "Cancelled: nothing was written.", True
            self.messages.note(f"The export of {item.name} was cancelled.")
            return
        self.takes.note_file(item, clip, path, whole)
        self.takes.settings.export_folder = str(path.parent)
        self.state.report, self.state.report_good = f"Saved {printable(text)}", True
        self.messages.note(f"Saved {text}")
        self.propose()

    def _failed(self, error: Exception) -> None:
        self.state.report, self.state.report_good = printable(error), False


def _is_whole(clip: Clip, form: ExportForm, options: ExportOptions) -> bool:
    """Whether a BVH holds every frame as it is, so that the take can be opened again."""
    changes = replace(options, fps=ExportOptions.fps, unit="cm", euler_order=None, ground_out=None)
    return form.suffix == ".bvh" and changes == ExportOptions() and options.fps >= clip.fps


def _named(error: SportError) -> SportError:
    """The same mistake by the names of the window."""
    if not isinstance(error, UsageError) or not error.parameter:
        return error
    known = error.parameter in ExportOptions.__dataclass_fields__
    name = (known and spec_of(ExportOptions, error.parameter).label) or error.parameter.replace(
        "_", " "
    ).capitalize()
    return UsageError(name + error.problem.removeprefix(error.parameter), error.remedy)
