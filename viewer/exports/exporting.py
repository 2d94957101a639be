"""Exports of the selected take in every format of the command: on a worker thread, with progress and cancellation."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.errors import SportError, UsageError
from runtime.formats.engines import ENGINES
from runtime.formats.options import ALL, BODIES, FILMS, SCENES, ExportOptions, option
from runtime.formats.table import FORMATS, ExportCancelled, Format, check_export, save_motion
from runtime.options import spec_of
from runtime.safe_read import expanded, parse_json, printable
from runtime.session.session import Take
from runtime.takes.camera_keys import view_at
from runtime.terrain.height_map import Terrain
from viewer.exports.bvh_export import BvhExport, ExportField
from viewer.filming.shots import KEYED
from viewer.gui.dialogs import DialogKind, Dialogs
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.scene.scene import Scene
from viewer.settings import under_home

PARTS = {"trim": "Between the trim handles", "shown": "As the timeline shows", "": "Whole take"}
GROUNDS = {"": "No ground", "inside": "Ground inside", ".obj": "OBJ file", ".glb": "GLB file"}


@dataclass(frozen=True)
class ExportForm(ExportOptions):
    """The options of the export window: those of an export (0 frames per second: as the take), and those of the window only."""

    fps: float = field(default=0.0, metadata=ExportOptions.__dataclass_fields__["fps"].metadata)
    suffix: str = option(".glb", ALL, label="Format", choices={f.suffix: f.name for f in FORMATS.values()})
    ground: str = option(
        "", SCENES | {".bvh"}, label="Ground", choices=GROUNDS,
        hint="As a second node of the file, or as a file of its own, in the same coordinates",
    )  # fmt: skip
    part: str = option(
        "trim", ALL, label="Range", choices=PARTS,
        hint="The frames between the trim handles of the timeline, those that it shows, or all",
    )  # fmt: skip
    own_character: bool = option(True, BODIES | FILMS, label="My character")

    @property
    def format(self) -> Format:
        return FORMATS[self.suffix]

    def chosen(self, fps: float) -> dict[str, Any]:
        """Return the values of the chosen format's options, for a take of `fps` frames per second."""
        bones = bool(self.engine and ENGINES[self.engine].bones)
        return {name: getattr(self, name) for name in self.format.options} | {
            "fps": self.fps or fps, "strides": self.strides if self.loop else 1,
            "humanoid_names": self.humanoid_names and bones, "with_ground": self.ground == "inside",
        }  # fmt: skip

    def has(self, name: str) -> bool:
        return self.suffix in spec_of(self, name).formats


def form_to_json(form: ExportForm) -> dict[str, Any]:
    """Return the options shown by the window, as plain values; see `form_from_json`."""
    return {name: getattr(form, name) for name in _shown()}


def form_from_json(value: Mapping[str, Any]) -> ExportForm:
    """Read the options from untrusted values; missing or invalid ones get their defaults."""
    usual = ExportForm()
    read = {name: spec_of(usual, name).read(value.get(name), getattr(usual, name)) for name in _shown()}
    return ExportForm(**read)


def _shown() -> list[str]:
    specs = {entry.name: spec_of(ExportForm, entry.name) for entry in fields(ExportForm)}
    return [name for name, spec in specs.items() if spec.label and spec.formats]


if TYPE_CHECKING:
    from runtime.takes.clip import Clip

SLOT = Slot("export", "one take by its window")


@dataclass
class Exporting(ExportField):
    scene: Scene
    messages: Messages
    jobs: Jobs
    dialogs: Dialogs
    bvh: BvhExport
    shown_frames: Callable[[int], tuple[int, int] | None]  # first and last, by take number
    shown: bool = False
    form: ExportForm = ExportForm()
    missing: str = ""  # a package that the format needs, and how to install it
    progress: tuple[int, int] = (0, 0)  # frames of film done, and in all
    report: str = ""  # result of the last export
    report_good: bool = True
    saved: Path | None = None  # its file
    _cancel: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        try:
            kept = parse_json(self.takes.settings.export_form or "{}")
        except ValueError:
            kept = {}
        self.form = form_from_json(kept if isinstance(kept, dict) else {})

    def choose(self, **values: Any) -> None:
        self.form = replace(self.form, **values)

    def remember(self) -> None:
        self.takes.settings.export_form = json.dumps(form_to_json(self.form))

    @property
    def suffix(self) -> str:
        return self.form.suffix

    @property
    def busy(self) -> bool:
        return self.jobs.busy(SLOT)

    def open(self) -> None:
        if self.takes.session.current is None:
            self.messages.warn(
                "Nothing to export yet: record a take with R, or keep the last seconds with T."
            )
            return
        self.shown = True
        if self.scene.camera.keyed and self.takes.session.current.cameras:
            self.choose(camera=KEYED)  # like the view
        self.propose()

    def close(self) -> None:
        self.shown = False

    def choose_format(self, suffix: str) -> None:
        """Change the format; a typed path gets the new ending."""
        self.missing = ""
        self.choose(suffix=suffix)
        try:
            FORMATS[suffix].check_program(Path(f"take{suffix}"))
        except UsageError as error:
            self.missing = str(error).partition(": ")[2]
        path = Path(self.path)
        if self.typed and path.name:  # "walk 1.5" has no ending
            stem = path.stem if path.suffix.lower() in FORMATS else path.name
            self.path = str(path.with_name(stem + suffix))
        else:
            self.propose()

    def browse(self) -> None:

        def chosen(path: Path) -> None:
            if path.suffix.lower() in FORMATS:
                self.choose(suffix=path.suffix.lower())
            self.path = printable(path)

        start, filters = expanded(self.path), (self.form.format.name, f"*{self.suffix}")
        self.dialogs.ask(DialogKind.SAVE, "Export the take", start, chosen, filters)

    # --- writing

    def export(self) -> None:
        take = self.takes.session.current
        if take is None or self.busy:
            return
        try:
            form, path = self.form, self.target()
            options = self._options(form, take, path)
            work, held = self._work(take, path, form, options), _held(take, form, options)
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

        self.report, self.progress, self.saved = "", (0, 0), None
        self._cancel.clear()
        self.jobs.submit(
            SLOT, named, lambda text: self._done(take, held, path, text), self._failed,
            writing=f"the export of {take.title}", cancel=self.cancel if form.format.film else None,
        )  # fmt: skip

    def cancel(self) -> None:
        """Cancel the export in progress; no file is kept."""
        self._cancel.set()

    def _check(self) -> None:
        if self._cancel.is_set():
            raise ExportCancelled("The export was cancelled.")

    def _work(self, take: Take, path: Path, form: ExportForm, options: ExportOptions) -> Callable[[], str]:
        """Return the worker's function with everything it needs; UsageError for incompatible options."""
        ground = self._ground_of(take)
        if form.format.film:
            film = self._film_options(form, take, options.start_s)
            return lambda: self._film(_named_clip(take), ground(), path, options, film)
        check_export(path, options)
        return lambda: " ".join(save_motion(_named_clip(take), path, options, ground(), self._check))

    def _options(self, form: ExportForm, take: Take, path: Path) -> ExportOptions:
        """Return the options of the form's format for exporting a take to a path."""
        fps = take.made.header.fps
        own = self.scene.character_path if form.own_character else None
        chosen = form.chosen(fps) | {
            "character": own,
            "character_unit": (own and self.takes.session.character.unit) or None,
            "fit_to_motion": self.scene.settings.fit_to_motion,
        }
        options = ExportOptions(**{name: value for name, value in chosen.items() if form.has(name)})
        first, last = self.range_of(take)
        if (first, last) != (0, take.frames - 1):
            options = replace(options, start_s=first / fps, end_s=last / fps)
        if form.has("ground") and form.ground.startswith("."):
            options = replace(options, ground_out=path.with_name(f"{path.stem}-ground{form.ground}"))
        options.check()
        return options

    def range_of(self, take: Take) -> tuple[int, int]:
        """Return the first and last frame of a take to export."""
        last = take.frames - 1
        if self.form.part == "shown":
            first, end = self.shown_frames(take.number) or (0, last)
            return max(first, 0), min(end, last)
        return take.range if self.form.part else (0, last)

    def _film_options(self, form: ExportForm, take: Take, start_s: float) -> Any:
        """Return the options of a film that begins at a time of a take."""
        from viewer.filming.film import FilmOptions
        from viewer.filming.shots import Shot

        camera = self.scene.camera.current
        width, height = (int(side) for side in form.size.split("x"))
        keys = tuple(replace(k, seconds=k.seconds - start_s) for k in take.cameras if k.seconds > start_s)
        if len(keys) < len(take.cameras):
            keys = replace(view_at(take.cameras, start_s), seconds=0.0), *keys
        if form.camera == KEYED and not keys:
            raise UsageError(
                "Camera: this take has no keys.", "Key views by “+ Pin” on its timeline, or choose another."
            )
        options = FilmOptions(
            width, height, form.film_fps, form.camera, form.distance, form.captions, form.quality,
            Shot(camera.yaw, camera.pitch, camera.distance, fixed=True), form.fov_degrees, keys,
        )  # fmt: skip
        options.check()
        return options

    def _ground_of(self, take: Take) -> Callable[[], Terrain]:
        """Return a function that finds the ground on which a take was made."""
        spec, scene, shown = take.made.header.terrain, self.scene, self.scene.terrain
        is_shown = spec == scene.terrain_spec or not take.recorded

        def found() -> Terrain:
            inputs = None if take.mirrored else take.made.inputs
            driven = None if inputs is None else inputs.ground(0)
            if driven is not None:
                return driven.terrain
            if take.ground is not None:
                return take.ground.terrain
            return shown if is_shown else scene.read_ground(spec)

        return found

    def _film(self, clip: Clip, terrain: Terrain, path: Path, export: ExportOptions, film: Any) -> str:
        """Make a film on the worker; return a sentence about it, "" if cancelled."""
        from runtime.formats.prepare import on_its_ground, prepare
        from viewer.filming.film import film_in_process, film_of_take

        def progress(done: int, total: int) -> None:
            self.progress = (done, total)
            self.jobs.progress[SLOT] = f"{done} of {total} frames"

        take = prepare(on_its_ground(clip), replace(export, fps=clip.fps), terrain)
        make = film_of_take if self.jobs.blocking else film_in_process
        return make(take, terrain, path, export, film, progress, self._cancel)

    # --- results

    def _done(self, take: Take, held: Take | None, path: Path, text: str) -> None:
        if not text:
            self.report, self.report_good = "Cancelled: nothing was written.", True
            self.messages.note(f"The export of {take.title} was cancelled.")
            return
        self.bvh.note_file(path, take.number, held)
        self.takes.settings.export_folder = under_home(path.parent)
        self.report, self.report_good = f"Saved {printable(text)}", True
        self.saved = path
        self.messages.note(f"Saved {text}", path)
        self.propose()

    def _failed(self, error: Exception) -> None:
        self.report, self.report_good = printable(error), False


def _held(take: Take, form: ExportForm, options: ExportOptions) -> Take | None:
    """Return the unchanged take that a BVH of this form contains; None for any other file."""
    changes = replace(
        options, fps=ExportOptions.fps, unit="cm", euler_order=None, ground_out=None, start_s=0.0, end_s=None
    )
    whole = form.suffix == ".bvh" and form.part != "shown" and options.fps >= take.made.header.fps
    if not whole or changes != ExportOptions():
        return None
    return take if form.part else replace(take, trim=None)


def _named_clip(take: Take) -> Clip:
    return replace(take.clip, name=take.title)


def _named(error: SportError) -> SportError:
    """Return the error with the option's name in the window."""
    if not isinstance(error, UsageError) or not error.parameter:
        return error
    known = error.parameter in ExportOptions.__dataclass_fields__
    name = (known and spec_of(ExportOptions, error.parameter).label) or error.parameter.replace(
        "_", " "
    ).capitalize()
    return UsageError(name + error.problem.removeprefix(error.parameter), error.remedy)
