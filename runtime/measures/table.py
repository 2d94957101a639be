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

from runtime.arrays import Array
from runtime.measures.signals import (
    AHEAD,
    LEFT,
    MOVING_M_PER_S,
    Clip,
    Part,
    Reader,
    along,
    arch,
    bend,
    bounce,
    cadence,
    cycle_roll,
    cycle_yaw,
    foot_out,
    frequency,
    halting,
    hand_level,
    landing,
    stance_lead,
    standing,
    step_length,
    sway,
    thigh_lift,
    tilt,
    turned_aside,
    turned_down,
    twist,
    walk_ratio,
    wander,
)  # fmt: skip
from runtime.skeleton import PART_NAMES

Statistic = Callable[[Any], float]
X, Z = 0, 2  # to the left, ahead
_SIDES = {"left": ("Left", 1.0), "right": ("Right", -1.0)}


def median(x: Array) -> float:
    """The middle value."""
    return float(np.median(x))


def percentile(percent: float) -> Statistic:
    """The value that so many percent of the frames are under."""
    return lambda x: float(np.percentile(x, percent))


def between(low: float, high: float) -> Statistic:
    """From one percentile to another."""
    return lambda x: float(np.subtract(*np.percentile(x, [high, low])))


top, peak, travel, span = percentile(90), percentile(95), between(10, 90), between(5, 95)


@dataclass(frozen=True)
class Measure:
    """A row: `read` gives a value in every frame, `over` makes one of them; of what is one value already it is `float`.

    `step` is what counts as one step of change where a sentence is judged by walks, None where nothing of it counts. `sided`
    measures change their sign in the mirror image.
    """

    part: str  # arm, leg, torso or head
    name: str
    unit: str
    read: Reader
    over: Statistic
    step: float | None = None
    sided: bool = False

    @property
    def moves(self) -> bool:
        """Whether it is of a movement, and not of a posture."""
        return self.over in (travel, span)


MEASURES = (
    Measure("arm", "hand_level", "heights of the trunk", hand_level, median, 0.4),
    Measure("arm", "hand_level_top", "heights of the trunk", hand_level, top),
    Measure("arm", "hand_level_range", "heights of the trunk", hand_level, travel, 0.4),
    Measure("arm", "hand_out", "m from the shoulder", along("Arm", "Hand", X, outward=True), median, 0.15),
    Measure("arm", "hand_front", "m from the shoulder", along("Arm", "Hand", Z), median, 0.2),
    Measure("arm", "elbow_bend", "degrees", bend("Arm", "ForeArm", "Hand"), median, 35.0),
    Measure("arm", "elbow_range", "degrees", bend("Arm", "ForeArm", "Hand"), travel),
    Measure("arm", "elbow_out", "m from the shoulder", along("Arm", "ForeArm", X, outward=True), median),
    Measure("arm", "swing", "m, of the hand", along("Arm", "Hand", Z), travel, 0.2),
    Measure("arm", "side_swing", "m, of the hand", along("Arm", "Hand", X), travel, 0.15),
    Measure("arm", "frequency", "Hz", frequency, float),
    Measure("leg", "knee_bend", "degrees, standing", standing(bend("UpLeg", "Leg", "Foot")), median, 15.0),
    Measure("leg", "knee_bend_top", "degrees", bend("UpLeg", "Leg", "Foot"), peak, 15.0),
    Measure("leg", "thigh_lift", "degrees from vertical", thigh_lift, peak),
    Measure("leg", "foot_lift", "m, of the ankle", lambda leg: leg.foot[:, 1], span, 0.08),
    Measure("leg", "step_length", "m", step_length, float, 0.2),
    Measure("leg", "cadence", "steps per second of both feet", cadence, float, 0.5),
    Measure("leg", "speed", "m/s of the root", lambda leg: leg.clip.speed, median),
    Measure("leg", "width", "m from the hips' middle", standing(foot_out), median, 0.07),
    Measure("leg", "toe_out", "degrees, standing", standing(turned_aside("Foot", outward=True)), median, 15.0),
    Measure("leg", "moving", "of the frames", lambda leg: leg.clip.speed > MOVING_M_PER_S, lambda x: float(x.mean())),
    Measure("leg", "foot_pitch", "degrees that the heel is up", standing(turned_down("Foot", AHEAD)), median, 15.0),
    Measure("leg", "walk_ratio", "m over steps per second", walk_ratio, float, 0.15),
    Measure("leg", "stance_lead", "of the time on one foot", stance_lead, float, 0.4),
    Measure("leg", "landing", "m/s", landing, float, 0.3),
    Measure("leg", "halting", "of the speed", halting, float, 0.2),
    Measure("torso", "pitch", "degrees forward", tilt("Hips", "Neck", Z), median, 12.0),
    Measure("torso", "pitch_range", "degrees", tilt("Hips", "Neck", Z), travel, 10.0),
    Measure("torso", "roll", "degrees to the left", tilt("Hips", "Neck", X), median, 8.0, sided=True),
    Measure("torso", "roll_range", "degrees", tilt("Hips", "Neck", X), travel, 8.0),
    Measure("torso", "twist_range", "degrees", twist, travel, 12.0),
    Measure("torso", "bounce", "m", bounce, travel, 0.04),
    Measure("torso", "sway", "m", sway, travel, 0.06),
    Measure("torso", "arch", "degrees", arch, median, 8.0),
    Measure("torso", "pelvis_yaw_range", "degrees", cycle_yaw("UpLeg"), travel, 12.0),
    Measure("torso", "pelvis_roll_range", "degrees", cycle_roll("UpLeg"), travel),
    Measure("torso", "shoulder_yaw_range", "degrees", cycle_yaw("Arm"), travel, 10.0),
    Measure("torso", "shoulder_roll_range", "degrees", cycle_roll("Arm"), travel, 8.0),
    Measure("torso", "wander", "m", wander, travel, 0.15),
    Measure("head", "pitch", "degrees that it looks down", turned_down("Head", AHEAD), median, 12.0),
    Measure("head", "forward", "m from the neck's base", along("Neck", "Head", Z), median, 0.04),
    Measure("head", "roll", "degrees to the left", turned_down("Head", LEFT), median, 8.0, sided=True),
    Measure("head", "roll_range", "degrees", turned_down("Head", LEFT), travel, 8.0),
    Measure("head", "pitch_range", "degrees", turned_down("Head", AHEAD), travel, 10.0),
    Measure("head", "turn_range", "degrees", turned_aside("Head"), travel, 15.0),
    Measure("head", "bob", "m", along("Neck", "Head", Z), travel),
    Measure("head", "turn", "degrees to the left", turned_aside("Head"), median, 20.0, sided=True),
)  # fmt: skip


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
