"""Common representation of captured and generated motion, its windows, and measures of change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.errors import FileError
from runtime.motion import features
from runtime.motion.features import FPS
from runtime.safe_read import open_npz
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from training.data.clips import Patches
from training.frames import RootPath

WINDOW_SAMPLES = 40  # T of the content encoder
WINDOW_STRIDE = 2  # frames between two samples, as in stage 1
WINDOW_FRAMES = WINDOW_STRIDE * (WINDOW_SAMPLES - 1) + 1
UNDER_BODY_FRAMES = np.arange(-15, 16)  # about a step: average of the height under a body
GESTURES = ("raise_", "wave_")  # styles captured only standing


@dataclass(frozen=True)
class RootFeatures:
    """A root-relative motion, as in the networks' inputs (not normalised)."""

    joints: Array  # (T, 31, 3) metres; heights above the reference ground
    rotations: Array  # (T, 31, 6)
    velocity: Array  # (T, 3) m/s in x and z, rad/s


@dataclass(frozen=True)
class Motion:
    """World poses of the SPORT skeleton at 60 Hz on a terrain."""

    name: str
    style: str
    hips: Array  # (T, 3) metres
    local: Array  # (T, 31, 4)
    contacts: Array  # (T, 4) 0..1
    gait: NDArray[np.integer]  # (T,) runtime.controls.Gait, captured or requested
    terrain: Terrain
    held_out: bool = False
    source: str = ""
    unlocked: Array | None = None  # (T, 31, 3) positions before foot lock (generated motion)

    def __len__(self) -> int:
        return len(self.hips)

    @cached_property
    def positions(self) -> Array:
        """World joint positions `(T, 31, 3)`."""
        return SPORT_SKELETON.forward_kinematics(self.hips, self.local)[0]

    def cut(self, first: int, last: int) -> Motion:
        """Return frames `first` to `last - 1`."""
        keep = slice(first, last)
        unlocked = None if self.unlocked is None else self.unlocked[keep]
        return replace(
            self,
            hips=self.hips[keep],
            local=self.local[keep],
            contacts=self.contacts[keep],
            gait=self.gait[keep],
            unlocked=unlocked,
        )

    def root_features(self, under_body: bool = False) -> RootFeatures:
        """Return joints, rotations and velocity relative to the smoothed root, equally for captured and generated motion.

        Heights are relative to the networks' reference ground, or to the ground `under_body`: the former is the mean over a
        second of path before and after, which at an end of a flight of stairs is 30 cm off for a jogger.
        """
        positions, world = SPORT_SKELETON.forward_kinematics(
            self.hips.astype(np.float64), self.local.astype(np.float64)
        )
        path = RootPath.of(positions)
        points = features.height_points(path.padded_root[path.window], path.directions[path.window])
        ground = features.ground_height(self.terrain.height(points[..., 0], points[..., 1]))
        if under_body:
            x, z = np.moveaxis(path.padded_root[path.now[:, None] + UNDER_BODY_FRAMES], -1, 0)
            ground = self.terrain.height(x, z).mean(1)
        return RootFeatures(
            features.relative_joints(positions, path.root, ground, path.yaw).astype(np.float32),
            features.relative_rotations(world, path.yaw).astype(np.float32),
            path.velocity.astype(np.float32),
        )


def mean_speed(positions: Array) -> float:
    """Return the mean root speed in m/s of world joints `(T, 31, 3)`, without the sway of steps."""
    half, xz = FPS // 2, positions[:, 0, ::2].astype(np.float64)
    return float(np.linalg.norm(xz[half:] - xz[:-half], axis=-1).mean() * FPS / half)


def load_motion(path: Path) -> Motion:
    """Load a clip file of the importer with its own ground; FileError for other files."""
    with open_npz(path, "Run the importer again.") as clip:
        return Motion(
            path.stem,
            str(clip["style"]),
            clip["hips_positions"],
            clip["local_rotations"],
            clip["contacts"].astype(np.float32),
            clip["gait"].argmax(1),
            Patches.of(clip).terrain(name=path.stem),
            str(clip["split"]) == "held_out",
            str(clip["source"]),
        )


def original_clips(folder: Path) -> list[Path]:
    """List clip files without mirror images (`_m`) and copies on synthetic terrain (`_t`); FileError if there are none."""
    paths = [p for p in sorted(folder.glob("*.npz")) if not p.stem.endswith(("_m", "_t"))]
    if not paths:
        raise FileError(
            f"{folder}: no clips (*.npz).", "Run `sport train import --data DIR --out DIR` first."
        )
    return paths


def window_starts(frames: int, hop: int) -> NDArray[np.int64]:
    """Return the first frames of the windows of 40 samples in a motion, `hop` frames apart."""
    return np.arange(0, frames - WINDOW_FRAMES + 1, hop, dtype=np.int64)


def window_index(starts: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the frames `(N, 40)` of windows."""
    return np.asarray(starts)[:, None] + WINDOW_STRIDE * np.arange(WINDOW_SAMPLES)


# --- smoothness and diversity -------------------------------------------------------------------------------------------

DIVERSITY_FRAMES = 180  # as in the paper
DIVERSITY_LEAD_IN = 60  # frames at temperature 0, so that both motions of a pair start in the same pose


def jerk(positions: Array) -> Array:
    """Return the norm of the third derivative `(T - 3, joints)` in m/s^3 of world joints `(T, joints, 3)` at 60 Hz."""
    return np.linalg.norm(np.diff(positions.astype(np.float64), n=3, axis=0), axis=-1) * FPS**3


def transition_jerk(positions: Array, change: int, blend: int = FPS) -> float:
    """Return the ratio of mean jerk around a change of prompt to that within the styles; 1 is as smooth as the styles.

    The prompt of `(T, joints, 3)` changes at frame `change` and blends over `blend` frames. The styles are measured on
    equally many frames before the change, and from half a second after the blend. A late jump falls into that half
    second, which is used instead of the blend if it has more jerk.
    """
    begin = change + blend + FPS // 2
    parts = np.split(positions[change - blend : begin + blend], [blend, 2 * blend, begin - change + blend])
    if min(map(len, parts)) < 8:
        raise ValueError(f"{len(positions)} frames are too few for a change at frame {change}")
    before, during, settling, after = (float(jerk(part).mean()) for part in parts)
    inside = 0.5 * (before + after)
    return max(during, settling) / inside if inside > 0 else float("nan")


def pair_distance(first: Array, second: Array) -> float:
    """Return the mean over frames of ||p^1 - p^2||_2, metres, the norm over all 31 joints of root-relative poses `(T, 31, 3)`."""
    difference = (first - second).astype(np.float64)
    return float(np.linalg.norm(difference.reshape(len(difference), -1), axis=-1).mean())
