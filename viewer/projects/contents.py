"""What is on the desk as a project, and a project put on the desk."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.assets import model_folder, model_name
from runtime.projects.character_files import write_character_files
from runtime.projects.project import ModelName, Project, StoredTake, StoredVersion
from runtime.takes.metadata import origin_of
from viewer.projects.references import fingerprint_of, restore_reference, stored_reference
from viewer.prompt.prompting import Prompting
from viewer.prompt.style_edit import StyleEdit
from viewer.settings import CAMERAS, Settings, checked
from viewer.stage.stage import Stage
from viewer.takes.state import ClipItem, TakeVersion
from viewer.takes.takes import Takes

KEPT_SETTINGS = (
    "temperature",
    "response",
    "strength",
    "blend_seconds",
    "show_grid",
    "show_trajectory",
    "show_skeleton",
    "show_contacts",
)
MAX_PITCH = 1.5  # radians
DISTANCES = (0.5, 60.0)  # metres of the camera


@dataclass
class Contents:
    """The rooms that a project is made of."""

    takes: Takes
    stage: Stage
    prompting: Prompting
    settings: Settings
    load_model: Callable[[Path | None, int], None]
    cache: Path  # folder for the files of characters
    waiting: list[ClipItem]  # takes whose model is not there (yet)
    _controller: Any = None

    def gather(self) -> Project:
        """Everything that is kept, but for the files of the character; takes no time."""
        stage, takes = self.stage, self.takes.state
        pose, controller = stage.state.simulation.current, stage.state.controller
        style = self.prompting.state.edit
        x, _, z = (float(v) for v in pose.root_position)
        folder = stage.state.model_folder
        name = "" if folder is None else model_name(folder) or str(folder)
        model = origin_of(controller, "")
        return Project(
            takes=tuple(stored(item) for item in takes.items),
            counter=takes.counter,
            selected=takes.selected,
            ground=stage.state.terrain_spec,
            terrain=stage.state.terrain,
            model=ModelName(name, model.model, model.model_sha256, int(model.seed or 0)),
            style=None if style.a is None else style,
            place=(x, z, float(pose.root_yaw)),
            view=self._view(),
            reference=stored_reference(takes.items, self.takes.reference),
        )

    def _view(self) -> dict[str, Any]:
        camera = self.stage.camera
        now = camera.current
        view = {name: getattr(self.settings, name) for name in KEPT_SETTINGS}
        return view | {
            "camera": camera.mode,
            "yaw": float(now.yaw),
            "pitch": float(now.pitch),
            "distance": float(now.distance),
        }

    def fingerprint(self) -> tuple[Any, ...]:
        """Changes whenever something changes that is worth saving: not where one walks or looks."""
        stage, takes = self.stage, self.takes.state
        items = tuple(
            (id(i.clip), id(i.drive), i.saved, i.given, i.camera, len(i.older), len(i.newer))
            for i in takes.items
        )
        settings = tuple(getattr(self.settings, name) for name in KEPT_SETTINGS)
        style = self.prompting.state.edit
        scene = (stage.state.terrain_spec, id(stage.state.terrain), stage.character_path, stage.camera.mode)
        distance = round(float(stage.camera.current.distance), 1)
        reference = fingerprint_of(self.takes.reference)
        return items, settings, id(style), scene, distance, str(stage.state.model_folder), reference

    def restore(self, project: Project, kept: bool = True) -> None:
        """Put a project on the desk in the place of what is there; whether that is `kept` elsewhere."""
        takes, stage = self.takes, self.stage
        takes.clear(kept)
        self._view_of(project)
        items = [item_of(take) for take in project.takes]
        takes.state.items.extend(items)
        takes.state.counter = project.counter
        self.waiting[:] = [item for item in items if item.drive is not None]
        if project.terrain is not None:
            stage.show_ground(project.ground, project.terrain)
        if project.character:
            stage.load_character(write_character_files(project.character, self.cache))
        elif stage.character_path is not None:
            stage.load_character(None)
        stage.put_character(*project.place)
        same = self._load_model(project.model)
        if isinstance(project.style, StyleEdit):
            self.prompting.restore(project.style, again=not same)
        self._controller = None  # takes are given to the model that is there
        self.match_models()
        takes.select(project.selected)
        if project.reference is not None:
            restore_reference(project.reference, items, takes.reference, self.cache)

    def clear(self, kept: bool = True) -> None:
        """An empty desk on the same ground with the same character."""
        self.takes.clear(kept)
        self.takes.state.counter = 0
        self.waiting.clear()

    def _load_model(self, wanted: ModelName) -> bool:
        """Load the project's model where another one is there; whether none is needed."""
        now = origin_of(self.stage.state.controller, "")
        if self.stage.state.controller is None or now.model_sha256 == wanted.sha256:
            return True
        folder = model_folder(wanted.folder) if wanted.folder else None
        if folder is not None and not folder.is_dir():
            self.takes.messages.warn(
                f"The project's model {wanted.name or wanted.folder!r} is not there: its takes play and are exported,"
                " but are not driven again."
            )
        elif folder != self.stage.state.model_folder:
            self.load_model(folder, wanted.seed)
        return False

    def match_models(self) -> None:
        """Give takes that wait to the model that drove them when it is loaded; call once a frame."""
        controller = self.stage.state.controller
        if controller is self._controller or not self.waiting:
            return
        self._controller = controller
        if controller is None:
            return
        sha = origin_of(controller, "").model_sha256
        for item in [item for item in self.waiting if item.clip.origin.model_sha256 == sha]:
            item.maker = controller
            self.waiting.remove(item)

    def _view_of(self, project: Project) -> None:
        view, camera = project.view, self.stage.camera
        for name in KEPT_SETTINGS:
            value = checked(name, view.get(name), getattr(Settings(), name)) if name in view else None
            if value is not None:
                setattr(self.settings, name, value)
        if view.get("camera") in CAMERAS:
            camera.use(str(view["camera"]))
        for name, low, high in (
            ("yaw", -1e3, 1e3),
            ("pitch", -MAX_PITCH, MAX_PITCH),
            ("distance", *DISTANCES),
        ):
            value = view.get(name)
            if isinstance(value, int | float) and math.isfinite(value):
                setattr(camera.current, name, min(max(float(value), low), high))


def stored(item: ClipItem) -> StoredTake:
    """A take of the list as it is kept."""
    shown = StoredVersion(item.clip, item.drive, str(item.saved or ""), item.label, item.base, item.edits)
    older, newer = (tuple(_stored(v) for v in versions) for versions in (item.older, item.newer))
    return StoredTake(shown, older, newer, item.recorded, item.given, item.camera, item.own)


def _stored(version: TakeVersion) -> StoredVersion:
    return StoredVersion(
        version.clip, version.drive, str(version.saved or ""), version.label, version.base, version.edits
    )


def item_of(take: StoredTake) -> ClipItem:
    """A kept take for the list; its model is still to be found."""
    item = ClipItem(take.shown.clip, _existing(take.shown.saved), take.recorded, drive=take.shown.drive)
    item.label, item.given = take.shown.label, take.name
    item.base, item.edits, item.camera = take.shown.base, take.shown.edits, take.camera
    item.own = take.own
    item.older, item.newer = ([_version(v) for v in versions] for versions in (take.older, take.newer))
    return item


def _version(version: StoredVersion) -> TakeVersion:
    return TakeVersion(
        version.clip, version.drive, _existing(version.saved), version.label, version.base, version.edits
    )


def _existing(saved: str) -> Path | None:
    """Where a take was exported to, if that is still there."""
    try:
        return Path(saved) if saved and Path(saved).is_file() else None
    except (OSError, ValueError):
        return None
