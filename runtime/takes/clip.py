"""A clip of a take: immutable poses with their origin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import UsageError
from runtime.pose import MAX_FPS, Pose
from runtime.skeleton import SPORT_SKELETON, J
from runtime.takes.metadata import UNKNOWN, UNMOVED, LoopReport, Origin, PromptEvent, gait_seconds

MAX_NORM_ERROR = 0.01  # of a quaternion
MIN_SIZE, MAX_SIZE = 0.05, 20.0  # of a body, relative to ours
MAX_DISTANCE_M = 100_000.0  # of a clip's hips from the origin, where float32 has a resolution of 8 mm


@dataclass(frozen=True)
class Clip:
    """A recorded motion of the SPORT skeleton at a fixed frame rate."""

    name: str
    fps: float
    hips_positions: Array  # (T, 3) metres, world
    local_rotations: Array  # (T, 31, 4)
    contacts: Array  # (T, 4) 0..1: left heel, left toe, right heel, right toe
    prompts: tuple[PromptEvent, ...] = ()
    terrain: str = "flat"  # name or file of the ground it was made on
    origin: Origin = UNKNOWN  # model, seed and settings
    gait_seconds: tuple[tuple[str, float], ...] = ()  # seconds for which each gait was requested
    gaits: NDArray[np.int8] | None = None  # (T,) requested in each frame; None if unknown
    # yaw and x, y, z by which the take was moved from its place on its ground; None: it no longer fits the ground
    placed: tuple[float, ...] | None = UNMOVED
    # world metres per metre of the skeleton: the clip is for a body this many times as large as ours, and its lengths are
    # at that body's scale; files contain world metres
    size: float = 1.0
    loop: LoopReport | None = None  # the cycle, None if it is not a loop

    def __post_init__(self) -> None:
        n = len(self.hips_positions)
        shapes = (self.hips_positions.shape, self.local_rotations.shape, self.contacts.shape)
        if n < 1 or shapes != ((n, 3), (n, J, 4), (n, 4)):
            raise ValueError(f"clip arrays {shapes}: expected (T, 3), (T, {J}, 4), (T, 4) with T >= 1")
        if not 0.0 < self.fps <= MAX_FPS:
            raise ValueError(f"clip of {self.fps} frames per second: expected 0 to {MAX_FPS:.0f}")
        if not MIN_SIZE <= self.size <= MAX_SIZE:
            problem = f"clip of a body of {self.size} times our size: expected {MIN_SIZE} to {MAX_SIZE}"
            raise ValueError(problem)

    def __len__(self) -> int:
        return len(self.hips_positions)

    @property
    def arrays(self) -> tuple[Array, Array, Array]:
        """Hips, local rotations and contacts."""
        return self.hips_positions, self.local_rotations, self.contacts

    def posed(self, hips: Array, local: Array, contacts: Array | None = None) -> Clip:
        """Return the clip with new hips `(T, 3)`, local rotations `(T, 31, 4)` and optionally contacts `(T, 4)`, float32."""
        return replace(
            self,
            hips_positions=np.asarray(hips, np.float32),
            local_rotations=np.asarray(local, np.float32),
            contacts=self.contacts if contacts is None else contacts,
        )

    @property
    def seconds(self) -> float:
        """Duration from the first to the last frame, in seconds."""
        return (len(self) - 1) / self.fps

    def pose(self, i: int, ground_m: float = 0.0) -> Pose:
        """Return the pose of frame `i`; `ground_m` is the height of the terrain under it."""
        return _pose(self.hips_positions[i], self.local_rotations[i], self.contacts[i], ground_m)

    def sample(self, seconds: float, ground_m: float = 0.0) -> Pose:
        """Return the pose at a time, interpolated; times outside the clip give its ends."""
        hips, local, contacts = self._at(np.array([seconds]))
        return _pose(hips[0], local[0], contacts[0], ground_m)

    def world(self) -> tuple[Array, Array]:
        """Return world positions `(T, 31, 3)` and rotations `(T, 31, 4)`."""
        return SPORT_SKELETON.forward_kinematics(self.hips_positions, self.local_rotations)

    def trim(self, first: int, last: int) -> Clip:
        """Return frames `first` to `last` as a clip; UsageError if they do not exist."""
        if not 0 <= first <= last < len(self):
            problem = f"trim {first} to {last}: the clip has frames 0 to {len(self) - 1}."
            raise UsageError(problem, "Choose others.")
        keep = slice(first, last + 1)
        gaits = None if self.gaits is None else self.gaits[keep]
        return replace(
            self.posed(*(array[keep] for array in self.arrays)),
            loop=None,
            gaits=gaits,
            gait_seconds=gait_seconds(gaits, self.fps),
            prompts=shift_prompts(self.prompts, first / self.fps, (last - first) / self.fps),
        )

    def resampled(self, fps: float) -> Clip:
        """Return the clip at another frame rate; UsageError for an invalid rate."""
        if not 0.0 < fps <= MAX_FPS:
            raise UsageError(f"{fps} frames per second: expected 0 to {MAX_FPS:.0f}.", "Try 60 or 30.")
        if fps == self.fps:
            return self
        count = math.floor(self.seconds * fps + 1e-6) + 1
        hips, local, contacts = self._at(np.arange(count) / fps)
        at = np.minimum(np.round(np.arange(count) / fps * self.fps).astype(np.int64), len(self) - 1)
        gaits = None if self.gaits is None else self.gaits[at]
        return replace(
            self, fps=fps, hips_positions=hips, local_rotations=local, contacts=contacts, gaits=gaits
        )

    def _at(self, seconds: Array) -> tuple[Array, Array, Array]:
        """Hips, local rotations and contacts at times, by a cubic through the four nearest frames."""
        at = np.clip(np.asarray(seconds, np.float64) * self.fps, 0.0, len(self) - 1.0)
        before = np.minimum(np.floor(at + 1e-9).astype(np.int64), max(len(self) - 2, 0))
        t = np.clip(at - before, 0.0, 1.0)
        around = np.clip(before[:, None] + np.arange(-1, 3), 0, len(self) - 1)
        weights = _cubic(t, before > 0, before < len(self) - 2)
        hips = np.einsum("nk,nkc->nc", weights, self.hips_positions[around].astype(np.float64))
        turns = self.local_rotations[around].astype(np.float64)
        sign = np.sign(np.sum(turns * turns[:, 1:2], axis=-1, keepdims=True))
        local = rotations.normalize(
            np.einsum("nk,nkjc->njc", weights, turns * np.where(sign < 0.0, -1.0, 1.0))
        )
        nearest = np.minimum(before + 1, len(self) - 1)
        contacts = self.contacts[before] * (1.0 - t[:, None]) + self.contacts[nearest] * t[:, None]
        exact = t == 0.0
        hips[exact], local[exact] = self.hips_positions[before[exact]], self.local_rotations[before[exact]]
        return hips.astype(np.float32), local.astype(np.float32), contacts.astype(np.float32)


def _cubic(t: Array, has_before: NDArray[np.bool_], has_after: NDArray[np.bool_]) -> Array:
    """Weights `(n, 4)` of four samples for a position `t` between the middle two (Catmull and Rom 1974).

    Without one of the outer samples the curve is the parabola through the other three; without both, a line.
    """
    a, b = -0.5 * t * (1.0 - t) ** 2, -0.5 * t**2 * (1.0 - t)
    weights = np.stack([a, 1.0 - t - 2.0 * a + b, t - 2.0 * b + a, b], axis=-1)
    only_after, only_before = ~has_before & has_after, has_before & ~has_after
    weights[only_after] += a[only_after, None] * np.array([-1.0, 3.0, -3.0, 1.0])
    weights[only_before] += b[only_before, None] * np.array([1.0, -3.0, 3.0, -1.0])
    alone = ~has_before & ~has_after
    weights[alone] = np.stack([0.0 * t, 1.0 - t, t, 0.0 * t], axis=-1)[alone]
    return weights


def stacked(poses: Sequence[Pose]) -> tuple[Array, Array, Array]:
    """Return hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)` of poses, float32."""
    names = ("hips_position", "local_rotations", "contacts")
    hips, local, contacts = (
        np.stack([getattr(pose, name) for pose in poses]).astype(np.float32) for name in names
    )
    return hips, local, contacts


def are_poses(hips: Array, rotations: Array, contacts: Array) -> bool:
    """Return whether every frame of hips `(T, 3)`, local rotations `(T, 31, 4)` and contacts `(T, 4)` is valid, without NaN."""
    norms = np.sqrt(np.einsum("...i,...i", rotations, rotations))
    return bool(
        (np.abs(hips) <= MAX_DISTANCE_M).all()
        and (np.abs(norms - 1.0) <= MAX_NORM_ERROR).all()
        and ((contacts >= -0.5) & (contacts <= 1.5)).all()
    )


def shift_prompts(events: tuple[PromptEvent, ...], start: float, length: float) -> tuple[PromptEvent, ...]:
    """Return the events in force from `start` (seconds) on for a `length`, with times relative to the start."""
    before = [e for e in events if e.seconds <= start]
    within = [e for e in events if start < e.seconds <= start + length]
    kept = []
    if before:
        # a transition may still be in progress
        left = before[-1].seconds + before[-1].transition_seconds - start
        kept = [replace(before[-1], seconds=0.0, transition_seconds=max(left, 0.0))]
    return (*kept, *(replace(e, seconds=e.seconds - start) for e in within))


def _pose(hips: Array, local: Array, contacts: Array, ground_m: float) -> Pose:
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    root = np.array([hips[0], ground_m, hips[2]], np.float32)
    return Pose(hips, local, positions, world, contacts, root, float(rotations.yaw_of(local[0])))
