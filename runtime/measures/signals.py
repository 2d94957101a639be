"""Signals of a body part in every frame of a motion: the functions that rows of the table use.

Everything is in the body frame: origin under the hips, +Z the smoothed facing direction, +X left. Degrees, metres, seconds.
"""

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
CYCLE_S = 1.1  # about a gait cycle, over which facing and path are averaged
SWAY_S, COURSE_S, HALTING_S = (
    1.2,
    4.0 * CYCLE_S,
    0.15,
)  # averaging time of the path to which the hips are compared
LANDING_FRAMES = 8  # before a landing, in which the foot descends
FLICKER_FRAMES = 6  # gaps in a contact up to this length are ignored
MOVING_M_PER_S = 0.2  # speed of a moving root
MIN_CADENCE_HZ = 0.2  # of steps; below it their ratio to step length is meaningless
MIN_FREQUENCY_HZ = 0.3  # of a movement; slower ones are drift
_AT = SPORT_SKELETON.index
LEFT, AHEAD = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


Reader = Callable[["Part"], Any]  # returns a value per frame, or one for all


@dataclass(frozen=True)
class Clip:
    """A motion to measure: hips `(T, 3)`, local rotations `(T, 31, 4)`, contacts `(T, 4)` heel and toe, left first."""

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
        """Joint positions `(T, 31, 3)` in the body frame."""
        away = self.world[0] - self.hips[:, None] * np.array([1, 0, 1])
        return rotations.rotate(self._undo[:, None], away)

    @cached_property
    def turned(self) -> Array:
        """Joint rotations `(T, 31, 4)` in the body frame."""
        return rotations.multiply(self._undo[:, None], self.world[1])

    @cached_property
    def speed(self) -> Array:
        """Horizontal speed of the root `(T,)`, m/s."""
        ground = self.hips[:, [0, 2]]
        return np.linalg.norm(np.diff(ground, axis=0, append=ground[-1:]), axis=1) * FPS

    @cached_property
    def cycle_yaw(self) -> Array:
        """Yaw `(T,)` of the pelvis, radians, averaged over a gait cycle."""
        across = self.across("UpLeg")
        return smoothed(np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))[:, None], CYCLE_S)[:, 0]

    def across(self, joint: str) -> Array:
        """Return the vector `(T, 3)` from the right to the left of a pair of joints, in world space."""
        return self.world[0][:, _AT(f"Left{joint}")] - self.world[0][:, _AT(f"Right{joint}")]

    def in_cycle(self, joint: str) -> Array:
        """Return `across(joint)` relative to the pelvis yaw of the gait cycle, `(T, 3)`."""
        return rotations.rotate(rotations.inverse(rotations.from_yaw(self.cycle_yaw)), self.across(joint))

    @cached_property
    def _undo(self) -> Array:
        return rotations.inverse(rotations.from_yaw(self.facing))


@dataclass(frozen=True)
class Part:
    """A body part in a motion: `side` is "Left", "Right", or "" for trunk and head; `sign` is 1 on the left, -1 on the right."""

    clip: Clip
    side: str = ""
    sign: float = 1.0

    def at(self, joint: str) -> Array:
        """Return the positions `(T, 3)` of a joint on this side, in the body frame."""
        return self.clip.body[:, _AT(self.side + joint)]

    def line(self, start: str, end: str) -> Array:
        """Return the vector `(T, 3)` from one joint to another on this side, in the body frame."""
        return self.at(end) - self.at(start)

    @cached_property
    def foot(self) -> Array:
        """World positions of the ankle, `(T, 3)`."""
        return self.clip.world[0][:, _AT(f"{self.side}Foot")]

    @cached_property
    def down(self) -> tuple[Flags, Flags]:
        """Whether this foot and the other one touch the ground, `(T,)` each."""
        ground = np.asarray(self.clip.contacts) > 0.5
        left, right = (np.asarray(ground[:, k : k + 2].any(axis=1)) for k in (0, 2))
        return (left, right) if self.sign > 0.0 else (right, left)

    @cached_property
    def stance(self) -> Flags:
        """Frames in which this foot is on the ground; all frames if it never is."""
        return self.down[0] if self.down[0].any() else np.ones(len(self.down[0]), np.bool_)

    @cached_property
    def takeoffs(self) -> NDArray[np.intp]:
        """The frame before each landing of this foot."""
        return steps_of(*self.down) - 1

    def turned(self, joint: str, axis: Array) -> Array:
        """Return an axis of a joint on this side, `(T, 3)`, in the body frame."""
        return rotations.rotate(self.clip.turned[:, _AT(self.side + joint)], axis)


# --- Readers for rows: of joints named by a row --------------------------------------------------------------------------


def along(start: str, end: str, axis: int, outward: bool = False) -> Reader:
    """Measure the distance (metres) between two joints along an axis; `outward` is positive away from the body's middle."""
    return lambda part: part.line(start, end)[:, axis] * (part.sign if outward else 1.0)


def tilt(start: str, end: str, axis: int) -> Reader:
    """Measure the angle (degrees) from vertical of the line between two joints, towards an axis."""
    return lambda part: _tilt(part.line(start, end), axis)


def bend(upper: str, middle: str, lower: str) -> Reader:
    """Measure the flexion (degrees) of the joint between two bones; 0 is straight."""
    return lambda limb: _bend(limb.line(middle, upper), limb.line(middle, lower))


def turned_down(joint: str, axis: Array) -> Reader:
    """Measure how far (degrees) an axis of a joint points below the horizontal."""
    return lambda part: np.degrees(np.arcsin(np.clip(-part.turned(joint, axis)[:, 1], -1, 1)))


def turned_aside(joint: str, outward: bool = False) -> Reader:
    """Measure the yaw (degrees) of a joint to the left of the facing direction, or outward from the body's middle."""

    def read(part: Part) -> Array:
        ahead = part.turned(joint, AHEAD)
        return np.degrees(np.arctan2(ahead[:, 0] * (part.sign if outward else 1.0), ahead[:, 2]))

    return read


def cycle_yaw(joint: str) -> Reader:
    """Measure the yaw (degrees) of a pair of joints relative to the facing of the gait cycle."""
    return lambda trunk: _yaw(trunk.clip.in_cycle(joint))


def cycle_roll(joint: str) -> Reader:
    """Measure the roll (degrees) of a pair of joints; positive if the left one is higher."""

    def read(trunk: Part) -> Array:
        across = trunk.clip.in_cycle(joint)
        return np.degrees(np.arctan2(across[:, 1], np.linalg.norm(across[:, [0, 2]], axis=1)))

    return read


def standing(read: Reader) -> Reader:
    """Restrict a measure to frames with the foot on the ground."""
    return lambda leg: read(leg)[leg.stance]


# --- Readers of one measure -------------------------------------------------------------------------------------------


def hand_level(arm: Part) -> Array:
    """Return the relative height of the hand: 0 at the hips, 1 at the shoulders, about 1.3 at the eyes."""
    neck, hips = arm.clip.body[:, _AT("Neck1"), 1], arm.clip.body[:, _AT("Hips"), 1]
    return (arm.at("Hand")[:, 1] - hips) / np.maximum(neck - hips, 0.1)


def frequency(arm: Part) -> float:
    """Return the dominant frequency (Hz) of the hand's movement; 0 if the motion is too short."""
    x = arm.line("Arm", "Hand")
    if len(x) < 2 * FPS:
        return 0.0
    window = np.hanning(len(x))[:, None]
    power = (np.abs(np.fft.rfft((x - x.mean(0)) * window, axis=0)) ** 2).sum(axis=1)
    hertz = np.fft.rfftfreq(len(x), 1 / FPS)
    return float(hertz[np.argmax(np.where(hertz > MIN_FREQUENCY_HZ, power, 0))])


def thigh_lift(leg: Part) -> Array:
    """Return how far (degrees) the thigh is raised forward from vertical."""
    thigh = leg.line("UpLeg", "Leg")
    return np.degrees(np.arctan2(thigh[:, 2], -thigh[:, 1]))


def foot_out(leg: Part) -> Array:
    """Return how far (metres) the ankle is outward from the middle of the hips."""
    return leg.at("Foot")[:, 0] * leg.sign


def step_length(leg: Part) -> float:
    """Return the median step length (metres): half the distance between a foot's landings."""
    before = leg.takeoffs
    strides = np.linalg.norm(np.diff(leg.foot[before][:, [0, 2]], axis=0), axis=1)
    return float(np.median(strides if len(before) > 1 else np.zeros(1)) / 2)


def cadence(leg: Part) -> float:
    """Return the cadence: steps per second of both feet."""
    before = leg.takeoffs
    seconds = (before[-1] - before[0]) / FPS if len(before) > 1 else 0.0
    return float(2 * (len(before) - 1) / seconds) if seconds > 0 else 0.0


def walk_ratio(leg: Part) -> float:
    """Return the walk ratio: step length (metres) divided by cadence (steps per second)."""
    rate = cadence(leg)
    return step_length(leg) / rate if rate > MIN_CADENCE_HZ else 0.0


def stance_lead(leg: Part) -> float:
    """Return how much longer this foot carries the body alone than the other: 0 is even, -1 is never."""
    own, other = leg.down
    mine, theirs = float((own & ~other).sum()), float((other & ~own).sum())
    return 2.0 * (mine - theirs) / max(mine + theirs, 1.0)


def landing(leg: Part) -> float:
    """Return the downward speed (m/s) of the ankle just before landing, median over the landings."""
    height = leg.foot[:, 1]
    fall = -np.diff(height, prepend=height[:1]) * FPS
    frames = [t for t in landings(leg.down[0]) if t > LANDING_FRAMES]
    found = [float(fall[max(t - LANDING_FRAMES, 0) : t + 1].max()) for t in frames]
    return float(np.median(found)) if found else 0.0


def halting(part: Part) -> float:
    """Return the variation of the root's speed: standard deviation over mean; 0 is even, and pauses increase it."""
    path = smoothed(part.clip.world[0][:, 0][:, [0, 2]], HALTING_S)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * FPS
    return float(speed.std() / max(float(speed.mean()), 0.1))


def twist(trunk: Part) -> Array:
    """Return the yaw (degrees) of the shoulders relative to the hips."""
    shoulders, pelvis = trunk.line("RightArm", "LeftArm"), trunk.line("RightUpLeg", "LeftUpLeg")
    return np.degrees(np.arctan2(shoulders[:, 2], shoulders[:, 0]) - np.arctan2(pelvis[:, 2], pelvis[:, 0]))


def arch(trunk: Part) -> Array:
    """Return how far (degrees) the upper spine bends forward of the lower spine."""
    upper, lower = trunk.line("Spine", "Spine1"), trunk.line("LowerBack", "Spine")
    return np.degrees(np.arctan2(upper[:, 2], upper[:, 1]) - np.arctan2(lower[:, 2], lower[:, 1]))


def bounce(trunk: Part) -> Array:
    """Return the height (metres) of the hips over their smoothed path."""
    return (trunk.clip.hips - smoothed(trunk.clip.hips, SWAY_S))[:, 1]


def sway(trunk: Part) -> Array:
    """Return the sideways offset (metres) of the hips from their smoothed path."""
    return _sideways(trunk.clip.hips - smoothed(trunk.clip.hips, SWAY_S), trunk.clip.facing)


def wander(trunk: Part) -> Array:
    """Return the sideways offset (metres) of the path, averaged over a gait cycle, from its course."""
    path = smoothed(trunk.clip.hips, CYCLE_S)
    return _sideways(path - smoothed(trunk.clip.hips, COURSE_S), trunk.clip.cycle_yaw)


# --- Shared helpers ----------------------------------------------------------------------------------------------------


def landings(down: Flags) -> NDArray[np.intp]:
    """Return the frames where contact `(T,)` begins; gaps of up to `FLICKER_FRAMES` frames are ignored."""
    return np.flatnonzero(np.diff(closed(down).astype(int)) == 1) + 1


def steps_of(own: Flags, other: Flags) -> NDArray[np.intp]:
    """Return the frames where a foot lands, from its contacts and those of the other foot, `(T,)` each.

    Of several landings without one of the other foot in between, only the last counts: before it the foot brushed the
    ground in its swing. For a hopping foot all count.
    """
    frames, others = landings(own), landings(other)
    if len(others) < 2 or len(frames) == 0:
        return frames
    return frames[np.append(np.diff(np.searchsorted(others, frames)) > 0, True)]


def closed(down: Flags) -> Flags:
    """Return contact flags with gaps of up to `FLICKER_FRAMES` frames filled."""
    filled = down.copy()
    for a, b in pairwise(np.flatnonzero(np.diff(down.astype(int)))):
        if not down[a + 1] and b - a <= FLICKER_FRAMES:
            filled[a + 1 : b + 1] = True
    return filled


def smoothed(x: Array, seconds: float) -> Array:
    """Return the moving average over `seconds`, with both ends padded by their own values."""
    half = int(seconds * FPS / 2)
    padded = np.pad(x, [(half, half)] + [(0, 0)] * (x.ndim - 1), mode="edge")
    total = np.cumsum(np.concatenate([np.zeros_like(padded[:1]), padded], dtype=np.float64), axis=0)
    return (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)


def smoothed_facing(positions: Array) -> Array:
    """Return the smoothed facing direction `(T,)` in radians, from hips and shoulders; 0 is +Z."""
    across = (positions[:, _AT("LeftUpLeg")] - positions[:, _AT("RightUpLeg")]) + (
        positions[:, _AT("LeftArm")] - positions[:, _AT("RightArm")]
    )
    forward = np.stack([-across[:, 2], across[:, 0]], axis=1)  # (x, z) of across × up, turned forward
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
