"""The one table of what a body is measured by: names, units, how each is read off a motion, and what edits add of it.

A new measure is a row here and, where it reads something new, a function of `runtime.measures.signals`. Captions and claims
(`training/text/words.toml`), edits of training data (`training/augmentation/edits.toml`), what networks learn to read off codes
(rows in their order: append a part's new ones) and the edits of the shown pose (`runtime.edits`) name its rows.
What is usual in captured clips, by gait and style: `runtime.prompts.captured`, measured by `training.text.phrase_measures`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from runtime.arrays import Array, Flags
from runtime.measures import signals
from runtime.measures.signals import Clip, Part
from runtime.skeleton import PART_NAMES

_SIDES = {"left": ("Left", 1.0), "right": ("Right", -1.0)}


def median(x: Array) -> float:
    """The middle value."""
    return float(np.median(x))


def top(x: Array) -> float:
    """The 90th percentile."""
    return float(np.percentile(x, 90))


def peak(x: Array) -> float:
    """The 95th percentile."""
    return float(np.percentile(x, 95))


def travel(x: Array) -> float:
    """From the 10th to the 90th percentile."""
    low, high = np.percentile(x, [10, 90])
    return float(high - low)


def span(x: Array) -> float:
    """From the 5th to the 95th percentile."""
    return float(np.percentile(x, 95) - np.percentile(x, 5))


def fraction(x: Flags) -> float:
    """Of the frames."""
    return float(x.mean())


@dataclass(frozen=True)
class Measure:
    """A row: `read` gives a value in every frame, `over` makes one of them; of what is one value already it is `float`.

    `step` is what counts as one step of change where a sentence is judged by walks, None where nothing of it counts. `sided`
    measures change their sign in the mirror image.
    """

    part: str  # arm, leg, torso or head
    name: str
    unit: str
    read: Callable[[Part], Any]
    over: Callable[[Any], float]
    step: float | None = None
    sided: bool = False

    @property
    def moves(self) -> bool:
        """Whether it is of a movement, and not of a posture."""
        return self.over in (travel, span)


MEASURES = (
    Measure("arm", "hand_level", "heights of the trunk", signals.hand_level, median, 0.4),
    Measure("arm", "hand_level_top", "heights of the trunk", signals.hand_level, top),
    Measure("arm", "hand_level_range", "heights of the trunk", signals.hand_level, travel, 0.4),
    Measure("arm", "hand_out", "m", signals.hand_out, median, 0.15),
    Measure("arm", "hand_front", "m", signals.hand_front, median, 0.2),
    Measure("arm", "elbow_bend", "degrees", signals.elbow_bend, median, 35.0),
    Measure("arm", "elbow_range", "degrees", signals.elbow_bend, travel),
    Measure("arm", "elbow_out", "m", signals.elbow_out, median),
    Measure("arm", "swing", "m", signals.hand_front, travel, 0.2),
    Measure("arm", "side_swing", "m", signals.hand_aside, travel, 0.15),
    Measure("arm", "frequency", "Hz", signals.frequency, float),
    Measure("leg", "knee_bend", "degrees", signals.standing_knee_bend, median, 15.0),
    Measure("leg", "knee_bend_top", "degrees", signals.knee_bend, peak, 15.0),
    Measure("leg", "thigh_lift", "degrees", signals.thigh_lift, peak),
    Measure("leg", "foot_lift", "m", signals.ankle_height, span, 0.08),
    Measure("leg", "step_length", "m", signals.step_length, float, 0.2),
    Measure("leg", "cadence", "Hz", signals.cadence, float, 0.5),
    Measure("leg", "speed", "m/s", signals.root_speed, median),
    Measure("leg", "width", "m", signals.foot_out, median, 0.07),
    Measure("leg", "toe_out", "degrees", signals.toe_out, median, 15.0),
    Measure("leg", "moving", "of the frames", signals.moving, fraction),
    Measure("leg", "foot_pitch", "degrees", signals.foot_pitch, median, 15.0),
    Measure("leg", "walk_ratio", "m/Hz", signals.walk_ratio, float, 0.15),
    Measure("leg", "stance_lead", "of the time on one foot", signals.stance_lead, float, 0.4),
    Measure("leg", "landing", "m/s", signals.landing, float, 0.3),
    Measure("leg", "halting", "of the speed", signals.halting, float, 0.2),
    Measure("torso", "pitch", "degrees", signals.lean, median, 12.0),
    Measure("torso", "pitch_range", "degrees", signals.lean, travel, 10.0),
    Measure("torso", "roll", "degrees", signals.lean_aside, median, 8.0, sided=True),
    Measure("torso", "roll_range", "degrees", signals.lean_aside, travel, 8.0),
    Measure("torso", "twist_range", "degrees", signals.twist, travel, 12.0),
    Measure("torso", "bounce", "m", signals.rise, travel, 0.04),
    Measure("torso", "sway", "m", signals.sway, travel, 0.06),
    Measure("torso", "arch", "degrees", signals.arch, median, 8.0),
    Measure("torso", "pelvis_yaw_range", "degrees", signals.pelvis_yaw, travel, 12.0),
    Measure("torso", "pelvis_roll_range", "degrees", signals.pelvis_roll, travel),
    Measure("torso", "shoulder_yaw_range", "degrees", signals.shoulder_yaw, travel, 10.0),
    Measure("torso", "shoulder_roll_range", "degrees", signals.shoulder_roll, travel, 8.0),
    Measure("torso", "wander", "m", signals.wander, travel, 0.15),
    Measure("head", "pitch", "degrees", signals.gaze_down, median, 12.0),
    Measure("head", "forward", "m", signals.head_forward, median, 0.04),
    Measure("head", "roll", "degrees", signals.head_tilt, median, 8.0, sided=True),
    Measure("head", "roll_range", "degrees", signals.head_tilt, travel, 8.0),
    Measure("head", "pitch_range", "degrees", signals.gaze_down, travel, 10.0),
    Measure("head", "turn_range", "degrees", signals.gaze_left, travel, 15.0),
    Measure("head", "bob", "m", signals.head_forward, travel),
    Measure("head", "turn", "degrees", signals.gaze_left, median, 20.0, sided=True),
)


class PartMeasures(SimpleNamespace):
    """Measures of one part, by the names of its rows."""

    def changed(self, **values: float) -> PartMeasures:
        """The same with other values."""
        return PartMeasures(**vars(self) | values)


@dataclass(frozen=True)
class BodyMeasures:
    """A whole motion, or the average of several."""

    left_arm: PartMeasures
    right_arm: PartMeasures
    left_leg: PartMeasures
    right_leg: PartMeasures
    torso: PartMeasures
    head: PartMeasures


def kind_of(part: str) -> str:
    """The kind of a part: "leg" of "left_leg"."""
    return part.split("_")[-1]


@cache
def measures_of(part: str) -> dict[str, Measure]:
    """The rows of a part such as "left_arm" by name, in their order."""
    return {row.name: row for row in MEASURES if row.part == kind_of(part)}


def measure(hips: Array, local: Array, contacts: Array) -> BodyMeasures:
    """Measures of a motion: hips `(T, 3)`, local rotations `(T, 31, 4)`, contacts `(T, 4)` heel and toe, left first."""
    clip, found = Clip(hips, local, contacts), {}
    for name in PART_NAMES:
        part = Part(clip, *_SIDES.get(name.split("_")[0], ("", 1.0)))
        found[name] = PartMeasures(**{n: row.over(row.read(part)) for n, row in measures_of(name).items()})
    return BodyMeasures(**found)
