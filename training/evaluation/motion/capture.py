"""The captured side: clips, the parts that characters are led along, their windows, and what every model is compared with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.controls import Gait
from runtime.errors import FileError
from runtime.motion.features import FPS
from runtime.motion.model import ExportedMotionEncoder
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import open_npz
from training.evaluation import log
from training.evaluation.metrics.classifiers import (
    MIN_HELD_OUT_WINDOWS,
    MIN_TRAINING_WINDOWS,
    StyleClassifier,
)
from training.evaluation.metrics.features import WindowSet, joined, window_set
from training.evaluation.metrics.feet import GAITS, foot_skating, skating_means
from training.evaluation.metrics.frechet import Projection
from training.evaluation.metrics.motion import (
    GESTURES,
    WINDOW_FRAMES,
    Motion,
    load_motion,
    mean_speed,
    original_clips,
)
from training.evaluation.motion.evaluated_model import style_texts

ROLLOUTS = "pfnn_rollouts"  # distilled motion of a published network on uneven ground: no capture
LAYERED = "layered"  # clips with edited or recombined body parts: no capture either
TERRAIN_GROUP = "neutral (rollouts)"
MAX_SEGMENT_FRAMES = 8 * FPS


@dataclass(frozen=True)
class ClipInfo:
    """The catalogue's entry of a clip file."""

    path: Path
    group: str  # its style; the rollouts are a group of their own
    style: str
    content: str
    held_out: bool
    frames: int
    gaits: dict[Gait, int]  # frames of each


@dataclass(frozen=True)
class ClipSegment:
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
        """Clips of a group, of both splits unless one is chosen."""
        return [c for c in self.clips if c.group == group and held_out in (None, c.held_out)]

    @property
    def groups(self) -> list[str]:
        """Styles with captured clips, without the rollouts."""
        return sorted({c.group for c in self.clips} - {TERRAIN_GROUP})

    def seconds(self, group: str, gait: Gait, held_out: bool | None = None) -> float:
        """Captured time of a group in a gait."""
        return sum(c.gaits.get(gait, 0) for c in self.of(group, held_out)) / FPS


def read_capture(
    folder: Path, styles: Iterable[str] | None = None, least_frames: int = WINDOW_FRAMES
) -> Capture:
    """Catalogue of `*.npz` under `folder`; FileError when a chosen style has no clips."""
    found = [info for info in map(_info, original_clips(folder)) if info is not None]
    known = {clip.style for clip in found}
    wanted = known if styles is None else set(styles)
    if wanted - known:
        raise FileError(
            f"{folder}: no clips of {', '.join(sorted(wanted - known))}.",
            "Choose styles of assets/prompts/styles.json.",
        )
    return Capture(tuple(c for c in found if c.style in wanted and c.frames >= least_frames))


def _info(path: Path) -> ClipInfo | None:
    """None for what was made out of other clips."""
    with open_npz(path, "Run the importer again.") as clip:
        if str(clip["tier"]) == LAYERED or bool(clip["mirrored"]):
            return None
        labels, counts = np.unique(clip["gait"].argmax(1), return_counts=True)
        style, rollout = str(clip["style"]), str(clip["source"]) == ROLLOUTS
        held_out, content = str(clip["split"]) == "held_out", str(clip["content"])
    gaits = {Gait(int(g)): int(n) for g, n in zip(labels, counts, strict=True)}
    return ClipInfo(
        path, TERRAIN_GROUP if rollout else style, style, content, held_out, int(counts.sum()), gaits
    )


def driving_segments(
    capture: Capture, group: str, seconds: float, seed: int = 0, max_frames: int = MAX_SEGMENT_FRAMES
) -> list[ClipSegment]:
    """Parts of a group's clips to lead the character along: held-out ones first, then training ones, up to `seconds`.

    A long clip gives one part of at most `max_frames` at a random place.
    """
    rng = np.random.default_rng([seed, *group.encode()])
    order = [c for split in (True, False) for c in _shuffled(capture.of(group, split), rng)]
    result: list[ClipSegment] = []
    left = seconds * FPS
    for clip in order:
        if left < WINDOW_FRAMES:
            break
        length = min(clip.frames, max_frames, max(WINDOW_FRAMES, round(left)))
        first = int(rng.integers(0, clip.frames - length + 1))
        result.append(ClipSegment(clip, first, first + length))
        left -= length
    return result


def _shuffled(clips: list[ClipInfo], rng: np.random.Generator) -> list[ClipInfo]:
    return [clips[i] for i in rng.permutation(len(clips))]


STYLE_COMPONENTS = 32  # principal components of the distances of one style: it has a few hundred windows
OVERALL_COMPONENTS = 128  # of the distances of all styles together
TRAINING_SECONDS = 150.0  # of a style's training clips, for the classifier and the principal axes
TRAINING_HOP = 20  # frames between two windows
HELD_OUT_SECONDS = 240.0
MIN_GAIT_SECONDS = 2.0  # of a captured gait without which a style is not driven in it


@dataclass(frozen=True)
class Options:
    """The amount that is generated. Seconds are per style; the seed fixes everything that is drawn."""

    follow_seconds: float = 40.0
    recognise_seconds: float = 16.0  # of paths of held-out clips, repeated with other descriptions and seeds
    course_seconds: float = 10.0
    terrain_styles: int = 6
    diversity_clips: int = 40
    transitions: int = 30
    seed: int = 0

    @staticmethod
    def quick() -> Options:
        """A trial of a few minutes: the figures are too noisy to quote."""
        return Options(12.0, 6.0, 4.0, 1, 4, 4)


@dataclass
class EvaluationPlan:
    """Shared by all models, so that they are scored alike."""

    options: Options
    capture: Capture
    texts: dict[str, list[PartDescriptions]]
    encoder: ExportedMotionEncoder | None
    segments: dict[str, list[ClipSegment]]
    reference: dict[str, WindowSet]  # windows of these segments
    training: WindowSet
    training_styles: list[str]  # of its rows
    held_out: dict[str, WindowSet]
    classifier: StyleClassifier
    _kept: dict[Any, Any] = field(default_factory=dict)  # by what was measured

    @property
    def groups(self) -> list[str]:
        """Styles, and the rollouts where there are any."""
        return list(self.segments)

    @property
    def styles(self) -> list[str]:
        """Captured styles."""
        return [group for group in self.groups if group != TERRAIN_GROUP]

    @property
    def feature_sets(self) -> list[str]:
        return ["kinematic"] if self.encoder is None else ["encoder", "kinematic"]

    def projection(self, name: str, components: int) -> Projection:
        """Principal axes of a feature set, measured on captured training windows."""
        key = name, components
        if key not in self._kept:
            self._kept[key] = Projection.fit(self.training.of(name), components, name == "kinematic")
        return self._kept[key]

    def captured_skating(self, group: str, gait: str) -> dict[str, Any]:
        """Skating of a group's `held_out` clips in a gait, or of all its clips where those are too short."""
        key = group, gait
        if key not in self._kept:
            held_out = self.capture.seconds(group, GAITS[gait], True) >= MIN_GAIT_SECONDS
            found = clip_skating(self.capture.of(group, True if held_out else None), GAITS[gait])
            self._kept[key] = found | {"held_out": held_out}
        return self._kept[key]

    def style_of(self, group: str) -> str:
        """The style whose descriptions a group is generated with."""
        return self.segments[group][0].clip.style

    def gaits(self, group: str) -> list[str]:
        """Gaits that a style was captured in."""
        if group.startswith(GESTURES):
            return []
        return [n for n, g in GAITS.items() if self.capture.seconds(group, g) >= MIN_GAIT_SECONDS]


def clip_skating(clips: Iterable[ClipInfo], gait: Gait) -> dict[str, float]:
    """Skating of captured clips while they are in a gait."""
    motions = (load_motion(clip.path) for clip in clips if clip.gaits.get(gait, 0))
    return skating_means(foot_skating(m.positions, m.terrain, m.gait == gait) for m in motions)


def make_plan(
    clips: Path, styles: list[str] | None, options: Options, encoder: ExportedMotionEncoder | None
) -> EvaluationPlan:
    """Read the capture and train the classifier; FileError when the clips do not do."""
    capture = read_capture(clips, styles)
    groups = capture.groups + ([TERRAIN_GROUP] if capture.of(TERRAIN_GROUP) else [])
    texts = style_texts({clip.style for clip in capture.clips})
    segments, reference, training, held_out, labels = {}, {}, [], {}, []
    for number, group in enumerate(groups):
        log.info(f"capture {number + 1}/{len(groups)}: {group}")
        segments[group] = driving_segments(capture, group, options.follow_seconds, options.seed)
        # neighbours in speed are a pair of takes (`frechet.compare`)
        takes = sorted((s.load() for s in segments[group]), key=lambda motion: mean_speed(motion.positions))
        reference[group] = window_set(takes, encoder)
        if group != TERRAIN_GROUP:  # the rollouts are distilled motion, no capture of their style
            parts = _parts(capture, group, False, TRAINING_SECONDS, options.seed)
            windows = window_set((s.load() for s in parts), encoder, hop=TRAINING_HOP)
            training.append(windows)
            labels += [segments[group][0].clip.style] * len(windows)
        parts = _parts(capture, group, True, HELD_OUT_SECONDS, options.seed)
        held_out[group] = window_set((s.load() for s in parts), encoder)
    windows = joined(training)
    known = _known(windows, labels, held_out)
    log.info(f"classifier: {len(known)} windows")
    classifier = StyleClassifier(windows.for_classifier[known], [labels[int(i)] for i in known], options.seed)
    return EvaluationPlan(
        options, capture, texts, encoder, segments, reference, windows, labels, held_out, classifier
    )


def _parts(capture: Capture, group: str, held_out: bool, seconds: float, seed: int) -> list[ClipSegment]:
    only = Capture(tuple(capture.of(group, held_out)))
    return driving_segments(only, group, seconds, seed + 1, max_frames=20 * 60)


def _known(windows: WindowSet, labels: list[str], held_out: dict[str, WindowSet]) -> NDArray[np.int64]:
    """Rows of styles with enough windows of both splits to train on and to test."""
    array = np.asarray(labels)
    enough = [
        style
        for style in np.unique(array)
        if (array == style).sum() >= MIN_TRAINING_WINDOWS
        and len(held_out.get(str(style), ())) >= MIN_HELD_OUT_WINDOWS
    ]
    if len(enough) < 2:
        raise FileError(
            f"--clips: {len(enough)} styles have enough windows for a classifier, two are needed.",
            "Give more styles.",
        )
    return np.flatnonzero(np.isin(array, enough))
