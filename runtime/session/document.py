"""A session as text: JSON that refers to contents by their hashes, and the same from a file that is not trusted."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import astuple, dataclass, field, fields, replace
from functools import partial
from typing import Any

from runtime.character.shape import BodyShape
from runtime.checked import read_number, read_text, read_whole
from runtime.controls import Gait
from runtime.errors import FileError, SportError
from runtime.motion.control_scripts import MAX_POINTS, Waypoint
from runtime.safe_read import is_text, parse_json, printable, reason
from runtime.session.blobs import REMEDY, BlobReader, BlobWriter, Once
from runtime.session.character_files import safe_name
from runtime.session.inputs import InputReader, InputWriter, read_words_text
from runtime.session.motion import Motion, MotionHeader
from runtime.session.session import (
    CharacterChoice,
    Ground,
    ModelName,
    Reference,
    Session,
    Take,
    Variant,
)
from runtime.takes.camera_keys import MAX_KEYS, read_key
from runtime.takes.clip import MAX_FPS, MAX_SIZE, MIN_SIZE
from runtime.takes.metadata import event_from, origin_from
from runtime.takes.own_skeleton import OwnSkeleton
from runtime.takes.pose_edits import NO_EDITS, read_edits

MAX_TAKES, MAX_VARIANTS = 10_000, 9
MAX_FRAMES = 2_000_000  # of a take: nine hours
MAX_TEXT = 4096  # characters of a name
_text = partial(read_text, longest=MAX_TEXT)
MAX_ITEMS = 400_000  # values of one text
TAKE_BYTES = 20_000  # of a take in memory without its frames, about
Json = Any
# what JSON of another shape raises where it is unpacked
STRUCTURE_ERRORS = (
    KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError, MemoryError,
)  # fmt: skip


# --- writing


@dataclass
class DocumentWriter:
    """Packs sessions; what did not change since the last one is not packed again."""

    put: Callable[[str, bytes], None]
    _once: Once = field(default_factory=Once)

    def session(self, session: Session) -> str:
        """The text of a session. The contents that it refers to are put first."""
        blobs = BlobWriter(self.put)
        return json.dumps(_session(session, InputWriter(blobs, self._once)), ensure_ascii=True)

    def packer(self) -> InputWriter:
        """What packs the input of a motion."""
        return InputWriter(BlobWriter(self.put), self._once)


def _session(session: Session, packer: InputWriter) -> Json:
    once, blobs = packer.once, packer.blobs
    reference = session.reference
    return {
        "takes": [
            once.get("take", take, lambda t=take: blobs.text(json.dumps(_take(t, packer))))  # type: ignore[misc]
            for take in session.takes
        ],
        "live": _take(session.live, packer),
        "ground": _ground(session.ground, packer),
        "character": _character(session.character),
        "model": {name: _label(v) if isinstance(v, str) else v for name, v in vars(session.model).items()},
        "reference": None
        if reference is None
        else vars(reference)
        | {
            "video": _label(reference.video),
            "character": None if reference.character is None else _character(reference.character),
        },
        "variants": [[v.number, packer.prompt(v.prompt), v.seed] for v in session.variants],
        "counter": session.counter,
        "selected": session.selected,
    }


def _take(take: Take, packer: InputWriter) -> Json:
    return {
        "number": take.number,
        "motion": None if take.motion is None else take.motion.key,
        "name": _label(take.name),
        "trim": take.trim and list(take.trim),
        "poses": take.poses.to_json() if take.poses else None,
        "cameras": [list(astuple(key)) for key in take.cameras],
        "path": [[p.x, p.z, p.speed, int(p.gait)] for p in take.path],
        "prompt": packer.prompt(take.prompt) if take.prompt.a is not None else None,
        "mirrored": take.mirrored,
        "color": take.color,
        "recorded": take.recorded,
        "ground": _ground(take.ground, packer),
        "own": _own(take.own, packer),
    }


def _ground(ground: Ground | None, packer: InputWriter) -> Json:
    return None if ground is None else [_label(ground.spec), packer.ground(ground.terrain)]


def _character(choice: CharacterChoice) -> Json:
    return {"shape": vars(choice.shape), "path": _label(choice.path), "key": choice.key}


def _own(own: OwnSkeleton | None, packer: InputWriter) -> Json:
    if own is None:
        return None

    def packed() -> Json:
        middle, steps = own.packed()
        return [list(own.parents), packer.blobs.array(middle), packer.blobs.data(steps)]

    return packer.once.get("own skeleton", own, packed)


def header_text(header: MotionHeader, recording: bool = False) -> str:
    """A motion's header as JSON; `recording`: it is not finished."""
    value = {
        "name": _label(header.name),
        "fps": header.fps,
        "frames": header.frames,
        "terrain": _label(header.terrain),
        "prompts": [vars(event) for event in header.prompts],
        "origin": vars(header.origin),
        "gait_seconds": [list(pair) for pair in header.gait_seconds],
        "placed": None if header.placed is None else list(header.placed),
        "size": header.size,
        "has_gaits": header.has_gaits,
        "resimulable": header.resimulable,
        "recording": recording,
    }
    return json.dumps(value, ensure_ascii=True)


# --- reading


@dataclass
class DocumentReader:
    """Unpacks what a `DocumentWriter` packed. `motion` finds one by its key; FileError for what is no session."""

    blobs: BlobReader
    motion: Callable[[str], Motion]

    def session(self, text: str) -> Session:
        """A session of its text."""
        return self.checked(lambda: self._session(parse_json(text, MAX_ITEMS)))

    def header(self, text: str) -> tuple[MotionHeader, bool]:
        """A motion's header, and whether its recording was cut off."""
        return self.checked(lambda: _read_header(parse_json(text, MAX_ITEMS)))

    def checked(self, read: Callable[[], Any]) -> Any:
        path = self.blobs.path
        try:
            return read()
        except FileError:
            raise
        except SportError as error:
            raise FileError(f"{path}: damaged ({error.problem.rstrip('.')}).", REMEDY) from error
        except STRUCTURE_ERRORS as error:
            raise FileError(f"{path}: damaged ({reason(error)}).", REMEDY) from error

    def _session(self, value: Json) -> Session:
        if len(value["takes"]) > MAX_TAKES or len(value["variants"]) > MAX_VARIANTS:
            raise ValueError(f"{len(value['takes'])} takes")
        packer = InputReader(self.blobs)
        takes = tuple(map(self._take_of, value["takes"]))
        numbers = [take.number for take in takes]
        if len(set(numbers)) < len(numbers) or any(take.motion is None for take in takes) or 0 in numbers:
            raise ValueError("takes without numbers of their own")
        counter, selected = read_whole(value["counter"]), read_whole(value["selected"])
        model = value["model"]
        return Session(
            takes=takes,
            live=self._take(value["live"]),
            ground=self._ground(value["ground"]),
            character=_read_character(value["character"]),
            model=ModelName(
                _text(model["folder"]),
                _text(model["name"]),
                _text(model["sha256"]),
                read_whole(model["seed"]),
            ),
            reference=None if value["reference"] is None else _read_reference(value["reference"]),
            variants=tuple(
                Variant(read_whole(number), packer.prompt(prompt), read_whole(seed))
                for number, prompt, seed in value["variants"]
            ),
            counter=max(counter, *numbers, 0),
            selected=selected if selected in numbers else 0,
        )

    def _take_of(self, reference: Json) -> Take:
        def made() -> Take:
            self.blobs.budget.spend(TAKE_BYTES)
            return self._take(parse_json(self.blobs.text(reference), MAX_ITEMS))

        return self.blobs.once("take", reference, made)

    def _take(self, value: Json) -> Take:
        if len(value["cameras"]) > MAX_KEYS or len(value["path"]) > MAX_POINTS:
            raise ValueError(f"{len(value['cameras'])} camera keys")
        trim = value["trim"]
        if trim is not None:
            first, last = trim
            trim = read_whole(first), read_whole(last)
            if trim[0] >= trim[1]:
                raise ValueError("a trim that keeps nothing")
        prompt = value["prompt"]
        return Take(
            number=read_whole(value["number"]),
            motion=None if value["motion"] is None else self.motion(_text(value["motion"])),
            name=_text(value["name"]),
            trim=trim,
            poses=NO_EDITS if value["poses"] is None else read_edits(value["poses"]),
            cameras=tuple(read_key(key) for key in value["cameras"]),
            path=tuple(
                Waypoint(read_number(x), read_number(z), read_number(speed), Gait(gait))
                for x, z, speed, gait in value["path"]
            ),
            **({} if prompt is None else {"prompt": InputReader(self.blobs).prompt(prompt)}),
            mirrored=value["mirrored"] is True,
            color=read_whole(value["color"]),
            recorded=value["recorded"] is True,
            ground=self._ground(value["ground"]),
            own=self._own(value["own"]),
        )

    def _ground(self, value: Json) -> Ground | None:
        if value is None:
            return None
        spec, terrain = value
        made = InputReader(self.blobs).ground(terrain)
        return self.blobs.once("ground of", (id(made), spec), lambda: Ground.of(_text(spec), made))

    def _own(self, value: Json) -> OwnSkeleton | None:
        if value is None:
            return None
        parents, middle, steps = value
        if not all(type(parent) is int for parent in parents):
            raise ValueError("parents")

        def made() -> OwnSkeleton:
            self.blobs.budget.spend(10 * self.blobs.size(steps))  # whole numbers and places while it unfolds
            points = self.blobs.array(middle, "<f4", (None, 3))
            return OwnSkeleton.unpacked(tuple(parents), points, self.blobs.data(steps))

        return self.blobs.once("own skeleton", (steps, tuple(parents)), made)


def _read_header(value: Json) -> tuple[MotionHeader, bool]:
    fps, frames, placed, size = (
        read_number(value["fps"]),
        read_whole(value["frames"]),
        value["placed"],
        read_number(value["size"]),
    )
    if not 0.0 < fps <= MAX_FPS or frames > MAX_FRAMES or not MIN_SIZE <= size <= MAX_SIZE:
        raise ValueError(f"a motion of {frames} frames at {fps:g}")
    prompts = tuple(
        replace(event_from(event), words=read_words_text(event["words"])) for event in value["prompts"]
    )
    if placed is not None:
        yaw, x, y, z = (read_number(part) for part in placed)
        placed = yaw, x, y, z
    header = MotionHeader(
        name=_text(value["name"]),
        fps=fps,
        frames=frames,
        terrain=_text(value["terrain"]),
        prompts=prompts,
        origin=origin_from(value["origin"]),
        gait_seconds=tuple((_text(name), read_number(seconds)) for name, seconds in value["gait_seconds"]),
        placed=placed,
        size=size,
        has_gaits=value["has_gaits"] is True,
        resimulable=value["resimulable"] is True,
    )
    return header, value["recording"] is True


def _read_reference(value: Json) -> Reference:
    numbers = {f.name: read_number(value[f.name]) for f in fields(Reference) if f.type == "float"}
    character = value["character"]
    return Reference(
        take=read_whole(value["take"]),
        video=_text(value["video"]),
        look=_text(value["look"]),
        character=None if character is None else _read_character(character),
        over=value["over"] is True,
        **numbers,
    )


def _read_character(value: Json) -> CharacterChoice:
    shape = BodyShape(**{name: read_number(share) for name, share in value["shape"].items()})
    shape.check()
    key = _text(value["key"])
    if key and not safe_name(key):
        raise ValueError("files of a character outside their folder")
    return CharacterChoice(shape, _text(value["path"]), key)


# --- values


def _label(text: str) -> str:
    """Text as `_text` reads it."""
    return printable(text).replace("\0", "\ufffd")[:MAX_TEXT]


def read_view(text: str) -> dict[str, Any]:
    """How a session was looked at: entries that are texts, numbers or truth values; none for what is no view."""
    try:
        value = parse_json(text) if text else {}
    except ValueError:
        return {}
    known = value.items() if isinstance(value, dict) else ()
    return {
        key: entry
        for key, entry in known
        if (is_text(entry) and len(entry) <= MAX_TEXT)
        or (isinstance(entry, bool | int | float) and math.isfinite(entry))
    }
