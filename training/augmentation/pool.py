"""Imported clips that layered ones are made of, drawn by style."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.errors import FileError
from runtime.terrain.height_map import Terrain
from training.augmentation.pose_edits import EditedMotion
from training.data.height_patches import Patches
from training.frames import PLAIN

NEUTRAL = 0.45  # share of clips that are built on neutral motion, where an edit shows most clearly
PLAIN_SHARE = 0.7  # of the neutral motion is plain: an edit's words stand beside these sentences most often


@dataclass(frozen=True)
class Source:
    """An imported clip that layers can be built on."""

    name: str
    style: str
    mirrored: bool
    source: str
    gait: np.ndarray
    motion: EditedMotion
    patches: Patches

    @property
    def key(self) -> str:
        return self.style + ("_m" if self.mirrored else "")


def load_source(path: Path) -> Source:
    """Read an imported clip."""
    try:
        with np.load(path, allow_pickle=False) as file:
            clip = {k: file[k] for k in file.files}
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: not a clip file.", "Run the importer again.") from error
    origin = clip["patch_origin"]
    cell = float(clip["patch_cell"])
    patches = Patches(clip["patch_heights"], (float(origin[0]), float(origin[1])), cell)
    ground = Terrain("patch", clip["patch_heights"][0].astype(np.float32), cell, patches.origin)
    motion = EditedMotion(
        clip["hips_positions"].astype(np.float64),
        clip["local_rotations"].astype(np.float64),
        clip["contacts"],
        ground,
        clip["gait"],
    )
    return Source(
        path.stem,
        str(clip["style"]),
        bool(clip["mirrored"]),
        str(clip["source"]),
        clip["gait"],
        motion,
        patches,
    )


class Pool:
    """Imported training clips by style, drawn so that styles count alike and neutral motion more."""

    def __init__(self, folder: Path) -> None:
        self.by_style: dict[str, list[Path]] = {}
        for path in sorted(folder.glob("*.npz")):
            with np.load(path, allow_pickle=False) as clip:
                long_enough = len(clip["gait"]) > 100
                if path.stem.startswith("layer_") or str(clip["split"]) != "train" or not long_enough:
                    continue
                self.by_style.setdefault(str(clip["style"]), []).append(path)
        if not self.by_style:
            raise FileError(f"{folder}: no training clips.", "Run `sport train import` first.")
        self._open: dict[Path, Source] = {}

    def draw(self, random: np.random.Generator, neutral: float = NEUTRAL) -> Source:
        """A clip; neutral ones with the given chance."""
        styles = sorted(self.by_style)
        normal = [s for s in styles if s.startswith("neutral")]
        if normal and random.random() < neutral:
            plain = PLAIN in normal and random.random() < PLAIN_SHARE
            style = PLAIN if plain else normal[int(random.integers(len(normal)))]
        else:
            style = styles[int(random.integers(len(styles)))]
        paths = self.by_style[style]
        path = paths[int(random.integers(len(paths)))]
        if path not in self._open:
            if len(self._open) > 400:
                self._open.clear()
            self._open[path] = load_source(path)
        return self._open[path]
