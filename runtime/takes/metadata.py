"""What a take was made with: a JSON file beside its BVH, written with it and read with doubt.

`walk.bvh` has `walk.bvh.json`. It names model, seed, ground and styles; folders, addresses and keys are never in it.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.controls import Controls, Gait
from runtime.errors import FileError, SportError
from runtime.safe_read import is_text, parse_json, printable, read_bounded
from runtime.takes.bvh import MAX_FILE_BYTES

MAX_BYTES = 16 * 1024 * 1024
MAX_EVENTS = 10_000
MAX_NUMBER = 1e18
_FORMAT = "sport-take"
_LOG = logging.getLogger("sport.clip")


@dataclass(frozen=True)
class PromptEvent:
    """A prompt that came into force `seconds` after the clip's first frame (0 or earlier: it held from the start).

    `words` are the six descriptions that it meant, or a blend of two times six, as `runtime.prompts.blend.read_words`
    reads them; "" where they are not known. `typed` is what was typed where `prompt` is no longer that, as when a
    part was edited afterwards.
    """

    seconds: float
    prompt: str
    transition_seconds: float = 0.0
    words: str = ""
    typed: str = ""


@dataclass(frozen=True)
class Origin:
    """Model, seed and settings that a take was made with; empty or None where they are not known.

    `model_sha256` is that of the step graph that ran. The seed belongs to a character's start at its place: a take
    cut from a longer run needs the run from its start to be made again frame by frame.
    """

    model: str = ""
    model_sha256: str = ""
    precision: str = ""
    seed: int | None = None
    temperature: float | None = None
    strength: float | None = None
    terrain_seed: int | None = None  # None for a ground from a file


UNKNOWN = Origin()
UNMOVED = (0.0, 0.0, 0.0, 0.0)  # a take that stands where it was made


def origin_of(controller: Any, terrain: str) -> Origin:
    """The origin of what `controller` makes on the ground `terrain`; fields that a stand-in for it lacks stay empty."""
    from runtime.terrain.library import TERRAIN_NAMES

    model = getattr(controller, "model", None)
    precision = str(getattr(model, "precision", ""))
    hashes = getattr(model, "metadata", {}).get("sha256", {})
    return Origin(
        model=str(getattr(model, "name", "")),
        model_sha256=str(hashes.get("step_int8" if precision == "int8" else "step", "")),
        precision=precision,
        seed=getattr(controller, "seed", None),
        temperature=getattr(controller, "temperature", None),
        strength=getattr(controller, "strength", None),
        terrain_seed=0 if terrain in TERRAIN_NAMES else None,
    )


def gait_of(controls: Controls) -> int:
    """The gait that controls ask for: standing where the stick is at rest."""
    return int(controls.gait if controls.gait == Gait.JUMP or any(controls.move) else Gait.STAND)


def gait_seconds(gaits: NDArray[np.integer], fps: float) -> dict[str, float]:
    """Seconds of each gait asked for in frames `(T,)` of gait numbers; empty where nothing is known of them."""
    return {gait.name.lower(): int(n) / fps for gait in Gait if (n := np.count_nonzero(gaits == gait))}


def sidecar_path(bvh: Path) -> Path:
    """Where the metadata of a BVH file stand."""
    return bvh.with_name(bvh.name + ".json")


def format_metadata(
    bvh_text: str,
    name: str,
    seconds: float,
    terrain: str,
    prompts: tuple[PromptEvent, ...],
    origin: Origin,
    gaits: Mapping[str, float],
    gait_changes: Sequence[tuple[float, str]] = (),
    placed: tuple[float, ...] | None = UNMOVED,
) -> str:
    """The JSON text for a BVH of this text; a ground from a file goes by the file's name alone.

    `gait_changes` and `placed` are those of `Clip`.
    """
    value = {
        "format": _FORMAT,
        "bvh_sha256": hashlib.sha256(bvh_text.encode("utf-8")).hexdigest(),
        "name": printable(name),
        "seconds": round(seconds, 4),
        "terrain": printable(Path(terrain).name),
        "gait_seconds": {gait: round(length, 3) for gait, length in gaits.items()},
        "gaits": [[round(seconds, 4), gait] for seconds, gait in gait_changes],
        "placed": None if placed is None else [round(value, 6) for value in placed],
        **asdict(origin),
        "prompts": [{**asdict(event), "words": _object(event.words)} for event in prompts],
    }
    return json.dumps(value, ensure_ascii=False, indent=1) + "\n"


@dataclass(frozen=True)
class TakeMetadata:
    """What the file beside a BVH tells; fields that are missing or of another type have their defaults."""

    terrain: str = "flat"
    prompts: tuple[PromptEvent, ...] = ()
    origin: Origin = UNKNOWN
    gait_seconds: tuple[tuple[str, float], ...] = ()
    gait_changes: tuple[tuple[float, str], ...] = ()
    placed: tuple[float, ...] | None = UNMOVED


def read_metadata(bvh: Path) -> TakeMetadata:
    """The metadata of a BVH file. Without a file of this form that belongs to that very BVH, nothing is known.

    A take from an older program has none, and a motion can be opened whatever stands beside it: damage is a warning
    in the log.
    """
    path = sidecar_path(bvh)
    if not path.is_file():
        return TakeMetadata()
    try:
        value = parse_json(read_bounded(path, MAX_BYTES))
        if not isinstance(value, dict) or value.get("format") != _FORMAT:
            raise ValueError("not the metadata of a take")
        if value.get("bvh_sha256") != hashlib.sha256(read_bounded(bvh, MAX_FILE_BYTES)).hexdigest():
            raise ValueError(f"made for another file than {bvh.name} as it is now")
    except (ValueError, FileError) as error:
        _LOG.warning("%s: not used (%s).", path, error)
        return TakeMetadata()
    gaits = value.get("gait_seconds")
    events = value.get("prompts")
    if isinstance(events, list) and len(events) > MAX_EVENTS:
        _LOG.warning("%s: only the first %d of %d prompts are used.", path, MAX_EVENTS, len(events))
    return TakeMetadata(
        terrain=_text(value, "terrain", "flat"),
        prompts=tuple(event_from(e) for e in events[:MAX_EVENTS] if isinstance(e, dict))
        if isinstance(events, list)
        else (),
        origin=origin_from(value),
        gait_seconds=tuple(
            (gait.name.lower(), _number(gaits, gait.name.lower(), 0.0))
            for gait in Gait
            if isinstance(gaits, dict) and gait.name.lower() in gaits
        ),
        gait_changes=_gait_changes(value.get("gaits")),
        placed=_placed(value),
    )


def gait_changes(gaits: NDArray[np.integer] | None, fps: float) -> tuple[tuple[float, str], ...]:
    """When each gait began to be asked for, and its name, from gait numbers `(T,)`; unknown ones are left out."""
    if gaits is None or len(gaits) == 0:
        return ()
    begins = np.concatenate([[0], np.flatnonzero(np.diff(gaits)) + 1])
    known = {int(gait): gait.name.lower() for gait in Gait}
    return tuple((int(i) / fps, known[int(gaits[i])]) for i in begins if int(gaits[i]) in known)


def gait_numbers(changes: Sequence[tuple[float, str]], frames: int, fps: float) -> NDArray[np.int8] | None:
    """Gait numbers `(frames,)`, -1 before the first change; None without any. Inverse of `gait_changes`."""
    if not changes:
        return None
    numbers = np.full(frames, -1, np.int8)
    for seconds, name in changes:
        numbers[max(round(seconds * fps), 0) :] = Gait[name.upper()]
    return numbers


def _gait_changes(value: Any) -> tuple[tuple[float, str], ...]:
    names = {gait.name.lower() for gait in Gait}
    pairs = (
        [pair for pair in value if isinstance(pair, list) and len(pair) == 2]
        if isinstance(value, list)
        else []
    )
    return tuple(
        (float(seconds), name)
        for seconds, name in pairs[:MAX_EVENTS]
        if isinstance(seconds, int | float) and abs(seconds) < 1e9 and isinstance(name, str) and name in names
    )


def _placed(value: Mapping[str, Any]) -> tuple[float, ...] | None:
    found = value.get("placed", list(UNMOVED))
    if found is None:
        return None
    numbers = isinstance(found, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e9 for v in found
    )
    return tuple(float(v) for v in found) if numbers and len(found) == len(UNMOVED) else UNMOVED


def title(event: PromptEvent) -> str:
    """A prompt in at most 60 characters; "own words" for six descriptions, "(edited)" after what they came from."""
    from runtime.prompts.blend import BlendedPrompt, read_words
    from runtime.prompts.parts import PartDescriptions

    try:
        words = read_words(event.prompt)
    except SportError:  # of a file that somebody wrote by hand
        words = event.prompt
    if isinstance(words, BlendedPrompt):
        words = " + ".join(w if isinstance(w, str) else "own words" for w in (words.a, words.b))
    text = "own words" if isinstance(words, PartDescriptions) else words
    text = f"{event.typed} (edited)" if event.typed else text
    return text if len(text) <= 60 else text[:59] + "…"


def describe(
    terrain: str, prompts: tuple[PromptEvent, ...], origin: Origin, gaits: Mapping[str, float]
) -> str:
    """Some lines for a person about how a take was made; "" when nothing is known."""
    shown = [f"{max(e.seconds, 0.0):.1f} s  {title(e)}" for e in prompts[:6]]
    if len(prompts) > 6:
        shown.append(f"and {len(prompts) - 6} more")
    if gaits:
        shown.append(", ".join(f"{gait} {length:.1f} s" for gait, length in gaits.items()))
    if origin != UNKNOWN:
        seed = "" if origin.seed is None else f", seed {origin.seed}"
        shown.append(f"model {origin.model} {origin.model_sha256[:8]}{seed}, ground {Path(terrain).name}")
    return printable("\n".join(shown))


def _object(words: str) -> Any:
    return json.loads(words) if words else None


def event_from(value: dict[str, Any]) -> PromptEvent:
    """An event of JSON that nobody vouches for; fields of another type have their defaults."""
    return PromptEvent(
        _number(value, "seconds", 0.0),
        _text(value, "prompt", ""),
        max(_number(value, "transition_seconds", 0.0), 0.0),
        _words(value.get("words")),
        _text(value, "typed", ""),
    )


def _words(value: Any) -> str:
    """The JSON text of the words of an event; "" where they are none that could be written again."""
    try:
        words = json.dumps(value, ensure_ascii=False) if isinstance(value, dict) else ""
    except RecursionError:
        return ""
    return words if is_text(words) else ""


def origin_from(value: dict[str, Any]) -> Origin:
    """Each field by its type: text, whole number or number."""
    found: dict[str, Any] = {}
    for field in fields(Origin):
        if isinstance(field.default, str):
            found[field.name] = _text(value, field.name, "")
        elif isinstance(value.get(field.name), int | float):
            number = _number(value, field.name, math.nan)
            whole = "seed" in field.name
            if math.isfinite(number):
                found[field.name] = int(value[field.name]) if whole else number
    return Origin(**found)


def _text(value: Mapping[str, Any], field: str, default: str) -> str:
    found = value.get(field, default)
    return found if is_text(found) else default


def _number(value: Mapping[str, Any], field: str, default: float) -> float:
    found = value.get(field, default)
    try:
        number = float(found) if isinstance(found, int | float) and not isinstance(found, bool) else default
    except OverflowError:
        return default
    return number if abs(number) <= MAX_NUMBER else default
