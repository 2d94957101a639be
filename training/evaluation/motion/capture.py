"""The captured side: which clips there are, which parts of them the character is led along, and their windows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.controls import Gait
from runtime.errors import FileError
from runtime.motion.features import FPS
from training.evaluation.motion.motion import WINDOW_FRAMES, Motion, load_motion, original_clips

Array = NDArray[np.floating]

ROLLOUTS = "pfnn_rollouts"  # distilled motion of a published network on uneven ground: no capture
LAYERED = "layered"  # clips with edited or recombined body parts: no capture either
TERRAIN_GROUP = "neutral (rollouts)"
MAX_SEGMENT_FRAMES = 8 * FPS


@dataclass(frozen=True)
class ClipInfo:
    """What the catalogue knows of a clip file."""

    path: Path
    group: str  # its style; the rollouts are a group of their own
    style: str
    held_out: bool
    frames: int
    gaits: dict[Gait, int]  # frames of each


@dataclass(frozen=True)
class Segment:
    """Frames `first` to `last - 1` of a captured clip."""

    clip: ClipInfo
    first: int
    last: int

    @property
    def seconds(self) -> float:
        return (self.last - self.first) / FPS

    def load(self) -> Motion:
        """The captured motion of the segment."""
        return load_motion(self.clip.path).cut(self.first, self.last)


@dataclass(frozen=True)
class Capture:
    """All original clips (no mirror images, no copies on made terrain, no layered styles)."""

    clips: tuple[ClipInfo, ...]

    def of(self, group: str, held_out: bool | None = None) -> list[ClipInfo]:
        """Clips of a group, of both splits unless one is asked for."""
        return [c for c in self.clips if c.group == group and held_out in (None, c.held_out)]

    @property
    def groups(self) -> list[str]:
        """Styles with captured clips, without the rollouts."""
        return sorted({c.group for c in self.clips} - {TERRAIN_GROUP})

    def seconds(self, group: str, gait: Gait, held_out: bool | None = None) -> float:
        """Captured time of a group in a gait."""
        return sum(c.gaits.get(gait, 0) for c in self.of(group, held_out)) / FPS


def read_capture(folder: Path, styles: Iterable[str] | None = None) -> Capture:
    """Catalogue of `*.npz` under `folder`; FileError when a style that is asked for has no clips."""
    wanted = None if styles is None else set(styles)
    found = [info for info in map(_info, original_clips(folder)) if info is not None]
    clips = [c for c in found if wanted is None or c.style in wanted]
    missing = (wanted or set()) - {c.style for c in clips}
    if missing:
        raise FileError(
            f"{folder}: no clips of {', '.join(sorted(missing))}.",
            "Choose styles of assets/prompts/styles.json.",
        )
    return Capture(tuple(c for c in clips if c.frames >= WINDOW_FRAMES))


def _info(path: Path) -> ClipInfo | None:
    """None for what was made out of other clips."""
    try:
        with np.load(path, allow_pickle=False) as clip:
            if str(clip["tier"]) == LAYERED or bool(clip["mirrored"]):
                return None
            labels, counts = np.unique(clip["gait"].argmax(1), return_counts=True)
            style, rollout = str(clip["style"]), str(clip["source"]) == ROLLOUTS
            held_out = str(clip["split"]) == "held_out"
    except (OSError, ValueError, KeyError) as error:
        raise FileError(f"{path}: not a clip file.", "Run the importer again.") from error
    gaits = {Gait(int(g)): int(n) for g, n in zip(labels, counts, strict=True)}
    return ClipInfo(path, TERRAIN_GROUP if rollout else style, style, held_out, int(counts.sum()), gaits)


def driving_segments(
    capture: Capture, group: str, seconds: float, seed: int = 0, max_frames: int = MAX_SEGMENT_FRAMES
) -> list[Segment]:
    """Parts of a group's clips to lead the character along: held-out ones first, then training ones, up to `seconds`.

    A long clip gives one part of at most `max_frames` at a random place.
    """
    rng = np.random.default_rng([seed, *group.encode()])
    order = [c for split in (True, False) for c in _shuffled(capture.of(group, split), rng)]
    result: list[Segment] = []
    left = seconds * FPS
    for clip in order:
        if left < WINDOW_FRAMES:
            break
        length = min(clip.frames, max_frames, max(WINDOW_FRAMES, round(left)))
        first = int(rng.integers(0, clip.frames - length + 1))
        result.append(Segment(clip, first, first + length))
        left -= length
    return result


def _shuffled(clips: list[ClipInfo], rng: np.random.Generator) -> list[ClipInfo]:
    return [clips[i] for i in rng.permutation(len(clips))]


def motions(clips: Iterable[ClipInfo]) -> Iterator[tuple[ClipInfo, Motion]]:
    """Clips with their motion, read one at a time."""
    for clip in clips:
        yield clip, load_motion(clip.path)
