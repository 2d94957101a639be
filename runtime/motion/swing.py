"""Amplitude correction of the walk's swings: pelvis, shoulders, arms and the hips' height.

A network damps the motion that varies most between the walks of a style. The damping is measured once per model and read from
Z^t (`training.export.swings`). The shown pose is the network's with every swing about its running mean scaled; the network
is fed its own pose. Feet stay in place, and the hips rise and fall so that the supporting legs keep their length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import asin, atan2, copysign, radians
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.errors import ModelError
from runtime.feet.foot_lock import carrying_rise
from runtime.feet.leg import LegPose, leg_base, leg_bones, leg_forward, leg_inverse
from runtime.feet.reach import span
from runtime.scalar_math import (
    MIN_DIVISOR,
    Quaternion,
    Vector,
    add,
    decay,
    from_vector,
    length,
    multiply,
    relative,
    rotate,
    scale,
    subtract,
    to_vector,
)
from runtime.skeleton import PART_NAMES, SPORT_SKELETON

# swings with a gain: turns of the pelvis about the vertical and about the direction of travel, of the shoulders about the
# vertical, of the upper arms, and the height of the hips
SWINGS = ("pelvis_yaw", "pelvis_roll", "shoulder_yaw", "arms", "bob")
YAW, ROLL, SHOULDERS, ARMS, BOB = range(len(SWINGS))
PLAIN = (1.0,) * len(SWINGS)
MIN_GAIN, MAX_GAIN = 0.5, 2.5
MAX_ADDED_SWINGS = (radians(9.0), radians(6.0), radians(12.0), radians(30.0), 0.04)  # rad, m: limits
# body parts whose descriptions determine each swing: an arm's description leaves the pelvis alone
_LEGS_TRUNK, _ARMS_TRUNK = (
    [PART_NAMES.index(part) for part in (*limbs, "torso")]
    for limbs in (("left_leg", "right_leg"), ("left_arm", "right_arm"))
)
_TOLD_BY = (_LEGS_TRUNK, _LEGS_TRUNK, _ARMS_TRUNK, _ARMS_TRUNK, _LEGS_TRUNK)
# root mean square of a code's distance at which a style is hardly informative: its own sentences lie within twice that
KNOWN_STYLE_CODE_DISTANCE = 0.2
UNKNOWN_STYLE_WEIGHT = 0.01  # weight of the default gain 1, relative to that of a style at its own code
CAPTURED_GAIN_FRACTION = 0.1  # difference of a gain from 1 up to which a style counts as captured
UNSEEN_GAIN_FRACTION = 0.03  # difference of a gain from 1 below which it is ignored
MIN_SHARE_FRACTION = 1e-3  # smaller weights count as zero
MEAN_HALF_LIFE_S = 0.8  # of the running means of the pose
_SEEN = 1.0 - decay(MEAN_HALF_LIFE_S)
# half-lives, of the gains when a walk begins and when it ends
SET_IN_HALF_LIFE_S, LEAVE_HALF_LIFE_S = 0.5, 0.12
_SPINE = tuple(SPORT_SKELETON.index(name) for name in ("LowerBack", "Spine", "Spine1"))
_NECK = SPORT_SKELETON.index("Neck")
_SHOULDERS = (SPORT_SKELETON.index("LeftShoulder"), SPORT_SKELETON.index("RightShoulder"))
_UPPER_ARMS = (SPORT_SKELETON.index("LeftArm"), SPORT_SKELETON.index("RightArm"))
_LEGS = (leg_bones(0), leg_bones(1))
_SHOULDER_OFFSETS: list[tuple[Vector, Vector]] = [
    (tuple(SPORT_SKELETON.offsets[base].tolist()), tuple(SPORT_SKELETON.offsets[arm].tolist()))
    for base, arm in zip(_SHOULDERS, _UPPER_ARMS, strict=True)
]
_SIDE: Vector = (1.0, 0.0, 0.0)
_MEANS = 4 + 4 * len(_UPPER_ARMS)


@dataclass(frozen=True, eq=False)
class MeasuredSwings:
    """Codes `(n, 6, 64)` of captured styles, with the gains `(n, 5)` that restore the captured amplitude of their swings."""

    codes: Array
    gains: Array

    def of(self, z: Array) -> tuple[float, ...]:
        """Return the swing gains for Z^t `(6, 64)` from the nearest measured styles; 1 if all are far away."""
        away = ((self.codes - z) ** 2).mean(-1)
        near = np.stack(
            [np.exp(-0.5 * away[:, parts].mean(1) / KNOWN_STYLE_CODE_DISTANCE**2) for parts in _TOLD_BY]
        )
        logarithms = (near * np.log(self.gains.T)).sum(1) / (near.sum(1) + UNKNOWN_STYLE_WEIGHT)
        return tuple(np.exp(logarithms).tolist())

    @staticmethod
    def read(folder: Path, metadata: dict[str, Any], shape: tuple[int, int]) -> MeasuredSwings | None:
        """Read the gains from a model's metadata; None if it has none. Raises ModelError if they are invalid."""
        section = metadata.get("swings")
        if section is None:
            return None
        try:
            codes = np.array([style["code"].split() for style in section], np.float32).reshape(-1, *shape)
            gains = np.array([style["gains"] for style in section], np.float64).reshape(-1, len(SWINGS))
            within = np.isfinite(codes).all() and (gains >= MIN_GAIN).all() and (gains <= MAX_GAIN).all()
            fits = bool(within) and len(codes) == len(gains)
        except (AttributeError, TypeError, KeyError, ValueError, OverflowError):
            fits = False
        if not fits:
            raise ModelError(
                f"{folder / 'metadata.json'}: field 'swings' has no codes {shape} with gains of {', '.join(SWINGS)}.",
                "Export the model again.",
            )
        return MeasuredSwings(codes, gains)


def composed_fraction(gains: Sequence[float]) -> float:
    """Return how unlike a captured walk these swing gains are: 0 for a captured style, up to 1."""
    gained = max(abs(gains[swing] - 1.0) for swing in (YAW, ROLL, BOB))
    return 1.0 - min(gained / CAPTURED_GAIN_FRACTION, 1.0)


@dataclass
class Swings:
    """Running means of N characters: three angles (radians) and a height (metres), then a quaternion for each upper arm."""

    means: Array = field(default_factory=lambda: np.zeros((1, _MEANS)), metadata={"shape": (_MEANS,)})
    share: Array = field(default_factory=lambda: np.zeros(1), metadata={"shape": (), "most": 1.0})

    def apply(
        self,
        hips: Array,
        local: Array,
        contacts: Array,
        gains: Sequence[tuple[float, ...]],
        walking: Sequence[bool],
    ) -> tuple[Array, Array]:
        """Scale the swings of a walk; returns hips `(N, 3)` and local rotations `(N, 31, 4)`, relative to the root.

        `contacts` is `(N, 4)`; `gains` of `SWINGS` and `walking` have one entry per character.
        """
        shares, hips, local = self.share.tolist(), hips.copy(), local.copy()
        self.means = self.means.copy()
        for i, (own, walks) in enumerate(zip(gains, walking, strict=True)):
            walks = walks and any(abs(gain - 1.0) > UNSEEN_GAIN_FRACTION for gain in own)
            if not walks and shares[i] < MIN_SHARE_FRACTION:
                shares[i] = 0.0
                continue
            at, rotations = hips[i].tolist(), local[i].tolist()
            now = _measured(at[1], rotations)
            means = self.means[i].tolist() if shares[i] > 0.0 else now  # starts from the current pose
            kept = decay(SET_IN_HALF_LIFE_S if walks else LEAVE_HALF_LIFE_S)
            shares[i] += (1.0 - kept) * (walks - shares[i])
            more = [shares[i] * (gain - 1.0) for gain in own]
            self.means[i] = means = _followed(means, now)
            rise, turned = _swung(at, rotations, contacts[i].tolist(), more, now, means)
            hips[i, 1] += rise
            local[i, list(turned)] = list(turned.values())
        self.share = np.array(shares)
        return hips, local


def _measured(height: float, rotations: list[Quaternion]) -> list[float]:
    chest = pelvis = rotations[0]
    for joint in _SPINE:
        chest = multiply(chest, rotations[joint])
    left, right = (
        add(base, rotate(rotations[joint], arm))
        for joint, (base, arm) in zip(_SHOULDERS, _SHOULDER_OFFSETS, strict=True)
    )
    hip_line, shoulder_line = rotate(pelvis, _SIDE), rotate(chest, subtract(left, right))
    arms = [value for joint in _UPPER_ARMS for value in rotations[joint]]
    roll = asin(min(max(hip_line[1], -1.0), 1.0))
    return [_yaw(hip_line), roll, _yaw(shoulder_line), height, *arms]


def _followed(means: list[float], now: list[float]) -> list[float]:
    """Return running means updated towards the current pose; handles both signs of a quaternion."""
    result = [mean + _SEEN * (value - mean) for mean, value in zip(means[:4], now[:4], strict=True)]
    for k in range(4, _MEANS, 4):
        (a, b, c, d), (w, x, y, z) = means[k : k + 4], now[k : k + 4]
        sign = 1.0 if a * w + b * x + c * y + d * z >= 0.0 else -1.0
        w, x = a + _SEEN * (sign * w - a), b + _SEEN * (sign * x - b)
        y, z = c + _SEEN * (sign * y - c), d + _SEEN * (sign * z - d)
        size = (w * w + x * x + y * y + z * z) ** 0.5
        result += [w / size, x / size, y / size, z / size]
    return result


def _swung(
    hips: Vector,
    local: list[Quaternion],
    contacts: list[float],
    more: list[float],
    now: list[float],
    means: list[float],
) -> tuple[float, dict[int, Quaternion]]:
    """Return the hips' rise (metres) and the local rotations of turned joints; `more` are the added fractions of each swing."""
    yaw, roll, turn, rise = (
        min(max(more[k] * (now[at] - means[at]), -MAX_ADDED_SWINGS[k]), MAX_ADDED_SWINGS[k])
        for at, k in enumerate((YAW, ROLL, SHOULDERS, BOB))
    )
    pelvis = multiply(from_vector((0.0, yaw, roll)), local[0])
    turned = {0: pelvis, **_turned_spine(local, pelvis, (yaw, roll, turn))}
    for k, joint in enumerate(_UPPER_ARMS, 1):
        w, x, y, z = means[4 * k : 4 * k + 4]
        swing = to_vector(multiply(local[joint], (w, -x, -y, -z)))
        size = min(abs(more[ARMS]), MAX_ADDED_SWINGS[ARMS] / max(length(swing), MIN_DIVISOR))
        turned[joint] = multiply(from_vector(scale(swing, copysign(size, more[ARMS]))), local[joint])
    before = [leg_forward(bones, hips, local) for bones in _LEGS]
    legs = []  # the thighs move with the pelvis, and the feet stay
    for leg, bones in zip(before, _LEGS, strict=True):
        base, hip = leg_base(bones, hips, pelvis, local[bones.joints[0]])
        legs.append(LegPose(base, *leg[1:4], hip, add(leg.knee, subtract(hip, leg.hip)), *leg[6:]))
    bears = max(contacts[:2]), max(contacts[2:])
    rise += carrying_rise([(leg.hip, leg.ankle) for leg in legs], [span(leg) for leg in before], bears)
    for bones, leg in zip(_LEGS, legs, strict=True):
        turned.update(zip(bones.joints[1:4], leg_inverse(leg, leg.ankle, leg.foot, -rise), strict=True))
    return rise, turned


def _turned_spine(
    local: list[Quaternion], pelvis: Quaternion, added: tuple[float, float, float]
) -> dict[int, Quaternion]:
    """Distribute the pelvis' and chest's added turns over the spine; the head keeps its direction."""
    yaw, roll, turn = added
    was, now, turned = local[0], pelvis, {}
    for k, joint in enumerate(_SPINE, 1):
        part = k / len(_SPINE)
        was = multiply(was, local[joint])
        world = multiply(from_vector((0.0, yaw + part * (turn - yaw), (1.0 - part) * roll)), was)
        turned[joint] = relative(now, world)
        now = world
    turned[_NECK] = relative(now, multiply(was, local[_NECK]))
    return turned


def _yaw(line: Vector) -> float:
    """Yaw (radians) of the line from right to left."""
    return atan2(-line[2], line[0])
