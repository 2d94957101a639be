"""What a part of the body does in every frame of a motion: the functions that rows of the table read.

All is in the frame of the body: origin under the hips, +Z the smoothed facing direction, +X left. Degrees, metres, seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array, Flags
from runtime.pose import FPS
from runtime.skeleton import SPORT_SKELETON

FACING_S = 0.5  # over which the facing direction is averaged
CYCLE_S = 1.1  # about a gait cycle, which facing and path are averaged over
SWAY_S, COURSE_S, HALTING_S = (
    1.2,
    4.0 * CYCLE_S,
    0.15,
)  # over which a path is averaged that the hips are measured against
LANDING_FRAMES = 8  # before a landing, in which a foot comes down
FLICKER_FRAMES = 6  # of no contact, in which a foot has not left the ground
MOVING_M_PER_S = 0.2  # of a root that goes somewhere
LEAST_CADENCE_HZ = 0.2  # of steps whose length has a ratio to it
LEAST_FREQUENCY_HZ = 0.3  # of a movement that is no drift
_AT = SPORT_SKELETON.index
LEFT, AHEAD = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


Reader = Callable[["Part"], Any]  # a value in every frame, or one of all


@dataclass(frozen=True)
class Clip:
    """A motion: hips `(T, 3)`, local rotations `(T, 31, 4)`, contacts `(T, 4)` heel and toe, left first."""

    hips: Array
    local: Array
    contacts: Array

    @cached_property
    def world(self) -> tuple[Array, Array]:
        """World positions `(T, 31, 3)` and rotations `(T, 31, 4)`."""
        return SPORT_SKELETON.forward_kinematics(self.hips, self.local)

    @cached_property
    def facing(self) -> Array:
        """The smoothed facing direction `(T,)`, radians."""
        return smoothed_facing(self.world[0])

    @cached_property
    def body(self) -> Array:
        """Positions `(T, 31, 3)` in the frame of the body."""
        away = self.world[0] - self.hips[:, None] * np.array([1, 0, 1])
        return rotations.rotate(self._undo[:, None], away)

    @cached_property
    def turned(self) -> Array:
        """Rotations `(T, 31, 4)` in the frame of the body."""
        return rotations.multiply(self._undo[:, None], self.world[1])

    @cached_property
    def speed(self) -> Array:
        """Metres per second `(T,)` of the root."""
        ground = self.hips[:, [0, 2]]
        return np.linalg.norm(np.diff(ground, axis=0, append=ground[-1:]), axis=1) * FPS

    @cached_property
    def cycle_yaw(self) -> Array:
        """The way that the pelvis faces, over a gait cycle: `(T,)` radians."""
        across = self.across("UpLeg")
        return smoothed(np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))[:, None], CYCLE_S)[:, 0]

    def across(self, joint: str) -> Array:
        """From the right to the left one of a pair of joints, in world space `(T, 3)`."""
        return self.world[0][:, _AT(f"Left{joint}")] - self.world[0][:, _AT(f"Right{joint}")]

    def in_cycle(self, joint: str) -> Array:
        """The same about the way that the pelvis faces over a cycle."""
        return rotations.rotate(rotations.inverse(rotations.from_yaw(self.cycle_yaw)), self.across(joint))

    @cached_property
    def _undo(self) -> Array:
        return rotations.inverse(rotations.from_yaw(self.facing))


@dataclass(frozen=True)
class Part:
    """A part of the body in a motion: `side` is "Left", "Right", or "" of trunk and head, `sign` 1 of what is on the left."""

    clip: Clip
    side: str = ""
    sign: float = 1.0

    def at(self, joint: str) -> Array:
        """A joint of this side `(T, 3)` in the frame of the body."""
        return self.clip.body[:, _AT(self.side + joint)]

    def line(self, start: str, end: str) -> Array:
        """From one joint of this side to another one, `(T, 3)`."""
        return self.at(end) - self.at(start)

    @cached_property
    def foot(self) -> Array:
        """The ankle's place in world space, `(T, 3)`."""
        return self.clip.world[0][:, _AT(f"{self.side}Foot")]

    @cached_property
    def down(self) -> tuple[Flags, Flags]:
        """Whether this foot and the other one touch the ground, `(T,)` each."""
        ground = np.asarray(self.clip.contacts) > 0.5
        left, right = (np.asarray(ground[:, k : k + 2].any(axis=1)) for k in (0, 2))
        return (left, right) if self.sign > 0.0 else (right, left)

    @cached_property
    def stance(self) -> Flags:
        """Frames in which this foot is on the ground; all where it never is."""
        return self.down[0] if self.down[0].any() else np.ones(len(self.down[0]), np.bool_)

    @cached_property
    def takeoffs(self) -> NDArray[np.intp]:
        """The last frames in the air of this foot's steps."""
        return steps_of(*self.down) - 1

    def turned(self, joint: str, axis: Array) -> Array:
        """An axis of a joint of this side, `(T, 3)`."""
        return rotations.rotate(self.clip.turned[:, _AT(self.side + joint)], axis)


# --- Readers for rows: of joints that a row names ----------------------------------------------------------------------


def along(start: str, end: str, axis: int, outward: bool = False) -> Reader:
    """Metres along an axis from one joint to another, to the left or away from the middle of the body."""
    return lambda part: part.line(start, end)[:, axis] * (part.sign if outward else 1.0)


def tilt(start: str, end: str, axis: int) -> Reader:
    """Degrees from vertical of the line between two joints, towards an axis."""
    return lambda part: _tilt(part.line(start, end), axis)


def bend(upper: str, middle: str, lower: str) -> Reader:
    """Degrees by which the joint between two bones bends: 0 is straight."""
    return lambda limb: _bend(limb.line(middle, upper), limb.line(middle, lower))


def turned_down(joint: str, axis: Array) -> Reader:
    """Degrees that an axis of a joint points downward."""
    return lambda part: np.degrees(np.arcsin(np.clip(-part.turned(joint, axis)[:, 1], -1, 1)))


def turned_aside(joint: str, outward: bool = False) -> Reader:
    """Degrees that a joint points to the left of the facing direction, or away from the middle of the body."""

    def read(part: Part) -> Array:
        ahead = part.turned(joint, AHEAD)
        return np.degrees(np.arctan2(ahead[:, 0] * (part.sign if outward else 1.0), ahead[:, 2]))

    return read


def cycle_yaw(joint: str) -> Reader:
    """Degrees that a pair of joints turns about the facing of a cycle."""
    return lambda trunk: _yaw(trunk.clip.in_cycle(joint))


def cycle_roll(joint: str) -> Reader:
    """Degrees by which the left one of a pair of joints is over the right one."""

    def read(trunk: Part) -> Array:
        across = trunk.clip.in_cycle(joint)
        return np.degrees(np.arctan2(across[:, 1], np.linalg.norm(across[:, [0, 2]], axis=1)))

    return read


def standing(read: Reader) -> Reader:
    """What is read, of frames with the foot on the ground."""
    return lambda leg: read(leg)[leg.stance]


# --- Readers of one measure -------------------------------------------------------------------------------------------


def hand_level(arm: Part) -> Array:
    """Height of the hand: 0 at the hips, 1 at the shoulders, about 1.3 at the eyes."""
    neck, hips = arm.clip.body[:, _AT("Neck1"), 1], arm.clip.body[:, _AT("Hips"), 1]
    return (arm.at("Hand")[:, 1] - hips) / np.maximum(neck - hips, 0.1)


def frequency(arm: Part) -> float:
    """Hz of the hand's strongest movement, over the summed spectra; 0 when the motion is too short."""
    x = arm.line("Arm", "Hand")
    if len(x) < 2 * FPS:
        return 0.0
    window = np.hanning(len(x))[:, None]
    power = (np.abs(np.fft.rfft((x - x.mean(0)) * window, axis=0)) ** 2).sum(axis=1)
    hertz = np.fft.rfftfreq(len(x), 1 / FPS)
    return float(hertz[np.argmax(np.where(hertz > LEAST_FREQUENCY_HZ, power, 0))])


def thigh_lift(leg: Part) -> Array:
    """Degrees of the thigh forward from vertical."""
    thigh = leg.line("UpLeg", "Leg")
    return np.degrees(np.arctan2(thigh[:, 2], -thigh[:, 1]))


def foot_out(leg: Part) -> Array:
    """Metres of the ankle outward from the hips' middle."""
    return leg.at("Foot")[:, 0] * leg.sign


def step_length(leg: Part) -> float:
    """Metres between a foot's landings, halved, median."""
    before = leg.takeoffs
    strides = np.linalg.norm(np.diff(leg.foot[before][:, [0, 2]], axis=0), axis=1)
    return float(np.median(strides if len(before) > 1 else np.zeros(1)) / 2)


def cadence(leg: Part) -> float:
    """Steps per second of both feet."""
    before = leg.takeoffs
    seconds = (before[-1] - before[0]) / FPS if len(before) > 1 else 0.0
    return float(2 * (len(before) - 1) / seconds) if seconds > 0 else 0.0


def walk_ratio(leg: Part) -> float:
    """Metres of a step over steps per second."""
    rate = cadence(leg)
    return step_length(leg) / rate if rate > LEAST_CADENCE_HZ else 0.0


def stance_lead(leg: Part) -> float:
    """By which fraction this foot carries alone longer than the other: 0 is even, -1 is never."""
    own, other = leg.down
    mine, theirs = float((own & ~other).sum()), float((other & ~own).sum())
    return 2.0 * (mine - theirs) / max(mine + theirs, 1.0)


def landing(leg: Part) -> float:
    """Metres per second at which the ankle comes down last, median over the landings."""
    height = leg.foot[:, 1]
    fall = -np.diff(height, prepend=height[:1]) * FPS
    frames = [t for t in landings(leg.down[0]) if t > LANDING_FRAMES]
    found = [float(fall[max(t - LANDING_FRAMES, 0) : t + 1].max()) for t in frames]
    return float(np.median(found)) if found else 0.0


def halting(part: Part) -> float:
    """Deviation of the root's speed over its mean: 0 goes evenly, pauses let it grow."""
    path = smoothed(part.clip.world[0][:, 0][:, [0, 2]], HALTING_S)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * FPS
    return float(speed.std() / max(float(speed.mean()), 0.1))


def twist(trunk: Part) -> Array:
    """Degrees of the shoulders against the hips."""
    shoulders, pelvis = trunk.line("RightArm", "LeftArm"), trunk.line("RightUpLeg", "LeftUpLeg")
    return np.degrees(np.arctan2(shoulders[:, 2], shoulders[:, 0]) - np.arctan2(pelvis[:, 2], pelvis[:, 0]))


def arch(trunk: Part) -> Array:
    """Degrees that the upper spine bends forward of the lower."""
    upper, lower = trunk.line("Spine", "Spine1"), trunk.line("LowerBack", "Spine")
    return np.degrees(np.arctan2(upper[:, 2], upper[:, 1]) - np.arctan2(lower[:, 2], lower[:, 1]))


def bounce(trunk: Part) -> Array:
    """Height of the hips over their smoothed path."""
    return (trunk.clip.hips - smoothed(trunk.clip.hips, SWAY_S))[:, 1]


def sway(trunk: Part) -> Array:
    """The hips sideways of their smoothed path."""
    return _sideways(trunk.clip.hips - smoothed(trunk.clip.hips, SWAY_S), trunk.clip.facing)


def wander(trunk: Part) -> Array:
    """The path of a cycle sideways of its course."""
    path = smoothed(trunk.clip.hips, CYCLE_S)
    return _sideways(path - smoothed(trunk.clip.hips, COURSE_S), trunk.clip.cycle_yaw)


# --- What they share --------------------------------------------------------------------------------------------------


def landings(down: Flags) -> NDArray[np.intp]:
    """Frames where contact `(T,)` begins; gaps of up to `FLICKER_FRAMES` frames are none."""
    return np.flatnonzero(np.diff(closed(down).astype(int)) == 1) + 1


def steps_of(own: Flags, other: Flags) -> NDArray[np.intp]:
    """Frames where a foot lands, of its contact and the other foot's `(T,)`.

    Of several landings with none of the other foot between them the last one counts: before, it brushed the ground in its
    swing. Of one that hops all count.
    """
    frames, others = landings(own), landings(other)
    if len(others) < 2 or len(frames) == 0:
        return frames
    return frames[np.append(np.diff(np.searchsorted(others, frames)) > 0, True)]


def closed(down: Flags) -> Flags:
    """Contact flags with gaps of up to `FLICKER_FRAMES` frames filled."""
    filled = down.copy()
    for a, b in pairwise(np.flatnonzero(np.diff(down.astype(int)))):
        if not down[a + 1] and b - a <= FLICKER_FRAMES:
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
    across = (positions[:, _AT("LeftUpLeg")] - positions[:, _AT("RightUpLeg")]) + (
        positions[:, _AT("LeftArm")] - positions[:, _AT("RightArm")]
    )
    forward = np.stack([-across[:, 2], across[:, 0]], axis=1)  # (x, z) of across × up, turned to the front
    smooth = smoothed(forward, FACING_S)
    return np.arctan2(smooth[:, 0], smooth[:, 1])


def _sideways(away: Array, yaw: Array) -> Array:
    return away[:, 0] * np.cos(yaw) - away[:, 2] * np.sin(yaw)


def _tilt(line: Array, axis: int) -> Array:
    return np.degrees(np.arctan2(line[:, axis], line[:, 1]))


def _yaw(across: Array) -> Array:
    return np.degrees(np.arctan2(-across[:, 2], across[:, 0]))


def _bend(up: Array, down: Array) -> Array:
    cosine = np.sum(rotations.normalize(up) * rotations.normalize(down), axis=-1)
    return 180 - np.degrees(np.arccos(np.clip(cosine, -1, 1)))
