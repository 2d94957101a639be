"""What a motion does, body part by body part, in numbers that words can be chosen from.

Everything is measured in the frame of the body: origin under the hips, +Z the smoothed facing direction, +X left.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.motion.features import FPS
from runtime.skeleton import SPORT_SKELETON

_FACING_SECONDS = 0.5
_CYCLE_SECONDS = 1.1  # about a gait cycle, which facing and path are averaged over
_LANDING = 8  # frames before a landing in which a foot comes down
_FLICKER = 6


@dataclass(frozen=True)
class ArmMeasures:
    """One arm. Metres and degrees; ranges are between the 10th and the 90th percentile."""

    hand_level: float  # height of the hand: 0 at the hips, 1 at the shoulders, about 1.3 at the eyes
    hand_level_top: float  # 90th percentile of it
    hand_level_range: float
    hand_out: float  # of the hand outward from the shoulder
    hand_front: float  # of the hand forward of the shoulder
    elbow_bend: float  # 0 is straight
    elbow_range: float
    elbow_out: float  # of the elbow outward from the shoulder
    swing: float  # range of the hand forward and back
    side_swing: float  # range of the hand sideways
    frequency: float  # Hz, of the hand's strongest movement


@dataclass(frozen=True)
class LegMeasures:
    """One leg."""

    knee_bend: float  # degrees while the foot is on the ground
    knee_bend_top: float  # 95th percentile
    thigh_lift: float  # degrees of the thigh forward from vertical, 95th percentile
    foot_lift: float  # metres of the ankle over its lowest, 95th percentile
    step_length: float  # metres between a foot's landings, halved
    cadence: float  # steps per second of both feet
    speed: float  # metres per second
    width: float  # metres of the ankle outward from the hips' middle while on the ground
    toe_out: float  # degrees outward of the foot on the ground
    moving: float  # fraction of frames with the root faster than 0.2 m/s
    foot_pitch: float  # degrees that the foot on the ground points down: on tiptoe the heel is up
    walk_ratio: float = 0.0  # metres of a step over steps per second
    stance_lead: float = 0.0  # by which fraction this foot carries alone longer than the other
    landing: float = 0.0  # metres per second at which the ankle comes down
    halting: float = 0.0  # deviation of the root's speed over its mean


@dataclass(frozen=True)
class TorsoMeasures:
    """Hips to neck."""

    pitch: float  # degrees forward from vertical
    pitch_range: float
    roll: float  # degrees towards the left
    roll_range: float
    twist_range: float  # degrees of the shoulders against the hips
    bounce: float  # metres, range of the hips' height
    sway: float  # metres, range of the hips sideways of their smoothed path
    arch: float  # degrees that the upper spine bends forward of the lower
    pelvis_yaw_range: float = 0.0  # degrees, this and the following three about the facing of a cycle
    pelvis_roll_range: float = 0.0
    shoulder_yaw_range: float = 0.0
    shoulder_roll_range: float = 0.0
    wander: float = 0.0  # metres, range of the path of a cycle sideways of its course


@dataclass(frozen=True)
class HeadMeasures:
    """Neck and head."""

    pitch: float  # degrees that the face points downward
    forward: float  # metres of the head in front of the neck's base
    roll: float  # degrees towards the left shoulder
    roll_range: float
    pitch_range: float
    turn_range: float  # degrees of turning against the facing direction
    bob: float  # metres, range of the head forward of the neck's base
    turn: float = 0.0  # degrees that the face looks to the left of the facing direction


_MEASURES = {"arm": ArmMeasures, "leg": LegMeasures, "torso": TorsoMeasures, "head": HeadMeasures}


@dataclass(frozen=True)
class BodyMeasures:
    """A whole motion, or the average of several."""

    left_arm: ArmMeasures
    right_arm: ArmMeasures
    left_leg: LegMeasures
    right_leg: LegMeasures
    torso: TorsoMeasures
    head: HeadMeasures


def measure_names(part: str) -> tuple[str, ...]:
    """The measures of a part such as "left_arm", in their order."""
    return tuple(field.name for field in fields(_MEASURES[part.split("_")[-1]]))


def measure(hips: Array, local: Array, contacts: Array) -> BodyMeasures:
    """Measures of a motion: hips `(T, 3)`, local rotations `(T, 31, 4)`, contacts `(T, 4)` heel and toe, left first."""
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    facing = smoothed_facing(positions)
    undo = rotations.inverse(rotations.from_yaw(facing))
    body = positions - hips[:, None] * np.array([1, 0, 1])
    body = rotations.rotate(undo[:, None], body)
    turned = rotations.multiply(undo[:, None], world)
    ground = np.asarray(contacts) > 0.5
    speed = np.linalg.norm(np.diff(hips[:, [0, 2]], axis=0, append=hips[-1:, [0, 2]]), axis=1) * FPS
    return BodyMeasures(
        _arm(body, "Left", 1.0),
        _arm(body, "Right", -1.0),
        _leg(body, positions, turned, (ground[:, :2], ground[:, 2:]), "Left", 1.0, speed),
        _leg(body, positions, turned, (ground[:, 2:], ground[:, :2]), "Right", -1.0, speed),
        _torso(body, positions, hips, facing),
        _head(body, turned),
    )


def average(measures: Iterable[tuple[BodyMeasures, float]]) -> BodyMeasures:
    """Weighted median of every number over (measures, weight in seconds)."""
    items = list(measures)
    weights = np.array([weight for _, weight in items])
    parts = {}
    for field in fields(BodyMeasures):
        values = [getattr(m, field.name) for m, _ in items]
        kind = type(values[0])
        parts[field.name] = kind(
            **{f.name: _weighted_median([getattr(v, f.name) for v in values], weights) for f in fields(kind)}
        )
    return BodyMeasures(**parts)


def landings(down: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Frames where contact `(T,)` begins; gaps of up to `_FLICKER` frames are none."""
    return np.flatnonzero(np.diff(closed(down).astype(int)) == 1) + 1


def steps_of(own: NDArray[np.bool_], other: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Frames where a foot lands, of its contact and the other foot's `(T,)`.

    Of several landings with none of the other foot between them the last one counts: before, it brushed the ground in its
    swing. Of one that hops all count.
    """
    frames, others = landings(own), landings(other)
    if len(others) < 2 or len(frames) == 0:
        return frames
    return frames[np.append(np.diff(np.searchsorted(others, frames)) > 0, True)]


def closed(down: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Contact flags with gaps of up to `_FLICKER` frames filled."""
    filled = down.copy()
    edges = np.flatnonzero(np.diff(down.astype(int)))
    for a, b in pairwise(edges):
        if not down[a + 1] and b - a <= _FLICKER:
            filled[a + 1 : b + 1] = True
    return filled


def smoothed(x: Array, seconds: float) -> Array:
    """Moving average over `seconds`, the ends padded with their own values."""
    half = int(seconds * FPS / 2)
    padded = np.pad(x, [(half, half)] + [(0, 0)] * (x.ndim - 1), mode="edge")
    total = np.cumsum(np.concatenate([np.zeros_like(padded[:1]), padded], dtype=np.float64), axis=0)
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)


def smoothed_facing(positions: Array) -> Array:
    """Smoothed facing direction `(T,)` in radians, from hips and shoulders; 0 is +Z."""
    at = SPORT_SKELETON.index
    across = (positions[:, at("LeftUpLeg")] - positions[:, at("RightUpLeg")]) + (
        positions[:, at("LeftArm")] - positions[:, at("RightArm")]
    )
    forward = np.stack([-across[:, 2], across[:, 0]], axis=1)  # (x, z) of across × up, turned to the front
    smooth = smoothed(forward, _FACING_SECONDS)
    return np.arctan2(smooth[:, 0], smooth[:, 1])


def _arm(body: Array, side: str, sign: float) -> ArmMeasures:
    at = SPORT_SKELETON.index
    shoulder, elbow = body[:, at(f"{side}Arm")], body[:, at(f"{side}ForeArm")]
    hand = body[:, at(f"{side}Hand")]
    neck = body[:, at("Neck1")]
    hips = body[:, at("Hips")]
    level = (hand[:, 1] - hips[:, 1]) / np.maximum(neck[:, 1] - hips[:, 1], 0.1)
    bend = 180 - _angle(shoulder - elbow, hand - elbow)
    reach = hand - shoulder
    return ArmMeasures(
        hand_level=float(np.median(level)),
        hand_level_top=float(np.percentile(level, 90)),
        hand_level_range=float(_range(level)),
        hand_out=float(np.median(reach[:, 0] * sign)),
        hand_front=float(np.median(reach[:, 2])),
        elbow_bend=float(np.median(bend)),
        elbow_range=_range(bend),
        elbow_out=float(np.median((elbow - shoulder)[:, 0] * sign)),
        swing=_range(reach[:, 2]),
        side_swing=_range(reach[:, 0]),
        frequency=_frequency(reach),
    )


def _leg(
    body: Array,
    positions: Array,
    turned: Array,
    ground: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    side: str,
    sign: float,
    speed: Array,
) -> LegMeasures:
    at = SPORT_SKELETON.index
    hip, knee, ankle = (body[:, at(f"{side}{n}")] for n in ("UpLeg", "Leg", "Foot"))
    bend = 180 - _angle(hip - knee, ankle - knee)
    lift = np.degrees(np.arctan2((knee - hip)[:, 2], (hip - knee)[:, 1]))
    down, other = (np.asarray(contact.any(axis=1)) for contact in ground)
    stance = down if down.any() else np.ones(len(down), np.bool_)
    path = positions[:, at(f"{side}Foot")][:, [0, 2]]
    before = steps_of(down, other) - 1  # the last frame in the air
    foot = path[before]
    strides = np.linalg.norm(np.diff(foot, axis=0), axis=1) if len(before) > 1 else np.zeros(1)
    seconds = (before[-1] - before[0]) / FPS if len(before) > 1 else 0.0
    toe = rotations.rotate(turned[:, at(f"{side}Foot")], np.array([0.0, 0.0, 1.0]))
    height = positions[:, at(f"{side}Foot"), 1]
    cadence = float(2 * (len(before) - 1) / seconds) if seconds > 0 else 0.0
    step_length = float(np.median(strides) / 2)
    return LegMeasures(
        knee_bend=float(np.median(bend[stance])),
        knee_bend_top=float(np.percentile(bend, 95)),
        thigh_lift=float(np.percentile(lift, 95)),
        foot_lift=float(np.percentile(height, 95) - np.percentile(height, 5)),
        step_length=step_length,
        cadence=cadence,
        speed=float(np.median(speed)),
        width=float(np.median(ankle[stance, 0] * sign)),
        toe_out=float(np.degrees(np.median(np.arctan2(toe[stance, 0] * sign, toe[stance, 2])))),
        moving=float((speed > 0.2).mean()),
        foot_pitch=float(np.degrees(np.median(np.arcsin(np.clip(-toe[stance, 1], -1, 1))))),
        walk_ratio=step_length / cadence if cadence > 0.2 else 0.0,
        stance_lead=_stance_lead(down, other),
        landing=_landing_speed(height, down),
        halting=_halting(positions[:, 0]),
    )


def _torso(body: Array, positions: Array, hips: Array, facing: Array) -> TorsoMeasures:
    at = SPORT_SKELETON.index
    spine = body[:, at("Neck")] - body[:, at("Hips")]
    lower = body[:, at("Spine")] - body[:, at("LowerBack")]
    upper = body[:, at("Spine1")] - body[:, at("Spine")]
    pitch = np.degrees(np.arctan2(spine[:, 2], spine[:, 1]))
    roll = np.degrees(np.arctan2(spine[:, 0], spine[:, 1]))
    shoulders = body[:, at("LeftArm")] - body[:, at("RightArm")]
    pelvis = body[:, at("LeftUpLeg")] - body[:, at("RightUpLeg")]
    twist = np.degrees(np.arctan2(shoulders[:, 2], shoulders[:, 0]) - np.arctan2(pelvis[:, 2], pelvis[:, 0]))
    path = hips - smoothed(hips, 1.2)
    side = path[:, 0] * np.cos(facing) - path[:, 2] * np.sin(facing)
    return TorsoMeasures(
        pitch=float(np.median(pitch)),
        pitch_range=_range(pitch),
        roll=float(np.median(roll)),
        roll_range=_range(roll),
        twist_range=_range(twist),
        bounce=_range(path[:, 1]),
        sway=_range(side),
        arch=float(
            np.median(np.degrees(np.arctan2(upper[:, 2], upper[:, 1]) - np.arctan2(lower[:, 2], lower[:, 1])))
        ),
        **_torso_rhythm(positions, hips),
    )


def _head(body: Array, turned: Array) -> HeadMeasures:
    at = SPORT_SKELETON.index
    face = rotations.rotate(turned[:, at("Head")], np.array([0.0, 0.0, 1.0]))
    ear = rotations.rotate(turned[:, at("Head")], np.array([1.0, 0.0, 0.0]))  # towards the left ear
    pitch = np.degrees(np.arcsin(np.clip(-face[:, 1], -1, 1)))
    roll = np.degrees(np.arcsin(np.clip(-ear[:, 1], -1, 1)))
    ahead = (body[:, at("Head")] - body[:, at("Neck")])[:, 2]
    return HeadMeasures(
        pitch=float(np.median(pitch)),
        forward=float(np.median(ahead)),
        roll=float(np.median(roll)),
        roll_range=_range(roll),
        pitch_range=_range(pitch),
        turn_range=_range(np.degrees(np.arctan2(face[:, 0], face[:, 2]))),
        bob=_range(ahead),
        turn=float(np.median(np.degrees(np.arctan2(face[:, 0], face[:, 2])))),
    )


def _stance_lead(own: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """By which fraction one foot carries alone longer than the other: 0 is even, -1 is never."""
    mine, theirs = float((own & ~other).sum()), float((other & ~own).sum())
    return 2.0 * (mine - theirs) / max(mine + theirs, 1.0)


def _landing_speed(height: Array, down: NDArray[np.bool_]) -> float:
    """Metres per second at which an ankle of `height` `(T,)` comes down last, median over the landings."""
    fall = -np.diff(height, prepend=height[:1]) * FPS
    found = [float(fall[max(t - _LANDING, 0) : t + 1].max()) for t in landings(down) if t > _LANDING]
    return float(np.median(found)) if found else 0.0


def _halting(hips: Array) -> float:
    """Deviation of the root's speed over its mean: 0 goes evenly, pauses let it grow."""
    path = smoothed(hips[:, [0, 2]], 0.15)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * FPS
    return float(speed.std() / max(float(speed.mean()), 0.1))


def _torso_rhythm(positions: Array, hips: Array) -> dict[str, float]:
    """Ranges of pelvis and shoulders about the facing of a cycle in degrees, and how far the course wanders, metres."""
    at = SPORT_SKELETON.index
    pelvis = positions[:, at("LeftUpLeg")] - positions[:, at("RightUpLeg")]
    shoulders = positions[:, at("LeftArm")] - positions[:, at("RightArm")]
    yaw = smoothed(np.unwrap(np.arctan2(-pelvis[:, 2], pelvis[:, 0]))[:, None], _CYCLE_SECONDS)[:, 0]
    undo = rotations.inverse(rotations.from_yaw(yaw))
    hip_line, shoulder_line = rotations.rotate(undo, pelvis), rotations.rotate(undo, shoulders)
    path = smoothed(hips, _CYCLE_SECONDS)
    away = path - smoothed(hips, 4.0 * _CYCLE_SECONDS)
    return {
        "pelvis_yaw_range": _range(_yaw(hip_line)),
        "pelvis_roll_range": _range(_roll(hip_line)),
        "shoulder_yaw_range": _range(_yaw(shoulder_line)),
        "shoulder_roll_range": _range(_roll(shoulder_line)),
        "wander": _range(away[:, 0] * np.cos(yaw) - away[:, 2] * np.sin(yaw)),
    }


def _yaw(across: Array) -> Array:
    return np.degrees(np.arctan2(-across[:, 2], across[:, 0]))


def _roll(across: Array) -> Array:
    return np.degrees(np.arctan2(across[:, 1], np.linalg.norm(across[:, [0, 2]], axis=1)))


def _range(x: Array) -> float:
    low, high = np.percentile(x, [10, 90])
    return float(high - low)


def _angle(a: Array, b: Array) -> Array:
    cosine = np.sum(rotations.normalize(a) * rotations.normalize(b), axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def _frequency(x: Array) -> float:
    """Hz of the strongest movement of x `(T, 3)` above 0.3 Hz, over the summed spectra; 0 when it is too short."""
    if len(x) < 2 * FPS:
        return 0.0
    window = np.hanning(len(x))[:, None]
    power = (np.abs(np.fft.rfft((x - x.mean(0)) * window, axis=0)) ** 2).sum(axis=1)
    hertz = np.fft.rfftfreq(len(x), 1 / FPS)
    return float(hertz[np.argmax(np.where(hertz > 0.3, power, 0))])


def _weighted_median(values: list[float], weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[int(np.searchsorted(total, total[-1] / 2))]])
