"""The origin of a take: model, seed, prompts and gaits, also read from untrusted JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.checked import number_field, text_field
from runtime.controls import Controls, Gait
from runtime.errors import SportError
from runtime.safe_read import is_text, printable

MAX_EVENTS = 10_000


@dataclass(frozen=True)
class PromptEvent:
    """A prompt that takes effect `seconds` after the clip's first frame (0 or less: it held from the start).

    `words` are its six descriptions, or a blend of two sets, in the format of `runtime.prompts.blend.read_words`; "" if
    unknown. `typed` is the typed text if `prompt` differs, as after editing a part.
    """

    seconds: float
    prompt: str
    transition_seconds: float = 0.0
    words: str = ""
    typed: str = ""

    def rewritten(self, change: Callable[[str], str]) -> PromptEvent:
        """Return the event with all its texts changed by `change`."""
        prompt, words, typed = map(change, (self.prompt, self.words, self.typed))
        return replace(self, prompt=prompt, words=words, typed=typed)


@dataclass(frozen=True)
class Origin:
    """The model, seed and settings that a take was made with; empty or None if unknown.

    `model_sha256` is the hash of the step graph. The seed applies to a character's start: to reproduce a take cut from
    a longer run, simulate the run from its start.
    """

    model: str = ""
    model_sha256: str = ""
    precision: str = ""
    seed: int | None = None
    temperature: float | None = None
    strength: float | None = None
    terrain_seed: int | None = None  # None for a ground from a file


@dataclass(frozen=True)
class LoopReport:
    """The cycle found: its frames in the exported range, the difference of its ends, and what remains at the seam.

    `step_cm` is how much the motion per frame changes across the seam in the worst joint, `usual_step_cm` the largest
    such change inside the cycle.
    """

    first: int
    last: int
    seconds: float
    ends_cm: float
    ends_degrees: float
    seam_cm: float
    seam_degrees: float
    step_cm: float
    usual_step_cm: float

    def describe(self) -> str:
        """Return one line about the loop, for the command and the status line."""
        return (
            f"loop of {self.seconds:.2f} s (frames {self.first} to {self.last}): the ends were {self.ends_cm:.1f} cm and"
            f" {self.ends_degrees:.1f} degrees apart, the seam is {self.seam_cm:.2f} cm and {self.seam_degrees:.2f}"
            f" degrees; steps over it change by {self.step_cm:.2f} cm, within the cycle by up to {self.usual_step_cm:.2f} cm"
        )


UNKNOWN = Origin()
UNMOVED = (0.0, 0.0, 0.0, 0.0)  # a take at its original place


def origin_of(controller: Any, terrain: str) -> Origin:
    """Return the origin of motions made by `controller` on `terrain`; fields that a stand-in lacks are empty."""
    from runtime.terrain.library import TERRAIN_NAMES

    model = getattr(controller, "model", None)
    precision = str(getattr(model, "precision", ""))
    hashes = getattr(model, "metadata", {}).get("sha256", {})
    return Origin(
        model=str(getattr(model, "name", "")),
        model_sha256=str(hashes.get("step_int8" if precision == "int8" else "step", "")),
        precision=precision,
        **{name: getattr(controller, name, None) for name in ("seed", "temperature", "strength")},
        terrain_seed=0 if terrain in TERRAIN_NAMES else None,
    )


def gait_of(controls: Controls) -> int:
    """Return the gait requested by controls: standing if the stick is at rest."""
    return int(controls.gait if controls.gait == Gait.JUMP or any(controls.move) else Gait.STAND)


def gait_seconds(gaits: NDArray[np.integer] | None, fps: float) -> tuple[tuple[str, float], ...]:
    """Return the seconds of each requested gait, from gait numbers `(T,)`; () if they are unknown."""
    if gaits is None:
        return ()
    return tuple((gait.label, int(n) / fps) for gait in Gait if (n := np.count_nonzero(gaits == gait)))


def gait_changes(gaits: NDArray[np.integer] | None, fps: float) -> tuple[tuple[float, str], ...]:
    """Return (time, name) of each change of the requested gait, from gait numbers `(T,)`, without unknown ones."""
    if gaits is None or len(gaits) == 0:
        return ()
    begins = np.concatenate([[0], np.flatnonzero(np.diff(gaits)) + 1])
    known = {int(gait): gait.label for gait in Gait}
    return tuple((int(i) / fps, known[int(gaits[i])]) for i in begins if int(gaits[i]) in known)


def gait_numbers(changes: Sequence[tuple[float, str]], frames: int, fps: float) -> NDArray[np.int8] | None:
    """Return gait numbers `(frames,)`, -1 before the first change, or None without changes. Inverse of `gait_changes`."""
    if not changes:
        return None
    numbers = np.full(frames, -1, np.int8)
    for seconds, name in changes:
        numbers[max(round(seconds * fps), 0) :] = Gait[name.upper()]
    return numbers


def title(event: PromptEvent, most: int = 60) -> str:
    """Return a prompt's title of at most `most` characters: "own words" for six descriptions, "(edited)" after edited ones."""
    from runtime.prompts.blend import BlendedPrompt, read_words
    from runtime.prompts.parts import PartDescriptions

    try:
        words = read_words(event.prompt)
    except SportError:  # in a hand-written file
        words = event.prompt
    if isinstance(words, BlendedPrompt):
        words = " + ".join(w if isinstance(w, str) else "own words" for w in (words.a, words.b))
    text = "own words" if isinstance(words, PartDescriptions) else words
    text = f"{event.typed} (edited)" if event.typed else text
    return text if len(text) <= most else text[: most - 1] + "…"


def describe(
    terrain: str, prompts: tuple[PromptEvent, ...], origin: Origin, gaits: Mapping[str, float]
) -> str:
    """Return some lines for the user about how a take was made; "" if nothing is known."""
    shown = [f"{max(e.seconds, 0.0):.1f} s  {title(e)}" for e in prompts[:6]]
    if len(prompts) > 6:
        shown.append(f"and {len(prompts) - 6} more")
    if gaits:
        shown.append(", ".join(f"{gait} {length:.1f} s" for gait, length in gaits.items()))
    if origin != UNKNOWN:
        seed = "" if origin.seed is None else f", seed {origin.seed}"
        shown.append(f"model {origin.model} {origin.model_sha256[:8]}{seed}, ground {Path(terrain).name}")
    return printable("\n".join(shown))


def event_from(value: dict[str, Any]) -> PromptEvent:
    """Read an event from untrusted JSON; fields of a wrong type get their defaults."""
    return PromptEvent(
        number_field(value, "seconds", 0.0),
        text_field(value, "prompt", ""),
        max(number_field(value, "transition_seconds", 0.0), 0.0),
        _words(value.get("words")),
        text_field(value, "typed", ""),
    )


def _words(value: Any) -> str:
    """Return the JSON text of an event's words; "" if they are invalid."""
    try:
        words = json.dumps(value, ensure_ascii=False) if isinstance(value, dict) else ""
    except RecursionError:
        return ""
    return words if is_text(words) else ""


def origin_from(value: dict[str, Any]) -> Origin:
    """Read an origin from untrusted JSON; fields of a wrong type get their defaults."""
    found: dict[str, Any] = {}
    for field in fields(Origin):
        if isinstance(field.default, str):
            found[field.name] = text_field(value, field.name, "")
        elif isinstance(value.get(field.name), int | float):
            number = number_field(value, field.name, math.nan)
            whole = "seed" in field.name
            if math.isfinite(number):
                found[field.name] = int(value[field.name]) if whole else number
    return Origin(**found)
