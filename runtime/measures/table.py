"""The table of body measures: names, units, how each is computed from a motion, and which ones body edits add.

A new measure is a row here and, for a new signal, a function in `runtime.measures.signals`. Its rows are named by captions
and claims (`training/text/words.toml`), edits of training data (`training/augmentation/edits.toml`), the measures that networks
learn from codes (rows in their order: append new ones of a part) and the edits of the shown pose (`runtime.edits`).
Usual values in captured clips, by gait and style: `runtime.prompts.captured`, measured by `training.text.phrase_measures`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.measures import signals as read
from runtime.measures.signals import AHEAD, LEFT, Clip, Part, Reader
from runtime.skeleton import PART_NAMES

Statistic = Callable[[Any], float]
X, Z = 0, 2  # left, ahead
_SIDES = {"left": ("Left", 1.0), "right": ("Right", -1.0)}


def median(x: Array) -> float:
    """Return the median."""
    return float(np.median(x))


def percentile(percent: float) -> Statistic:
    """Return a statistic: the given percentile over the frames."""
    return lambda x: float(np.percentile(x, percent))


def between(low: float, high: float) -> Statistic:
    """Return a statistic: the difference between two percentiles."""
    return lambda x: float(np.subtract(*np.percentile(x, [high, low])))


top, peak, travel, span = percentile(90), percentile(95), between(10, 90), between(5, 95)


@dataclass(frozen=True)
class Measure:
    """A row of the measure table: `read` gives a value per frame, `over` reduces them to one (`float` if there is only one).

    `step` is the smallest change that counts when a sentence is judged by walks, None if none counts. `sided` measures
    change sign in the mirror image.
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
        """Whether it measures a movement rather than a posture."""
        return self.over in (travel, span)


MEASURES = (
    Measure("arm", "hand_level", "heights of the trunk", read.hand_level, median, 0.4),
    Measure("arm", "hand_level_top", "heights of the trunk", read.hand_level, top),
    Measure("arm", "hand_level_range", "heights of the trunk", read.hand_level, travel, 0.4),
    Measure("arm", "hand_out", "m from the shoulder", read.along("Arm", "Hand", X, outward=True), median, 0.15),
    Measure("arm", "hand_front", "m from the shoulder", read.along("Arm", "Hand", Z), median, 0.2),
    Measure("arm", "elbow_bend", "degrees", read.bend("Arm", "ForeArm", "Hand"), median, 35.0),
    Measure("arm", "elbow_range", "degrees", read.bend("Arm", "ForeArm", "Hand"), travel),
    Measure("arm", "elbow_out", "m from the shoulder", read.along("Arm", "ForeArm", X, outward=True), median),
    Measure("arm", "swing", "m, of the hand", read.along("Arm", "Hand", Z), travel, 0.2),
    Measure("arm", "side_swing", "m, of the hand", read.along("Arm", "Hand", X), travel, 0.15),
    Measure("arm", "frequency", "Hz", read.frequency, float),
    Measure("leg", "knee_bend", "degrees, standing", read.standing(read.bend("UpLeg", "Leg", "Foot")), median, 15.0),
    Measure("leg", "knee_bend_top", "degrees", read.bend("UpLeg", "Leg", "Foot"), peak, 15.0),
    Measure("leg", "thigh_lift", "degrees from vertical", read.thigh_lift, peak),
    Measure("leg", "foot_lift", "m, of the ankle", lambda leg: leg.foot[:, 1], span, 0.08),
    Measure("leg", "step_length", "m", read.step_length, float, 0.2),
    Measure("leg", "cadence", "steps per second of both feet", read.cadence, float, 0.5),
    Measure("leg", "speed", "m/s of the root", lambda leg: leg.clip.speed, median),
    Measure("leg", "width", "m from the hips' middle", read.standing(read.foot_out), median, 0.07),
    Measure("leg", "toe_out", "degrees, standing", read.standing(read.turned_aside("Foot", outward=True)), median, 15.0),
    Measure("leg", "moving", "of the frames", lambda leg: leg.clip.speed > read.MOVING_M_PER_S, lambda x: float(x.mean())),
    Measure("leg", "foot_pitch", "degrees that the heel is up", read.standing(read.turned_down("Foot", AHEAD)), median, 15.0),
    Measure("leg", "walk_ratio", "m over steps per second", read.walk_ratio, float, 0.15),
    Measure("leg", "stance_lead", "of the time on one foot", read.stance_lead, float, 0.4),
    Measure("leg", "landing", "m/s", read.landing, float, 0.3),
    Measure("leg", "halting", "of the speed", read.halting, float, 0.2),
    Measure("torso", "pitch", "degrees forward", read.tilt("Hips", "Neck", Z), median, 12.0),
    Measure("torso", "pitch_range", "degrees", read.tilt("Hips", "Neck", Z), travel, 10.0),
    Measure("torso", "roll", "degrees to the left", read.tilt("Hips", "Neck", X), median, 8.0, sided=True),
    Measure("torso", "roll_range", "degrees", read.tilt("Hips", "Neck", X), travel, 8.0),
    Measure("torso", "twist_range", "degrees", read.twist, travel, 12.0),
    Measure("torso", "bounce", "m", read.bounce, travel, 0.04),
    Measure("torso", "sway", "m", read.sway, travel, 0.06),
    Measure("torso", "arch", "degrees", read.arch, median, 8.0),
    Measure("torso", "pelvis_yaw_range", "degrees", read.cycle_yaw("UpLeg"), travel, 12.0),
    Measure("torso", "pelvis_roll_range", "degrees", read.cycle_roll("UpLeg"), travel),
    Measure("torso", "shoulder_yaw_range", "degrees", read.cycle_yaw("Arm"), travel, 10.0),
    Measure("torso", "shoulder_roll_range", "degrees", read.cycle_roll("Arm"), travel, 8.0),
    Measure("torso", "wander", "m", read.wander, travel, 0.15),
    Measure("head", "pitch", "degrees that it looks down", read.turned_down("Head", AHEAD), median, 12.0),
    Measure("head", "forward", "m from the neck's base", read.along("Neck", "Head", Z), median, 0.04),
    Measure("head", "roll", "degrees to the left", read.turned_down("Head", LEFT), median, 8.0, sided=True),
    Measure("head", "roll_range", "degrees", read.turned_down("Head", LEFT), travel, 8.0),
    Measure("head", "pitch_range", "degrees", read.turned_down("Head", AHEAD), travel, 10.0),
    Measure("head", "turn_range", "degrees", read.turned_aside("Head"), travel, 15.0),
    Measure("head", "bob", "m", read.along("Neck", "Head", Z), travel),
    Measure("head", "turn", "degrees to the left", read.turned_aside("Head"), median, 20.0, sided=True),
)  # fmt: skip


@dataclass(frozen=True)
class Target:
    """A quantity of a body part that a prompt can ask for, and that body edits add if it is missing.

    `measure` is its row of the measures, or "". `shown` reads it from the state of `runtime.edits.body.BodyEdits`, for
    the left (0) or right (1) side. At most `most` is added, in the unit, or as a factor of the network's own swing. A
    capture that is `far` outside a phrase's range does not show it, and its caption says so.
    """

    part: str
    name: str
    unit: str
    measure: str = ""
    shown: Callable[[Any, int], float] | None = None
    most: float = 0.0
    far: float = 0.0


def _beside(edits: Any, side: int) -> float:
    """Distance (metres) of a foot from the centre line."""
    middle: float = (1 - 2 * side) * edits.legs.middle
    return float((0.5 * edits.legs.across + middle) / max(edits.legs.known, 1e-6))


# in the column order of `runtime.edits.request`, which files depend on
TARGETS = (
    Target("leg", "outward", "m of a foot from the middle line", "width", _beside, 0.3, 0.05),
    Target("leg", "lower", "m that the hips are lowered", "", lambda e, _: e.legs.lowered, 0.4, 0.06),
    Target("leg", "pitch", "degrees of the heel over the toe of a planted foot", "foot_pitch", lambda e, k: e.legs.pitch[k], 50.0, 15.0),
    Target("leg", "toe_out", "degrees that the foot is turned out", "toe_out", lambda e, k: e.legs.yaw[k], 50.0, 15.0),
    Target("leg", "knee", "degrees that it bends", "knee_bend_top", lambda e, k: e.legs.bend[k], 90.0, 20.0),
    Target("leg", "lift", "m that the ankle rises in its swing", "foot_lift", lambda e, k: e.legs.lift[k], 1.0, 0.04),
    Target("leg", "pace", "of a neutral walk's speed", "speed", far=0.25),
    Target("torso", "lean", "degrees forward", "pitch", lambda e, _: e.trunk.lean.middle, 25.0, 8.0),
    Target("torso", "aside", "degrees to the left", "roll", lambda e, _: e.trunk.aside.middle, 20.0, 6.0),
    Target("torso", "twist", "degrees of the shoulders to the left of the hips", "", lambda e, _: e.trunk.twist.middle, 40.0, 15.0),
    Target("torso", "sway", "m of the hips from end to end", "sway", lambda e, _: e.trunk.sway.range, 2.5, 0.05),
    Target("torso", "rock", "degrees from end to end", "roll_range", lambda e, _: e.trunk.aside.range, 2.5, 5.0),
    Target("torso", "bounce", "m that hips rise and fall", "bounce", lambda e, _: e.trunk.bounce.range, 2.5, 0.03),
    Target("torso", "fold", "degrees from upright that it leans forward at any moment"),
    Target("torso", "shrug", "degrees that shoulders are raised", most=30.0),
    Target("arm", "elbow", "degrees that it bends", "elbow_bend", lambda e, k: e.arms[k].bend.middle, 110.0, 25.0),
    Target("arm", "elbow_out", "m outward of the shoulder, added by degrees", "elbow_out", lambda e, k: e.arms[k].out.middle, 60.0, 0.07),
    Target("arm", "swing", "m of the hand from end to end", "swing", lambda e, k: e.arms[k].swing.range, 2.5, 0.15),
)  # fmt: skip


class PartMeasures(SimpleNamespace):
    """Measures of one body part, by row name."""

    def changed(self, **values: float) -> PartMeasures:
        """Return a copy of the measures with some values replaced."""
        return PartMeasures(**vars(self) | values)


@dataclass(frozen=True)
class BodyMeasures:
    """Measures of a whole motion, or the mean of several."""

    left_arm: PartMeasures
    right_arm: PartMeasures
    left_leg: PartMeasures
    right_leg: PartMeasures
    torso: PartMeasures
    head: PartMeasures


def kind_of(part: str) -> str:
    """Return the kind of a part: "leg" for "left_leg"."""
    return part.split("_")[-1]


@cache
def targets_of(part: str) -> dict[str, Target]:
    """Return the targets that a prompt can ask of a part such as "left_arm", by name."""
    return {row.name: row for row in TARGETS if row.part == kind_of(part)}


@cache
def measures_of(part: str) -> dict[str, Measure]:
    """Return the measures of a part such as "left_arm" by name, in table order."""
    return {row.name: row for row in MEASURES if row.part == kind_of(part)}


def measure(hips: Array, local: Array, contacts: Array) -> BodyMeasures:
    """Return the measures of a motion: hips `(T, 3)`, local rotations `(T, 31, 4)`, contacts `(T, 4)` heel and toe, left first."""
    clip, found = Clip(hips, local, contacts), {}
    for name in PART_NAMES:
        part = Part(clip, *_SIDES.get(name.split("_")[0], ("", 1.0)))
        found[name] = PartMeasures(**{n: row.over(row.read(part)) for n, row in measures_of(name).items()})
    return BodyMeasures(**found)
