"""Metadata of a take in its file: JSON next to a BVH, `extras` of a GLB, prompts and gaits as time line markers.

`walk.bvh` has `walk.bvh.json`. It names model, seed, ground and styles; folders, addresses and keys are never in it.
"""

import contextlib
import hashlib
import itertools
import json
import logging
import os
from dataclasses import asdict
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.checked import number_field, read_number, text_field
from runtime.controls import Gait
from runtime.errors import FileError
from runtime.formats.bvh import MAX_FILE_BYTES
from runtime.formats.prepare import PreparedTake
from runtime.safe_read import parse_json, printable, read_bounded
from runtime.takes.clip import MAX_SIZE, MIN_SIZE, Clip
from runtime.takes.metadata import (
    MAX_EVENTS,
    UNMOVED,
    LoopReport,
    PromptEvent,
    event_from,
    gait_changes,
    gait_numbers,
    origin_from,
    title,
)

MAX_BYTES = 64 * 1024 * 1024
CONTACTS = ("left_heel", "left_toe", "right_heel", "right_toe")
FEET = ("left", "right")
NO_PHASE_ANGLE = -1.0  # stored instead of NaN, which JSON lacks
MARKERS_VERSION = 1
_FORMAT = "sport-take"
_LOG = logging.getLogger("sport.clip")


MAX_NAME = 250  # bytes of a file name, without those of ".json"


def sidecar_path(bvh: Path) -> Path:
    """Return the path of the metadata file next to a BVH."""
    name = bvh.name.encode(errors="surrogateescape")[:MAX_NAME].decode(errors="surrogateescape")
    return bvh.with_name(name + ".json")


def format_metadata(clip: Clip, bvh_text: str) -> str:
    """Return the JSON metadata of a clip, with a hash of its BVH text; a ground from a file is stored by file name only."""
    value = {
        **_metadata(clip),
        "bvh_sha256": hashlib.sha256(bvh_text.encode("utf-8")).hexdigest(),
        "seconds": round(clip.seconds, 4),
        "terrain": printable(Path(clip.terrain).name),
        **asdict(clip.origin),
    }
    text = json.dumps(value, ensure_ascii=False, indent=1)
    tracks = (f' "{name}": {json.dumps(values)}' for name, values in foot_tracks(clip).items())
    return ",\n".join([text[: -len("\n}")], *tracks]) + "\n}\n"  # one line per track, not per number


def _metadata(clip: Clip) -> dict[str, Any]:
    """Return the metadata that every format stores: all but ground, origin and feet."""
    return {
        "format": _FORMAT,
        "name": printable(clip.name),
        "gait_seconds": {gait: round(length, 3) for gait, length in clip.gait_seconds},
        "gaits": [[round(seconds, 4), gait] for seconds, gait in gait_changes(clip.gaits, clip.fps)],
        "placed": None if clip.placed is None else [round(value, 6) for value in clip.placed],
        "size": round(clip.size, 6),
        **({"loop": {name: round(v, 4) for name, v in asdict(clip.loop).items()}} if clip.loop else {}),
        "prompts": [{**asdict(e), "words": json.loads(e.words) if e.words else None} for e in clip.prompts],
    }


def foot_tracks(clip: Clip) -> dict[str, dict[str, list[float]]]:
    """Return per-frame tracks: contact (0 to 1) of each sole point, and phase of each foot (radians or `NO_PHASE_ANGLE`)."""
    phases = np.nan_to_num(foot_phases(clip), nan=NO_PHASE_ANGLE)
    columns = (("contacts", CONTACTS, clip.contacts), ("phase", FEET, phases))
    return {
        track: {name: [round(v, 4) for v in values[:, k].tolist()] for k, name in enumerate(names)}
        for track, names, values in columns
    }


def foot_phases(clip: Clip) -> NDArray[np.float32]:
    """Return the phase of each foot `(T, 2)`: 0 at a landing, 2 pi at the next; NaN before, after and at rest."""
    phases = np.full((len(clip), len(FEET)), np.nan, np.float32)
    for foot in range(len(FEET)):
        down = clip.contacts[:, 2 * foot : 2 * foot + 2].max(axis=1) > 0.5
        begins = np.flatnonzero(down[1:] & ~down[:-1]) + 1
        for first, last in itertools.pairwise(begins):
            phases[first:last, foot] = 2.0 * np.pi * np.arange(last - first) / (last - first)
    return phases


def read_sidecar(bvh: Path) -> Any:
    """Return the metadata next to a BVH, or None if it is missing or belongs to another BVH.

    Damage is only logged as a warning: a motion can be opened whatever is next to it.
    """
    path = sidecar_path(bvh)
    if not os.path.isfile(path):  # also where its name is too long
        return None
    try:
        value = parse_json(read_bounded(path, MAX_BYTES))
        if not isinstance(value, dict) or value.get("format") != _FORMAT:
            raise ValueError("not the metadata of a take")
        if value.get("bvh_sha256") != hashlib.sha256(read_bounded(bvh, MAX_FILE_BYTES)).hexdigest():
            raise ValueError(f"made for another file than {bvh.name} as it is now")
    except (ValueError, FileError) as error:
        _LOG.warning("%s: not used (%s).", path, error)
        return None
    return value


def clip_fields(value: Any, path: Path, fps: float, frames: int) -> dict[str, Any]:
    """Read the fields of a `Clip` from untrusted metadata; missing or wrong fields get their defaults.

    If `value` is not metadata of a take, only `contacts` is returned, as zeros.
    """
    found: dict[str, Any] = {"contacts": np.zeros((frames, len(CONTACTS)), np.float32)}
    if not isinstance(value, dict) or value.get("format") != _FORMAT:
        return found
    gaits, origin, contacts = value.get("gait_seconds"), value.get("origin"), _contacts(value, frames)
    gaits = gaits if isinstance(gaits, dict) else {}
    return (found if contacts is None else {"contacts": contacts}) | {
        "terrain": text_field(value, "terrain", text_field(value, "ground", "flat")),
        "prompts": _prompts(value.get("prompts"), path),
        "origin": origin_from(origin if isinstance(origin, dict) else value),
        "gait_seconds": tuple((g.label, number_field(gaits, g.label, 0.0)) for g in Gait if g.label in gaits),
        "gaits": gait_numbers(_gait_changes(value.get("gaits")), frames, fps),
        "placed": _placed(value.get("placed", UNMOVED)),
        "size": min(max(number_field(value, "size", 1.0), MIN_SIZE), MAX_SIZE),
        "loop": _loop(value.get("loop")),
    }


def _prompts(value: Any, path: Path) -> tuple[PromptEvent, ...]:
    events = value if isinstance(value, list) else []
    if len(events) > MAX_EVENTS:
        _LOG.warning("%s: only the first %d of %d prompts are used.", path, MAX_EVENTS, len(events))
    return tuple(event_from(event) for event in events[:MAX_EVENTS] if isinstance(event, dict))


def _gait_changes(value: Any) -> tuple[tuple[float, str], ...]:
    """Return the pairs of a list that are a time and a gait's name."""
    names, found = {gait.label for gait in Gait}, []
    for pair in value[:MAX_EVENTS] if isinstance(value, list) else ():
        with contextlib.suppress(TypeError, ValueError):
            seconds, name = pair
            if isinstance(name, str) and name in names:
                found.append((read_number(seconds), name))
    return tuple(found)


def _loop(value: Any) -> LoopReport | None:
    with contextlib.suppress(TypeError, ValueError, KeyError):
        first, last, *rest = (read_number(value[name]) for name in LoopReport.__dataclass_fields__)
        return LoopReport(int(first), int(last), *rest)
    return None


def _contacts(value: dict[str, Any], frames: int) -> Array | None:
    """Return contacts `(frames, 4)` from a track per sole point; None if they are invalid."""
    with contextlib.suppress(TypeError, ValueError, KeyError, OverflowError):
        contacts = np.array([value["contacts"][name] for name in CONTACTS], np.float32).T
        if contacts.shape == (frames, 4) and ((contacts >= 0.0) & (contacts <= 1.0)).all():
            return np.ascontiguousarray(contacts)
    return None


def _placed(value: Any) -> tuple[float, ...] | None:
    if value is None:
        return None
    with contextlib.suppress(TypeError, ValueError):
        yaw, x, y, z = map(read_number, value)
        return yaw, x, y, z
    return UNMOVED


def markers(clip: Clip) -> list[dict[str, Any]]:
    """Return markers `{"kind": "prompt" | "gait", "name", "seconds", "frame"}` in order of time.

    Gait markers exist only if the clip has gaits per frame.
    """
    marks = [("prompt", title(event), max(event.seconds, 0.0)) for event in clip.prompts]
    marks += [("gait", name, seconds) for seconds, name in gait_changes(clip.gaits, clip.fps)]
    return [
        {"kind": kind, "name": name, "seconds": round(seconds, 4), "frame": round(seconds * clip.fps)}
        for kind, name, seconds in sorted(marks, key=itemgetter(2))
    ]


def take_extras(take: PreparedTake) -> dict[str, Any]:
    """Return the `extras` of a GLB under "sport": metadata, markers, loop, rest frame and foot tracks."""
    clip = take.clip
    return {
        **_metadata(clip),
        "version": MARKERS_VERSION,
        "fps": clip.fps,
        "frames": len(clip),
        "ground": printable(Path(clip.terrain).name),
        "rest_frame": take.rest_frame,
        "markers": markers(clip),
        "origin": {name: v for name, v in asdict(clip.origin).items() if v not in ("", None)},
        **foot_tracks(clip),
    }
