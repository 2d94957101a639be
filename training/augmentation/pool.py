"""Imported clips as sources of edited ones, sampled by style."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from runtime.errors import FileError
from runtime.safe_read import open_npz
from training.augmentation.motion import EditedMotion
from training.data.clips import Patches
from training.frames import PLAIN

NEUTRAL_FRACTION = 0.45  # of source clips that are neutral, where edits are clearest
PLAIN_FRACTION = 0.7  # of neutral sources, in the style that most prompts describe


@dataclass(frozen=True)
class Source:
    """An imported clip to edit."""

    name: str
    style: str
    mirrored: bool
    source: str
    motion: EditedMotion
    patches: Patches

    @property
    def key(self) -> str:
        return self.style + ("_m" if self.mirrored else "")


def load_source(path: Path) -> Source:
    """Read an imported clip to edit."""
    with open_npz(path, "Run the importer again.") as file:
        clip = {k: file[k] for k in file.files}
    patches = Patches.of(clip)
    motion = EditedMotion(
        clip["hips_positions"].astype(np.float64),
        clip["local_rotations"].astype(np.float64),
        clip["contacts"],
        patches.terrain(),
        clip["gait"],
    )
    style, source, mirrored = str(clip["style"]), str(clip["source"]), bool(clip["mirrored"])
    return Source(path.stem, style, mirrored, source, motion, patches)


class Pool:
    """Imported training clips, sampled uniformly over styles, neutral motion more often."""

    def __init__(self, folder: Path) -> None:
        self.by_style: dict[str, list[Path]] = {}
        for path in sorted(folder.glob("*.npz")):
            with open_npz(path, "Run the importer again.") as clip:
                long_enough = len(clip["gait"]) > 100
                if path.stem.startswith("layer_") or str(clip["split"]) != "train" or not long_enough:
                    continue
                self.by_style.setdefault(str(clip["style"]), []).append(path)
        if not self.by_style:
            raise FileError(f"{folder}: no training clips.", "Run `sport train import` first.")
        self._load = lru_cache(maxsize=400)(load_source)

    def draw(self, random: np.random.Generator, neutral: float = NEUTRAL_FRACTION) -> Source:
        """Draw a clip, a neutral one with the given probability."""
        styles = sorted(self.by_style)
        normal = [s for s in styles if s.startswith("neutral")]
        if normal and random.random() < neutral:
            plain = PLAIN in normal and random.random() < PLAIN_FRACTION
            style = PLAIN if plain else normal[int(random.integers(len(normal)))]
        else:
            style = styles[int(random.integers(len(styles)))]
        paths = self.by_style[style]
        return self._load(paths[int(random.integers(len(paths)))])
