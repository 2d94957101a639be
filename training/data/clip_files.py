"""One file per training clip."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.skeleton import mirror_motion
from training.data.height_patches import Patches


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
        """The clip reflected through X = 0, named `<name>_m`."""
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
            hips_positions=self.hips.astype(np.float32),
            local_rotations=self.local.astype(np.float32),
            contacts=self.contacts.astype(np.uint8),
            gait=self.gait.astype(np.float32),
            style=self.style,
            content=self.content,
            source=self.source,
            split=self.split,
            mirrored=self.mirrored,
            tier=self.tier,
            patch_heights=self.patches.heights.astype(np.float16),
            patch_origin=np.array(self.patches.origin, np.float32),
            patch_cell=np.float32(self.patches.cell),
        )
        return path
