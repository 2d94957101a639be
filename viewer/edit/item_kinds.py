"""The kinds of items on each track, and how edits remove and add them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any

from runtime.errors import UsageError
from runtime.session import edits
from runtime.session.session import Session, Take
from runtime.takes import input_edits
from runtime.takes.camera_keys import with_key
from runtime.takes.footplants import FootplantEdit, fitted_footplant
from runtime.takes.input_recording import InputRecording
from runtime.takes.pins import Pin
from viewer.edit.pins import Pins
from viewer.edit.resimulation import Resimulation
from viewer.edit.tracks import PINS, TAKES, Item, ItemKind, Items

PROMPTS, GAITS, FOOTPLANTS = "prompts", "gaits", "footplants"
CAMERA_KEYS, POSE_KEYS = "camera keys", "pose keys"
TakeChange = Callable[[Take, Items, Items], tuple[Take, Items]]


def item_kinds(editing: Resimulation, pins: Pins) -> dict[str, ItemKind]:
    """Return every kind of item by name, in track order."""

    def of_take(items: Callable[[Take], list[Item]]) -> Callable[[], list[Item]]:
        return lambda: [] if editing.take is None else items(editing.take)

    def of_tracks(kind: str) -> Callable[[], list[Item]]:
        return lambda: (
            [] if editing.tracks is None else [m.item for m in getattr(editing.tracks, kind) if m.item]
        )

    def listed() -> list[Item]:
        takes = enumerate(editing.takes.session.takes)
        return [Item(place, place, TAKES, take, take.number) for place, take in takes]

    def plants(take: Take) -> list[Item]:
        return [Item(a, b, FOOTPLANTS, None, foot) for foot in (0, 1) for a, b in pins.footplants(foot)]

    return {
        PROMPTS: ItemKind("prompt", of_tracks(PROMPTS), edit=_prompts, adjacent=True),
        GAITS: ItemKind("gait", of_tracks(GAITS), edit=_gaits, adjacent=True),
        CAMERA_KEYS: ItemKind("camera key", of_take(camera_items), _to_take(_camera_keys)),
        POSE_KEYS: ItemKind("pose key", of_take(pose_items), _to_take(_pose_keys)),
        PINS: ItemKind("pin", of_take(pin_items), _to_take(_pins)),
        FOOTPLANTS: ItemKind(
            "footplant", of_take(plants), _to_take(lambda *about: _footplants(pins, *about))
        ),
        TAKES: ItemKind("take", listed, _takes, listed=True),
    }


def _to_take(change: TakeChange) -> Callable[[Session, int, Items, Items], tuple[Session, Items]]:
    """Convert a change of the playing take to a change of the session."""

    def changed(session: Session, number: int, gone: Items, put: Items) -> tuple[Session, Items]:
        take = session.take(number)
        if take is None:
            return session, put
        made, put = change(take, gone, put)
        return session.with_take(number, poses=made.poses, cameras=made.cameras), put

    return changed


# --- resimulated edits


def _places(spans: Sequence[input_edits.Span], gone: Items, put: Items) -> list[int]:
    """Return the indices of spans that an edit removes; UsageError if nothing would be left."""
    starts = {item.start for item in gone}
    places = [i for i, span in enumerate(spans) if span.start in starts]
    if len(places) == len(spans) and not put:
        raise UsageError("A take needs at least one prompt and one gait.", "Replace it by another one.")
    return places


def _prompts(inputs: InputRecording, gone: Items, put: Items) -> input_edits.Edit:
    new = [input_edits.PromptSpan(item.start, item.end, item.value.changes) for item in put]
    return input_edits.prompts_laid(inputs, _places(input_edits.prompt_spans(inputs), gone, put), new)


def _gaits(inputs: InputRecording, gone: Items, put: Items) -> input_edits.Edit:
    new = [input_edits.GaitSpan(item.start, item.end, item.value.gait) for item in put]
    return input_edits.gaits_laid(inputs, _places(input_edits.gait_spans(inputs.gaits()), gone, put), new)


# --- keys


def _points(keys: Sequence[Any], fps: float, kind: str) -> list[Item]:
    return [Item(frame, frame, kind, key) for key in keys for frame in (round(key.seconds * fps),)]


def camera_items(take: Take) -> list[Item]:
    """Return the camera keys of a take as items."""
    return _points(take.cameras, take.made.header.fps, CAMERA_KEYS)


def pose_items(take: Take) -> list[Item]:
    """Return the keys of a take's pose layer as items."""
    return _points(take.poses.layer.keys, take.made.header.fps, POSE_KEYS)


def _at_seconds(item: Item, fps: float) -> Any:
    """Return the key of an item at its frame."""
    there = round(item.value.seconds * fps) == item.start
    return item.value if there else replace(item.value, seconds=item.start / fps)


def _camera_keys(take: Take, gone: Items, put: Items) -> tuple[Take, Items]:
    fps, frames = take.made.header.fps, {item.start for item in gone}
    keys = tuple(key for key in take.cameras if round(key.seconds * fps) not in frames)
    for item in put:
        keys = with_key(keys, _at_seconds(item, fps), fps)
    return replace(take, cameras=keys), put


def _pose_keys(take: Take, gone: Items, put: Items) -> tuple[Take, Items]:
    fps, frames, layer = take.made.header.fps, {item.start for item in gone}, take.poses.layer
    layer = replace(layer, keys=tuple(key for key in layer.keys if round(key.seconds * fps) not in frames))
    for item in put:
        layer = layer.with_key(_at_seconds(item, fps), fps)
    return replace(take, poses=replace(take.poses, layer=layer)), put


# --- pins and footplants


def pin_items(take: Take) -> list[Item]:
    """Return the pins of a take as items, which include their last frame."""
    header = take.made.header
    return [
        Item(start, max(last, start) + 1, PINS, pin, index)
        for index, pin in enumerate(take.poses.pins)
        for start, last in (
            (round(pin.start * header.fps), round(pin.end_in((header.frames - 1) / header.fps) * header.fps)),
        )
    ]


def _pins(take: Take, gone: Items, put: Items) -> tuple[Take, Items]:
    fps, pins = take.made.header.fps, list(take.poses.pins)
    if gone and put:
        for old, new in zip(gone, put, strict=True):
            pins[int(str(old.lane))] = _moved_pin(old, new, take.frames, fps)
    elif gone:
        removed = {item.lane for item in gone}
        pins = [pin for index, pin in enumerate(pins) if index not in removed]
    else:
        put = [replace(item, lane=len(pins) + place) for place, item in enumerate(put)]
        pins += [
            replace(item.value, start=item.start / fps, end=max(item.start, item.end - 1) / fps)
            for item in put
        ]
    return replace(take, poses=replace(take.poses, pins=tuple(pins))), put


def _moved_pin(old: Item, new: Item, frames: int, fps: float) -> Pin:
    """Return the pin of an item at other frames; an end that did not move keeps its time."""
    pin: Pin = old.value
    start = pin.start if new.start == old.start else new.start / fps
    end = pin.end if new.end == old.end else (min(new.end, frames) - 1) / fps
    return replace(pin, start=start, end=max(start, end))


def _footplants(pins: Pins, take: Take, gone: Items, put: Items) -> tuple[Take, Items]:
    """Return footplant edits in an order in which they do not overlap."""
    known = {foot: pins.planted_frames(take, foot) for foot in (0, 1)}
    made: list[FootplantEdit] = []
    now: list[Item] = []
    for old, new in _paired(gone, put):
        foot = int(str((old or new).lane))
        before = None if old is None else (old.start, old.end)
        frames = known[foot], take.frames, before
        after = None if new is None else fitted_footplant(*frames, new.start, new.end)
        if before != after:
            known[foot] = sorted({*known[foot], *([after] if after else [])} - {before})
            made.append(FootplantEdit(foot, before, after))
        if new is not None and after is not None:
            now.append(new.at(*after))
    footplants = (*take.poses.footplants, *made)
    return replace(take, poses=replace(take.poses, footplants=footplants)), now


def _paired(gone: Items, put: Items) -> list[tuple[Any, Any]]:
    """Pair removed items with their replacements, first to last; last to first if they move to later frames."""
    pairs = sorted(zip_longest(gone, put), key=lambda pair: (pair[0] or pair[1]).start)
    return pairs[::-1] if gone and put and put[0].start > gone[0].start else pairs


# --- the list of takes


def _takes(session: Session, _: int, gone: Items, put: Items) -> tuple[Session, Items]:
    if gone and put:
        by = put[0].start - gone[0].start
        ends = {session.index(int(str(item.lane))) for item in gone} & {
            len(session.takes) - 1 if by > 0 else 0
        }
        for item in () if ends else sorted(gone, key=lambda item: -by * item.start):
            session = edits.moved(session, int(str(item.lane)), by)
        return session, gone if ends else put
    for item in gone:
        session = edits.without_take(session, int(str(item.lane)))
    made = []
    for item in put:
        session = edits.with_new_take(session, edits.copied(item.value))
        made.append(replace(item, lane=session.counter))
    return session, made
