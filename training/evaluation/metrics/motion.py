"""One form for captured and generated motion, so that both are scored by the same code; windows over it; how it changes."""

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
UNDER_BODY_FRAMES = np.arange(-15, 16)  # of the path whose mean height is that under a body: about a step
GESTURES = ("raise_", "wave_")  # styles that were captured standing only


@dataclass(frozen=True)
class RootFeatures:
    """A motion relative to its root, as the networks see it (un-normalised)."""

    joints: Array  # (T, 31, 3) metres; heights over the reference ground
    rotations: Array  # (T, 31, 6)
    velocity: Array  # (T, 3) m/s in x and z, rad/s


@dataclass(frozen=True)
class Motion:
    """World poses of the SPORT skeleton at 60 Hz over a ground."""

    name: str
    style: str
    hips: Array  # (T, 3) metres
    local: Array  # (T, 31, 4)
    contacts: Array  # (T, 4) 0..1
    gait: NDArray[np.integer]  # (T,) labels of runtime.controls.Gait: captured, or requested
    terrain: Terrain
    held_out: bool = False
    source: str = ""
    unlocked: Array | None = None  # (T, 31, 3) positions before foot lock (generated motion)

    def __len__(self) -> int:
        return len(self.hips)

    @cached_property
    def positions(self) -> Array:
        """World joints `(T, 31, 3)`."""
        return SPORT_SKELETON.forward_kinematics(self.hips, self.local)[0]

    def cut(self, first: int, last: int) -> Motion:
        """Frames `first` to `last - 1`."""
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
        """Joints, rotations and velocity relative to the smoothed root: the same for capture and for what is generated.

        Heights are over the networks' reference ground, or over the ground `under_body`: the former is a second of path
        before and behind, by which a jogger at an end of a flight of stairs is 30 cm too high or too low.
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
    """Mean speed in m/s of the root of world joints `(T, 31, 3)`, without the sway of single steps."""
    half, xz = FPS // 2, positions[:, 0, ::2].astype(np.float64)
    return float(np.linalg.norm(xz[half:] - xz[:-half], axis=-1).mean() * FPS / half)


def load_motion(path: Path) -> Motion:
    """A clip file of the importer on its own ground; FileError when it is none."""
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
    """Clip files without mirror images (`_m`) and copies on made terrain (`_t`); FileError when there is none."""
    paths = [p for p in sorted(folder.glob("*.npz")) if not p.stem.endswith(("_m", "_t"))]
    if not paths:
        raise FileError(
            f"{folder}: no clips (*.npz).", "Run `sport train import --data DIR --out DIR` first."
        )
    return paths


def window_starts(frames: int, hop: int) -> NDArray[np.int64]:
    """First frames of the windows of 40 samples that fit into a motion, `hop` frames apart."""
    return np.arange(0, frames - WINDOW_FRAMES + 1, hop, dtype=np.int64)


def window_index(starts: NDArray[np.integer]) -> NDArray[np.int64]:
    """Frames `(N, 40)` of windows."""
    return np.asarray(starts)[:, None] + WINDOW_STRIDE * np.arange(WINDOW_SAMPLES)


# --- how motion changes -------------------------------------------------------------------------------------------------

DIVERSITY_FRAMES = 180  # of the paper
DIVERSITY_LEAD_IN = 60  # frames at temperature 0, so that both of a pair begin in the same pose


def jerk(positions: Array) -> Array:
    """Size of the third derivative `(T - 3, joints)` in m/s^3 of world joints `(T, joints, 3)` at 60 Hz."""
    return np.linalg.norm(np.diff(positions.astype(np.float64), n=3, axis=0), axis=-1) * FPS**3


def transition_jerk(positions: Array, change: int, blend: int = FPS) -> float:
    """Mean jerk around a change over that inside the styles: 1 is a transition as smooth as the styles themselves.

    The prompt of `(T, joints, 3)` changes at frame `change` and blends over `blend` frames. Inside are the same number
    of frames before the change, and those that begin half a second after the blend's end. A late jump falls into that
    half second: it counts where it is rougher than the blend itself.
    """
    begin = change + blend + FPS // 2
    parts = np.split(positions[change - blend : begin + blend], [blend, 2 * blend, begin - change + blend])
    if min(map(len, parts)) < 8:
        raise ValueError(f"{len(positions)} frames are too few for a change at {change}")
    before, during, settling, after = (float(jerk(part).mean()) for part in parts)
    inside = 0.5 * (before + after)
    return max(during, settling) / inside if inside > 0 else float("nan")


def pair_distance(first: Array, second: Array) -> float:
    """Mean over frames of ||p^1 - p^2||_2, metres: the norm over all 31 joints of poses `(T, 31, 3)` relative to the root."""
    difference = (first - second).astype(np.float64)
    return float(np.linalg.norm(difference.reshape(len(difference), -1), axis=-1).mean())
