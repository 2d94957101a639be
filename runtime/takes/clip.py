"""Takes: an immutable clip of poses, and BVH in and out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.atomic import write_atomic, write_new
from runtime.errors import FileError, UsageError
from runtime.pose import Pose
from runtime.safe_read import printable
from runtime.skeleton import SPORT_SKELETON, J
from runtime.takes.bvh import BvhMotion, check_size, format_bvh, read_bvh
from runtime.takes.metadata import (
    UNKNOWN,
    UNMOVED,
    Origin,
    PromptEvent,
    describe,
    gait_numbers,
    gait_seconds,
    read_metadata,
)
from runtime.takes.sidecar import write_sidecar

__all__ = ["Clip", "OtherSkeleton", "PromptEvent", "check_bvh_options", "load_clip_bvh", "save_bvh"]

Array = NDArray[np.floating]

UNITS_PER_METRE = {"cm": 100.0, "m": 1.0}
ROTATION_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
MAX_FPS = 1000.0
_OWN_BVH = "Open a BVH that this program has written."
MAX_DISTANCE_M = 100_000.0  # of a clip's hips from the origin; float32 is then 8 mm fine
# where the bones without a child end, metres; readers draw and measure leaf bones by it
END_OFFSETS = {
    5: np.array([0.0, 0.0, 0.06], np.float32),
    10: np.array([0.0, 0.0, 0.06], np.float32),
    16: np.array([0.0, 0.18, 0.02], np.float32),
    22: np.array([0.04, 0.0, 0.0], np.float32),
    23: np.array([0.03, 0.0, 0.03], np.float32),
    29: np.array([-0.04, 0.0, 0.0], np.float32),
    30: np.array([-0.03, 0.0, 0.03], np.float32),
}


class OtherSkeleton(FileError):
    """A BVH that is sound, but not of the SPORT skeleton."""


@dataclass(frozen=True)
class Clip:
    """Poses of the SPORT skeleton at a fixed rate, as they were on the screen."""

    name: str
    fps: float
    hips_positions: Array  # (T, 3) metres, world
    local_rotations: Array  # (T, 31, 4)
    contacts: Array  # (T, 4) 0..1: left heel, left toe, right heel, right toe
    prompts: tuple[PromptEvent, ...] = ()
    terrain: str = "flat"  # name or file of the ground it was made on
    origin: Origin = UNKNOWN  # model, seed and settings
    gait_seconds: tuple[tuple[str, float], ...] = ()  # how long each gait was asked for
    gaits: NDArray[np.int8] | None = None  # (T,) asked for in each frame; None where not known
    # yaw and x, y, z by which the take was moved from its place on its ground; None: it no longer goes over it
    placed: tuple[float, ...] | None = UNMOVED

    def __post_init__(self) -> None:
        n = len(self.hips_positions)
        shapes = (self.hips_positions.shape, self.local_rotations.shape, self.contacts.shape)
        if n < 1 or shapes != ((n, 3), (n, J, 4), (n, 4)):
            raise ValueError(f"clip arrays {shapes}: expected (T, 3), (T, {J}, 4), (T, 4) with T >= 1")
        if not 0.0 < self.fps <= MAX_FPS:
            raise ValueError(f"clip of {self.fps} frames per second: expected 0 to {MAX_FPS:.0f}")

    def __len__(self) -> int:
        return len(self.hips_positions)

    @property
    def seconds(self) -> float:
        """Time from the first to the last frame."""
        return (len(self) - 1) / self.fps

    def describe(self) -> str:
        """How it was made, in some lines for a person; "" when nothing is known."""
        return describe(self.terrain, self.prompts, self.origin, dict(self.gait_seconds))

    def pose(self, i: int, ground_m: float = 0.0) -> Pose:
        """The pose of frame `i`; `ground_m` is the height of the terrain under it."""
        return _pose(self.hips_positions[i], self.local_rotations[i], self.contacts[i], ground_m)

    def sample(self, seconds: float, ground_m: float = 0.0) -> Pose:
        """The pose at a time, interpolated; times outside the clip give its ends."""
        hips, local, contacts = self._at(np.array([seconds]))
        return _pose(hips[0], local[0], contacts[0], ground_m)

    def world(self) -> tuple[Array, Array]:
        """World positions `(T, 31, 3)` and rotations `(T, 31, 4)`."""
        return SPORT_SKELETON.forward_kinematics(self.hips_positions, self.local_rotations)

    def trim(self, first: int, last: int) -> Clip:
        """Frames `first` to `last`, both included."""
        if not 0 <= first <= last < len(self):
            raise UsageError(
                f"trim {first} to {last}: the clip has frames 0 to {len(self) - 1}.", "Choose others."
            )
        keep = slice(first, last + 1)
        gaits = None if self.gaits is None else self.gaits[keep]
        return replace(
            self,
            gaits=gaits,
            gait_seconds=() if gaits is None else tuple(gait_seconds(gaits, self.fps).items()),
            hips_positions=self.hips_positions[keep],
            local_rotations=self.local_rotations[keep],
            contacts=self.contacts[keep],
            prompts=shift_prompts(self.prompts, first / self.fps, (last - first) / self.fps),
        )

    def resampled(self, fps: float) -> Clip:
        """The same motion at another rate, from the same first frame."""
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
        at = np.clip(np.asarray(seconds, np.float64) * self.fps, 0.0, len(self) - 1.0)
        before = np.floor(at + 1e-9).astype(np.int64)
        after = np.minimum(before + 1, len(self) - 1)
        share = np.clip(at - before, 0.0, 1.0)
        t = share[:, None]
        hips = self.hips_positions[before] * (1 - t) + self.hips_positions[after] * t
        contacts = self.contacts[before] * (1 - t) + self.contacts[after] * t
        local = rotations.slerp(self.local_rotations[before], self.local_rotations[after], t)
        return hips.astype(np.float32), local.astype(np.float32), contacts.astype(np.float32)


def check_bvh_options(fps: float, unit: str, order: str = "ZYX") -> None:
    """UsageError when `save_bvh` cannot write with these options."""
    if not 1.0 <= fps <= MAX_FPS:
        raise UsageError(f"{fps} frames per second: expected 1 to {MAX_FPS:.0f}.", "Try 60 or 30.")
    if unit not in UNITS_PER_METRE:
        raise UsageError(f"unit '{unit}': expected cm or m.", "Choose one of the two.")
    if order.upper() not in ROTATION_ORDERS:
        raise UsageError(f"rotation order '{order}': unknown.", f"Choose {', '.join(ROTATION_ORDERS)}.")


def check_bvh_length(seconds: float, fps: float) -> None:
    """UsageError when a clip of `seconds` at `fps` is longer than a BVH that `load_clip_bvh` reads."""
    frames = min(seconds * fps, 1e12)  # what is not finite is refused by those who make a clip
    check_size(J, math.ceil(frames) if frames >= 0.0 else 0, f"{seconds:g} s at {fps:g} frames per second")


def save_bvh(
    clip: Clip, path: str | Path, fps: float = 60.0, unit: str = "cm", order: str = "ZYX", new: bool = False
) -> Path:
    """Write a BVH that appears whole or not at all, and its `sidecar_path`; the BVH's path.

    With `new` no file is replaced: a name that is taken becomes name-2, name-3, … .
    `fps` resamples the clip, `unit` is "cm" or "m", `order` one of `ROTATION_ORDERS`. UsageError or FileError.
    """
    check_bvh_options(fps, unit, order)
    check_bvh_length(clip.seconds, fps)
    at_rate = clip.resampled(fps)
    scale = UNITS_PER_METRE[unit]
    text = format_bvh(
        SPORT_SKELETON,
        at_rate.hips_positions,
        at_rate.local_rotations,
        fps,
        units_per_metre=scale,
        order=order,
        end_offsets=END_OFFSETS,
    )
    path = Path(path)
    if new:
        path = write_new(path, text)
    else:
        write_atomic(path, text)
    write_sidecar(clip, path, text)
    return path


def load_clip_bvh(path: str | Path) -> Clip:
    """A clip from a BVH of the 31-joint SPORT skeleton in any unit, channel order and joint order.

    FileError names the joints that are missing or rest otherwise, or a rate that no clip has. Contacts are zero: a
    BVH has none.
    Prompts and origin are those of the file beside it, where that file belongs to this BVH.
    """
    path = Path(path)
    motion = read_bvh(path)
    fps = float(round(motion.fps, 3))
    if not 0.0 < fps <= MAX_FPS:
        raise FileError(f"{path}: {fps:g} frames per second; expected at most {MAX_FPS:.0f}.", _OWN_BVH)
    order = _joint_order(motion, path)
    scale = _metres_per_unit(motion, order, path)
    hips, local = _in_world(motion, order, path)
    hips = hips * scale
    if not np.abs(hips).max() <= MAX_DISTANCE_M:
        raise FileError(f"{path}: the hips are further than {MAX_DISTANCE_M / 1000:.0f} km away.", _OWN_BVH)
    made = read_metadata(path)
    return Clip(
        name=printable(path.stem),
        fps=fps,
        hips_positions=hips.astype(np.float32),
        local_rotations=local,
        contacts=np.zeros((len(motion.positions), 4), np.float32),
        prompts=made.prompts,
        terrain=made.terrain,
        origin=made.origin,
        gait_seconds=made.gait_seconds,
        gaits=gait_numbers(made.gait_changes, len(motion.positions), fps),
        placed=made.placed,
    )


def _joint_order(motion: BvhMotion, path: Path) -> list[int]:
    """Where each joint of the SPORT skeleton is in the file; FileError names those that are missing."""
    missing = [name for name in SPORT_SKELETON.names if name not in motion.skeleton.names]
    if missing:
        more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
        raise OtherSkeleton(f"{path}: joint {', '.join(missing[:4])}{more} is missing.", _OWN_BVH)
    return [motion.skeleton.index(name) for name in SPORT_SKELETON.names]


def _in_world(motion: BvhMotion, order: list[int], path: Path) -> tuple[Array, Array]:
    """Hips `(T, 3)` in the file's unit and local rotations `(T, 31, 4)`, the hips turned and moved by a root above."""
    hips, local = motion.positions[:, order[0]], motion.local_rotations
    if order != list(range(len(motion.skeleton))):
        local = local[:, order]
    above = motion.skeleton.parents[order[0]]
    if above < 0:
        return hips, local
    if motion.skeleton.parents[above] >= 0:
        raise OtherSkeleton(f"{path}: expected the joint Hips as ROOT, or one joint above it.", _OWN_BVH)
    turn = motion.local_rotations[:, above]
    hips = motion.positions[:, above] + rotations.rotate(turn, hips)
    local[:, 0] = rotations.multiply(turn, local[:, 0])
    return hips, local


def _metres_per_unit(motion: BvhMotion, order: list[int], path: Path) -> float:
    """Scale of a file whose rest pose is the SPORT skeleton's but for its unit."""
    for name, j in zip(SPORT_SKELETON.names, order, strict=True):
        parent = motion.skeleton.parents[j]
        ours = SPORT_SKELETON.parents[SPORT_SKELETON.index(name)]
        if ours >= 0 and (parent < 0 or motion.skeleton.names[parent] != SPORT_SKELETON.names[ours]):
            raise OtherSkeleton(
                f"{path}: joint {name} is not a child of {SPORT_SKELETON.names[ours]}.",
                _OWN_BVH,
            )
    theirs = motion.skeleton.offsets[order].astype(np.float64)
    wanted = SPORT_SKELETON.offsets.astype(np.float64)
    theirs[0] = wanted[0] = 0.0
    total = float(np.sum(theirs * theirs))
    scale = float(np.sum(theirs * wanted)) / total if total > 0.0 else 0.0
    difference = np.linalg.norm(theirs * scale - wanted, axis=-1)
    worst = int(np.argmax(difference))
    if scale <= 0.0 or difference[worst] > 0.01:
        raise OtherSkeleton(
            f"{path}: joint {SPORT_SKELETON.names[worst]} rests {difference[worst] * 100:.0f} cm from its"
            " place in the SPORT skeleton.",
            _OWN_BVH,
        )
    for unit in UNITS_PER_METRE.values():  # offsets are rounded in the file, the unit is not
        if abs(scale * unit - 1.0) < 1e-3:
            return 1.0 / unit
    return scale


def shift_prompts(events: tuple[PromptEvent, ...], start: float, length: float) -> tuple[PromptEvent, ...]:
    """Events seen from `start` on: the one in force there, and those within `length` seconds after it."""
    before = [e for e in events if e.seconds <= start]
    within = [e for e in events if start < e.seconds <= start + length]
    kept = []
    if before:
        left = (
            before[-1].seconds + before[-1].transition_seconds - start
        )  # a transition may still be under way
        kept = [replace(before[-1], seconds=0.0, transition_seconds=max(left, 0.0))]
    return (*kept, *(replace(e, seconds=e.seconds - start) for e in within))


def _pose(hips: Array, local: Array, contacts: Array, ground_m: float) -> Pose:
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    facing = rotations.rotate(local[0], np.array([0.0, 0.0, 1.0], np.float32))
    root = np.array([hips[0], ground_m, hips[2]], np.float32)
    yaw = math.atan2(float(facing[0]), float(facing[2]))
    return Pose(hips, local, positions, world, contacts, root, yaw)
