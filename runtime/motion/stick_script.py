"""The stick of a clip as text: "stand 2; walk 3; walk@90 3; jog@0*0.5 2; walk@90>0 2; jump 1".

Segments `GAIT[@HEADING][*AMOUNT][>FACING] SECONDS` are separated by semicolons:

- GAIT: stand, walk, jog, crouch or jump. `jump` presses the button at its beginning and leaves the stick where it was.
- HEADING: degrees in the world; 0 is +Z, 90 is +X (the left of a character that faces +Z). Default 0.
- AMOUNT: share of the full stick, 0 to 1. Default 1; `crouch*0` rests crouched.
- FACING: degrees that the body faces whatever way it goes (strafing); without it, it faces where it goes.
- SECONDS: how long the segment lasts.

After the last segment the stick is at rest.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import accumulate
from math import cos, radians, sin

from runtime.controls import REQUESTS, Controls, Gait
from runtime.errors import UsageError
from runtime.motion.paths import PlanarPose

GAITS = {gait.label: gait for gait in REQUESTS}
EXAMPLE = "stand 2; walk 3; walk@90 3; jog@0*0.5 2; jump 1"
MAX_SECONDS = 24 * 3600.0
MAX_CHARACTERS = 100_000
PRESS_SECONDS = 0.1  # how long the jump button is down

_NUMBER = r"[-+]?\d{1,9}(?:\.\d{0,9})?"
_FORM = re.compile(
    rf"(?P<gait>[a-z]+)(?:@(?P<heading>{_NUMBER}))?(?:\*(?P<amount>{_NUMBER}))?(?:>(?P<facing>{_NUMBER}))?"
    rf"\s+(?P<seconds>{_NUMBER})",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class StickSegment:
    """A position of the stick: degrees, share of the full stick, degrees or None, seconds."""

    gait: Gait
    seconds: float
    heading: float = 0.0
    amount: float = 1.0
    facing: float | None = None

    def __str__(self) -> str:
        text = self.gait.label
        text += f"@{_plain(self.heading)}" if self.heading else ""
        text += f"*{_plain(self.amount)}" if self.amount != 1.0 else ""
        text += "" if self.facing is None else f">{_plain(self.facing)}"
        return f"{text} {_plain(self.seconds)}"

    @property
    def controls(self) -> Controls:
        """What the stick asks for."""
        if self.gait in (Gait.STAND, Gait.JUMP):
            return Controls()
        facing = None if self.facing is None else _direction(self.facing)
        x, z = _direction(self.heading)
        return Controls((self.amount * x, self.amount * z), facing, self.gait)


@dataclass(frozen=True)
class StickScript:
    """Segments in order; called with seconds since the start (and the place, which it ignores) it is a `ControlScript`."""

    segments: tuple[StickSegment, ...]

    def __str__(self) -> str:
        return "; ".join(map(str, self.segments))

    @property
    def seconds(self) -> float:
        """The length of all segments."""
        return sum(segment.seconds for segment in self.segments)

    def __call__(self, time: float, _place: PlanarPose | None = None) -> Controls:
        """The stick at `time`; at rest after the end."""
        ends = accumulate(segment.seconds for segment in self.segments)
        controls, start = Controls(), 0.0
        for segment, end in zip(self.segments, ends, strict=True):
            if segment.gait != Gait.JUMP:
                controls = segment.controls
            if time < end - 1e-9:
                pressed = segment.gait == Gait.JUMP and time - start < PRESS_SECONDS - 1e-9
                return Controls(controls.move, controls.facing, Gait.JUMP) if pressed else controls
            start = end
        return Controls()


def parse_stick(text: str) -> StickScript:
    """Read a script of the form above; UsageError names the segment that cannot be read and why."""
    if len(text) > MAX_CHARACTERS:
        raise _error(f"{len(text)} characters; expected at most {MAX_CHARACTERS}")
    segments = tuple(_segment(part.strip()) for part in text.split(";") if part.strip())
    if not segments:
        raise _error("no segment")
    return StickScript(segments)


def _segment(text: str) -> StickSegment:
    found = _FORM.fullmatch(text)
    if found is None:
        raise _error(f"'{text[:60]}' is not GAIT[@HEADING][*AMOUNT][>FACING] SECONDS")
    name = found["gait"].lower()
    if name not in GAITS:
        raise _error(f"'{text[:60]}': no gait '{name[:20]}'; expected {', '.join(GAITS)}")
    seconds, amount = float(found["seconds"]), float(found["amount"] or 1.0)
    if not 0.0 < seconds <= MAX_SECONDS:
        raise _error(f"'{text[:60]}': {seconds:g} seconds; expected more than 0 and at most {MAX_SECONDS:g}")
    if not 0.0 <= amount <= 1.0:
        raise _error(f"'{text[:60]}': amount {amount:g}; expected 0 to 1")
    if GAITS[name] in (Gait.STAND, Gait.JUMP) and (found["heading"] or found["amount"] or found["facing"]):
        raise _error(f"'{text[:60]}': {name} takes seconds only, its stick is at rest or as before")
    facing = None if found["facing"] is None else float(found["facing"])
    return StickSegment(GAITS[name], seconds, float(found["heading"] or 0.0), amount, facing)


def _error(problem: str) -> UsageError:
    return UsageError(f": {problem}.", f'Write "{EXAMPLE}".', "controls")


def _direction(degrees: float) -> tuple[float, float]:
    return sin(radians(degrees)), cos(radians(degrees))


def _plain(number: float) -> str:
    return f"{number:.9f}".rstrip("0").rstrip(".")
