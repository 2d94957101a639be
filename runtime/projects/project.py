"""A project as plain data, and its one file: takes with what they were driven by, ground, character, model and style.

Saved and loaded again, sticks and states are the same bit by bit, so that a take is driven again as before. Frames are
kept within the bounds of `runtime.projects.motion`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import FileError, SportError
from runtime.projects.archive import REMEDY, ZIP_ERRORS, ArchiveReader, ArchiveWriter, Packed
from runtime.projects.character_files import Files, check_character_files
from runtime.projects.drives import DriveReader, DriveWriter, Json, read_ground, read_words_text
from runtime.projects.motion import BYTES, CLIP_BYTES, packed_frames, pieces, unpacked_frames
from runtime.safe_read import is_text, printable, reason
from runtime.skeleton import J
from runtime.takes.camera_keys import MAX_KEYS, CameraKey, read_key
from runtime.takes.clip import Clip, are_poses
from runtime.takes.drive import Drive
from runtime.takes.metadata import event_from, gait_seconds, origin_from
from runtime.takes.own_skeleton import OwnSkeleton
from runtime.takes.pose_edits import NO_EDITS, PoseEdits, read_edits
from runtime.terrain.height_map import Terrain

SUFFIX = ".sport"
FORMAT, VERSION = "sport-project", 3
MAX_TAKES = 10_000
MAX_FRAMES = 2_000_000  # of a take: nine hours
MAX_TEXT = 4096  # characters of a name
# what JSON of another shape raises where it is unpacked
STRUCTURE_ERRORS = (
    KeyError,
    TypeError,
    ValueError,
    IndexError,
    AttributeError,
    OverflowError,
    RecursionError,
)


@dataclass(frozen=True, eq=False)
class StoredVersion:
    """One version of a take: its frames, what drove it, where it was exported to, and the edit that made it.

    Of edited poses the driven ones are kept; they are bent again when the project is opened.
    """

    clip: Clip
    drive: Drive | None = None
    saved: str = ""
    label: str = ""
    base: Clip | None = None  # as it was driven, where `edits` bend the poses
    edits: PoseEdits = NO_EDITS


@dataclass(frozen=True, eq=False)
class StoredTake:
    """A take with the versions before and after the one that is shown; `name` where it was renamed."""

    shown: StoredVersion
    older: tuple[StoredVersion, ...] = ()
    newer: tuple[StoredVersion, ...] = ()
    recorded: bool = True
    name: str = ""
    camera: tuple[CameraKey, ...] = ()
    own: OwnSkeleton | None = None  # of a reference that another skeleton moved


@dataclass(frozen=True)
class StoredReference:
    """What a take is compared with: a take of the list, or the film `video` where that is named."""

    take: int = -1
    video: str = ""  # a path
    look: str = ""  # of the take: as the one that plays, or another word of the program's
    character: Files = field(default_factory=dict)  # its own
    numbers: Mapping[str, Any] = field(default_factory=dict)  # offset, place and the like


@dataclass(frozen=True)
class ModelName:
    """Which model moved the character; `folder` is "" for the shipped one."""

    folder: str = ""
    name: str = ""
    sha256: str = ""
    seed: int = 0


@dataclass
class Project:
    """Everything on the desk. `style` is what the program that saves keeps of its prompts, `view` flat values."""

    takes: tuple[StoredTake, ...] = ()
    counter: int = 0  # takes that were recorded, for the next name
    selected: int = -1
    ground: str = "flat"  # name or path
    terrain: Terrain | None = None
    character: Files = field(default_factory=dict)  # empty for the mannequin; the first one is the glTF
    model: ModelName = ModelName()
    style: Any = None
    place: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )  # x, z (metres) and yaw (radians) of the live character
    view: Mapping[str, Any] = field(default_factory=dict)  # camera and settings: text, numbers, truth values
    reference: StoredReference | None = None


class Notes:
    """How notes of styles go to JSON and back; this one leaves them out."""

    def pack(self, note: Any, archive: ArchiveWriter) -> Json:
        """JSON of a note, whose arrays go to `archive`."""
        return None

    def unpack(self, value: Json, archive: ArchiveReader) -> Any:
        """A note of JSON; a structural error or FileError where it is none."""
        return None


def save_project(
    project: Project, path: Path, notes: Notes | None = None, packed: Packed | None = None
) -> None:
    """Write a project whole or not at all, and only when it can be read again; FileError.

    `packed` keeps what its parts came to, so that the next time only what is new is packed.
    """
    notes, packed = notes or Notes(), packed or Packed()
    with packed.lock:
        archive = ArchiveWriter(packed)
        drives = DriveWriter(archive, lambda note: notes.pack(note, archive))
        document = _document(project, archive, drives, notes)
        archive.save(path, document, lambda written: check_project(written, notes))
        packed.forget_unused()


def _document(project: Project, archive: ArchiveWriter, drives: DriveWriter, notes: Notes) -> Json:
    check_character_files(project.character)
    number = None if project.terrain is None else drives.ground(project.terrain)
    model = project.model
    return {
        "format": FORMAT,
        "version": VERSION,
        "takes": [_take(take, archive, drives) for take in project.takes],
        "counter": project.counter,
        "selected": project.selected,
        "ground": {"name": _label(project.ground), "number": number},
        "character": {name: archive.data(content) for name, content in project.character.items()},
        "model": {
            "folder": _label(model.folder),
            "name": _label(model.name),
            "sha256": model.sha256,
            "seed": model.seed,
        },
        "style": None if project.style is None else notes.pack(project.style, archive),
        "place": list(project.place),
        "view": {
            key: _label(value) if isinstance(value, str) else value for key, value in project.view.items()
        },
        "reference": _reference(project.reference, archive),
        "grounds": drives.grounds,
        "changes": drives.changes,
    }


TakesReader = Callable[[Json, ArchiveReader, DriveReader], tuple[StoredTake, ...]]


def load_project(
    path: str | Path, notes: Notes | None = None, keep: Callable[[Sequence[Clip]], None] | None = None
) -> Project:
    """A project of a file that nobody vouches for; FileError in one sentence for damage and other versions.

    `keep` is given the clips of each take as soon as it is read, and may move their frames elsewhere: a long list is then
    at no time in memory as a whole.
    """

    def read_takes(value: Json, archive: ArchiveReader, drives: DriveReader) -> tuple[StoredTake, ...]:
        takes = []
        for take in value:
            takes.append(_read_take(take, archive, drives))
            if keep is not None:
                keep(list(_clips(takes[-1])))
                archive.forget("array", "frames")
        return tuple(takes)

    return _read(Path(path), notes or Notes(), read_takes)


def check_project(path: Path, notes: Notes) -> None:
    """Read a project as `load_project` does, FileError included, and hold one take of it at a time."""

    def one_by_one(value: Json, archive: ArchiveReader, drives: DriveReader) -> tuple[StoredTake, ...]:
        for take in value:
            _read_take(take, archive, drives)
            archive.forget()
        return ()

    _read(path, notes, one_by_one)


def _clips(take: StoredTake) -> Iterator[Clip]:
    """Those of every version, and what their edits begin with."""
    for version in (take.shown, *take.older, *take.newer):
        yield version.clip
        if version.base is not None:
            yield version.base


def _read(path: Path, notes: Notes, read_takes: TakesReader) -> Project:
    archive = ArchiveReader.open(path)
    document = archive.document
    if document.get("format") != FORMAT:
        raise FileError(f"{path}: not a project of this program.", REMEDY)
    if document.get("version") != VERSION:
        found = str(document.get("version"))[:20]
        raise FileError(
            f"{path}: a project of version {found}; this program reads version {VERSION}.",
            "Open it with the version that saved it.",
        )
    try:
        return _project(document, archive, notes, read_takes)
    except FileError:
        raise
    except SportError as error:
        raise FileError(f"{path}: damaged ({error.problem.rstrip('.')}).", REMEDY) from error
    except (*STRUCTURE_ERRORS, *ZIP_ERRORS) as error:
        raise FileError(f"{path}: damaged ({reason(error)}).", REMEDY) from error


def _project(value: Json, archive: ArchiveReader, notes: Notes, read_takes: TakesReader) -> Project:
    grounds = [read_ground(ground, archive) for ground in value["grounds"]]
    drives = DriveReader(archive, lambda note: notes.unpack(note, archive), grounds, value["changes"])
    if len(value["takes"]) > MAX_TAKES:
        raise ValueError(f"{len(value['takes'])} takes")
    character = {name: archive.data(number) for name, number in value["character"].items()}
    check_character_files(character)
    ground, model, style = value["ground"], value["model"], value["style"]
    x, z, yaw = (_number(part) for part in value["place"])
    return Project(
        takes=read_takes(value["takes"], archive, drives),
        counter=_count(value["counter"]),
        selected=min(_count(value["selected"] + 1) - 1, len(value["takes"]) - 1),
        ground=_text(ground["name"]),
        terrain=None if ground["number"] is None else drives.ground(ground["number"]),
        character=character,
        model=ModelName(
            _text(model["folder"]), _text(model["name"]), _text(model["sha256"]), _count(model["seed"])
        ),
        style=None if style is None else notes.unpack(style, archive),
        place=(x, z, yaw),
        view=_flat(value["view"]),
        reference=_read_reference(value.get("reference"), len(value["takes"]), archive),
    )


# --- a reference


def _reference(reference: StoredReference | None, archive: ArchiveWriter) -> Json:
    if reference is None:
        return None
    check_character_files(reference.character)
    files = {name: archive.data(content) for name, content in reference.character.items()}
    return {
        "take": reference.take,
        "video": _label(reference.video),
        "look": _label(reference.look),
        "character": files,
        "numbers": dict(reference.numbers),
    }


def _read_reference(value: Json, takes: int, archive: ArchiveReader) -> StoredReference | None:
    if value is None:
        return None
    character = {name: archive.data(number) for name, number in value["character"].items()}
    check_character_files(character)
    return StoredReference(
        take=min(_count(value["take"] + 1), takes) - 1,
        video=_text(value["video"]),
        look=_text(value["look"]),
        character=character,
        numbers={key: _number(entry) for key, entry in value["numbers"].items()},
    )


def _own(own: OwnSkeleton | None, archive: ArchiveWriter) -> Json:
    if own is None:
        return None
    middle, steps = archive.packed.once("own skeleton", own, own.packed)
    return {"parents": list(own.parents), "middle": archive.array(middle), "steps": archive.data(steps)}


def _read_own(value: Json, archive: ArchiveReader) -> OwnSkeleton | None:
    if value is None:
        return None
    parents, middle = tuple(value["parents"]), archive.array(value["middle"], "<f4", (None, 3))
    if not all(type(parent) is int for parent in parents):
        raise ValueError("parents")
    archive.budget.spend(10 * archive.size(value["steps"]))  # whole numbers and places while it unfolds
    return OwnSkeleton.unpacked(parents, middle, archive.data(value["steps"]))


# --- takes


def _take(take: StoredTake, archive: ArchiveWriter, drives: DriveWriter) -> Json:
    def packed(versions: tuple[StoredVersion, ...]) -> list[Json]:
        return [_version(version, archive, drives) for version in versions]

    return {
        "name": _label(take.name),
        "recorded": take.recorded,
        "camera": [list(astuple(key)) for key in take.camera],
        "own": _own(take.own, archive),
        "shown": packed((take.shown,))[0],
        "older": packed(take.older),
        "newer": packed(take.newer),
    }


def _version(version: StoredVersion, archive: ArchiveWriter, drives: DriveWriter) -> Json:
    clip = version.clip if version.base is None else version.base
    check_motion(clip)
    frames = archive.pieces("frames", clip, lambda: [_piece(clip, part) for part in pieces(len(clip))])
    return {
        "name": _label(clip.name),
        "fps": clip.fps,
        "terrain": _label(clip.terrain),
        "count": len(clip),
        "frames": frames,
        "gaits": clip.gaits is not None,
        "gait_seconds": [list(pair) for pair in clip.gait_seconds],
        "prompts": [vars(event) for event in clip.prompts],
        "origin": vars(clip.origin),
        "placed": None if clip.placed is None else list(clip.placed),
        "size": clip.size,
        "drive": None if version.drive is None else drives.drive(version.drive),
        "edits": version.edits.to_json() if version.edits else None,
        "saved": _label(version.saved),
        "label": _label(version.label),
    }


def _read_take(value: Json, archive: ArchiveReader, drives: DriveReader) -> StoredTake:
    def unpacked(versions: Json) -> tuple[StoredVersion, ...]:
        return tuple(_read_version(version, archive, drives) for version in versions)

    recorded = value["recorded"] is True
    (shown,) = unpacked([value["shown"]])
    if len(value["camera"]) > MAX_KEYS:
        raise ValueError(f"{len(value['camera'])} camera keys")
    camera = tuple(read_key(key) for key in value["camera"])
    return StoredTake(
        shown,
        unpacked(value["older"]),
        unpacked(value["newer"]),
        recorded,
        _text(value["name"]),
        camera,
        _read_own(value.get("own"), archive),
    )


def _read_version(value: Json, archive: ArchiveReader, drives: DriveReader) -> StoredVersion:
    fps, placed, count = _number(value["fps"]), value["placed"], _count(value["count"])
    hips, rotations, contacts, known = _frames(value["frames"], count, archive)
    gaits = known if value["gaits"] is True else None
    prompts = tuple(replace(event_from(e), words=read_words_text(e["words"])) for e in value["prompts"])
    clip = Clip(
        name=_text(value["name"]),
        fps=fps,
        hips_positions=hips,
        local_rotations=rotations,
        contacts=contacts,
        prompts=prompts,
        terrain=_text(value["terrain"]),
        origin=origin_from(value["origin"]),
        gait_seconds=_gait_seconds(value["gait_seconds"], gaits, fps),
        gaits=gaits,
        placed=None if placed is None else _four(placed),
        size=_number(value.get("size", 1.0)),
    )
    check_motion(clip, archive.path)
    drive = None if value["drive"] is None else drives.drive(value["drive"])
    if drive is not None and len(drive) != count:
        raise FileError(f"{archive.path}: a take of {count} frames that was driven for {len(drive)}.", REMEDY)
    edits = NO_EDITS if value["edits"] is None else read_edits(value["edits"])
    shown = edits.apply(clip)
    if edits:
        check_motion(shown, archive.path)
    base = clip if edits else None
    return StoredVersion(shown, drive, _text(value["saved"]), _text(value["label"]), base, edits)


def _piece(clip: Clip, part: slice) -> bytes:
    gaits = None if clip.gaits is None else clip.gaits[part]
    return packed_frames(clip.hips_positions[part], clip.local_rotations[part], clip.contacts[part], gaits)


def _frames(numbers: Json, count: int, archive: ArchiveReader) -> tuple[Any, ...]:
    """Arrays of a clip, which versions of the same frames share."""
    parts = list(pieces(count)) if count <= MAX_FRAMES else []
    if len(numbers) != len(parts) or not all(type(number) is int for number in numbers):
        raise ValueError(f"{len(numbers)} pieces of {count} frames")

    def made() -> tuple[Any, ...]:
        archive.budget.spend(CLIP_BYTES * count)
        hips, rotations = np.empty((count, 3), np.float32), np.empty((count, J, 4), np.float32)
        contacts, gaits = np.empty((count, 4), np.float32), np.empty(count, np.int8)
        for number, part in zip(numbers, parts, strict=True):
            size = part.stop - part.start
            if archive.size(number) != BYTES * size:
                raise ValueError("a piece of another length")
            hips[part], rotations[part], contacts[part], gaits[part] = unpacked_frames(
                archive.data(number), size
            )
        return hips, rotations, contacts, gaits

    return archive.once("frames", (count, *numbers), made)


def check_motion(clip: Clip, path: Path | str = "a take") -> None:
    """FileError unless every frame can be shown."""
    known = clip.gaits is None or bool(((clip.gaits >= -1) & (clip.gaits < 10)).all())
    if not known or not are_poses(clip.hips_positions, clip.local_rotations, clip.contacts):
        raise FileError(f"{path}: a take whose frames are no poses.", REMEDY)


def _gait_seconds(value: Json, gaits: Any, fps: float) -> tuple[tuple[str, float], ...]:
    if gaits is not None:
        return tuple(gait_seconds(gaits, fps).items())
    return tuple((_text(name), _number(seconds)) for name, seconds in value)


def _four(value: Json) -> tuple[float, ...]:
    yaw, x, y, z = (_number(part) for part in value)
    return yaw, x, y, z


# --- values


def _label(text: str) -> str:
    """Text as `_text` reads it."""
    return printable(text).replace("\0", "\ufffd")[:MAX_TEXT]


def _text(value: Json) -> str:
    if not is_text(value) or "\0" in value or len(value) > MAX_TEXT:
        raise ValueError("expected text")
    return value


def _number(value: Json) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= 1e9:
        raise ValueError(f"{str(value)[:20]}: expected a number")
    return float(value)


def _count(value: Json) -> int:
    if type(value) is not int or not 0 <= value < 1 << 62:
        raise ValueError(f"{str(value)[:20]}: expected a whole number")
    return value


def _flat(value: Json) -> dict[str, Any]:
    """Its entries that are texts, numbers or truth values."""
    return {
        key: entry
        for key, entry in value.items()
        if (is_text(entry) and len(entry) <= MAX_TEXT) or isinstance(entry, bool | int | float)
    }
