"""What training knows of a data set: its licence, its files, its skeletons and how it is to be read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from runtime.formats.bvh import BvhMotion, read_bvh
from training.data.source_skeletons import SourceSkeleton


@dataclass(frozen=True)
class ClipSource:
    """One file to import."""

    path: Path
    name: str  # unique among all sources
    source: str
    style: str
    content: str
    tier: str = "exact"
    terrain: str = "flat"  # "flat", "rollout" (known height map) or "contacts" (to be fitted)
    capture: str = (
        ""  # files of one skeleton and one person or studio, calibrated together; by default the source
    )

    def __post_init__(self) -> None:
        if not self.capture:
            object.__setattr__(self, "capture", self.source)


@dataclass(frozen=True)
class Refusal:
    """A file, or a part of it, that does not enter the training clips."""

    name: str
    source: str
    reason: str


@dataclass(frozen=True)
class DataSet:
    """One archive. To add one: a file with a record in `training/data/sets`, and its name in `DATA_SETS` there."""

    name: str  # of the archive and of its folder
    credit: str
    # of the unpacked folder: files to import with style and content, and those that are left out
    clips: Callable[[Path], tuple[list[ClipSource], list[Refusal]]]
    skeletons: tuple[SourceSkeleton, ...]  # hierarchies that no other data set has
    free: bool = True  # allows commercial use with the credit
    read: Callable[[Path], BvhMotion] = read_bvh
    first_frame: int = 0  # before it: a T-pose
    has_tpose: bool = False  # at either end of a take
    long_takes: bool = False  # unique in their style and content: they give their tails to evaluation
    slide: float = 1.0  # times the speed at which a foot still counts as standing
    metres_per_unit: float | None = None  # None: by the ratio of leg lengths
    # Degrees by which faces are tilted up, by capture: the median face pitch (elevation of the head's +Z) over neutral
    # walks after retargeting was -22 in 100STYLE, -12 to -14 in the second Bandai Namco data set, -11 in JLPM, -23 to -29
    # in PFNN, -12 to -22 in O3DE and -12 to -17 of ACCAD's man. The tilt brings it to about -6; others stay at -2 to +3.
    head_lift_degrees: Mapping[str, float] = field(default_factory=dict)
    references: Mapping[str, str] = field(default_factory=dict)  # by capture: a take that begins upright
    # words of styles that assets/prompts/styles.json has not: descriptions by body part
    descriptions: Mapping[str, Sequence[Mapping[str, str]]] = field(default_factory=dict)

    def of_capture(self, skeleton: SourceSkeleton, capture: str) -> SourceSkeleton:
        """`skeleton` with the constants of one capture, which a hierarchy alone does not tell."""
        return replace(
            skeleton,
            reference=self.references.get(capture, skeleton.reference),
            head_lift_degrees=self.head_lift_degrees.get(capture, 0.0),
            fixed_scale=self.metres_per_unit or skeleton.fixed_scale,
        )
