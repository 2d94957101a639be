"""Training clips: labelled motion of the SPORT skeleton, with ground patches that fit its footsteps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.safe_read import open_npz
from runtime.skeleton import mirror_motion
from runtime.terrain.height_map import Terrain

CELL_M = 0.15
FLAT_MARGIN_M = 1.5
RELIEF_MARGIN_M = 2.5


@dataclass(frozen=True)
class Patches:
    """K height maps on one grid: `heights` `(K, n, m)` metres, [0, 0] at `origin` (x, z), `cell` metres apart."""

    heights: Array
    origin: tuple[float, float]
    cell: float

    @staticmethod
    def of(clip: Mapping[str, Array]) -> Patches:
        """Read the patches of a clip file."""
        x, z = map(float, clip["patch_origin"])
        return Patches(clip["patch_heights"], (x, z), float(clip["patch_cell"]))

    def terrain(self, k: int = 0, name: str = "patch") -> Terrain:
        """Return patch `k` as a terrain."""
        return Terrain(name, self.heights[k].astype(np.float32), self.cell, self.origin)

    def mirrored(self) -> Patches:
        """Return the patches reflected at the plane X = 0."""
        width = (self.heights.shape[1] - 1) * self.cell
        return Patches(self.heights[:, ::-1].copy(), (-(self.origin[0] + width), self.origin[1]), self.cell)


CLIP_TEXTS = ("style", "content", "source", "split", "tier")  # text fields of a clip and of its file


@dataclass(frozen=True)
class TrainingClip:
    """A labelled motion of the SPORT skeleton at 60 Hz, with the ground under it."""

    name: str
    hips: Array  # (T, 3) metres
    local: Array  # (T, 31, 4)
    contacts: NDArray[np.uint8]  # (T, 4)
    gait: Array  # (T, 6)
    style: str
    content: str
    source: str
    split: str  # "train" or "held_out"
    tier: str  # "exact" or "estimated_root"
    patches: Patches
    mirrored: bool = False

    def mirror(self) -> TrainingClip:
        """Return the clip reflected at the plane X = 0, named `<name>_m`."""
        hips, local = mirror_motion(self.hips, self.local)
        return replace(
            self,
            name=self.name + "_m",
            hips=hips,
            local=rotations.continuous(local),
            contacts=self.contacts[:, [2, 3, 0, 1]],
            patches=self.patches.mirrored(),
            mirrored=not self.mirrored,
        )

    def save(self, folder: Path) -> Path:
        """Write `<folder>/<name>.npz`, uncompressed."""
        path = folder / f"{self.name}.npz"
        np.savez(
            path,
            **{name: getattr(self, name) for name in CLIP_TEXTS},
            hips_positions=self.hips.astype(np.float32),
            local_rotations=self.local.astype(np.float32),
            contacts=self.contacts.astype(np.uint8),
            gait=self.gait.astype(np.float32),
            mirrored=self.mirrored,
            patch_heights=self.patches.heights.astype(np.float16),
            patch_origin=np.array(self.patches.origin, np.float32),
            patch_cell=np.float32(self.patches.cell),
        )
        return path


def grid_under(
    positions: Array, margin: float, cell: float = CELL_M
) -> tuple[tuple[float, float], tuple[int, int]]:
    """Return origin and size of a grid that covers joint positions `(T, J, 3)` and `margin` metres around."""
    low = positions[..., [0, 2]].reshape(-1, 2).min(0) - margin
    high = positions[..., [0, 2]].reshape(-1, 2).max(0) + margin
    n, m = (int(v) for v in np.ceil((high - low) / cell) + 1)
    return (float(low[0]), float(low[1])), (n, m)


def load_rollout_terrain(path: Path) -> tuple[Array, float]:
    """Read heights `(n, m)` and cell size, both in metres, of a height map of the rollouts."""
    with open_npz(path, "Unpack the archive again.") as data:
        return np.asarray(data["height_cm"], np.float64) * 0.01, float(data["cell_cm"]) * 0.01


def wrapped_height(heights: Array, cell: float, x: Array, z: Array) -> Array:
    """Return the bilinear height at x, z of a periodic map centred on the origin."""
    n, m = heights.shape
    u, v = np.asarray(x) / cell + n / 2, np.asarray(z) / cell + m / 2
    i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    fu, fv = u - i, v - j
    i, j = i % n, j % m
    i1, j1 = (i + 1) % n, (j + 1) % m
    low = heights[i, j] * (1 - fu) + heights[i1, j] * fu
    return low * (1 - fv) + (heights[i, j1] * (1 - fu) + heights[i1, j1] * fu) * fv


def crop_rollout(heights: Array, cell: float, positions: Array) -> Patches:
    """Crop a periodic height map to the surroundings of a clip, in cells of 10 cm."""
    origin, (n, m) = grid_under(positions, RELIEF_MARGIN_M, 0.1)
    x = origin[0] + np.arange(n)[:, None] * 0.1
    z = origin[1] + np.arange(m)[None, :] * 0.1
    x, z = np.broadcast_arrays(x, z)
    return Patches(wrapped_height(heights, cell, x, z)[None], origin, 0.1)
