"""What every model is compared with: captured windows, their own scatter, a classifier, and the paths to follow."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path
from runtime.errors import FileError
from runtime.motion.motion_encoder import MotionEncoder
from runtime.prompts.parts import PartDescriptions
from training.evaluation.metrics.foot_skating import GAITS, Skating, foot_skating
from training.evaluation.metrics.frechet import Projection
from training.evaluation.metrics.recognition import (
    MIN_HELD_OUT_WINDOWS,
    MIN_TRAINING_WINDOWS,
    StyleClassifier,
)
from training.evaluation.metrics.window_sets import WindowSet, joined, window_set
from training.evaluation.motion.capture import (
    TERRAIN_GROUP,
    Capture,
    Segment,
    driving_segments,
    motions,
    read_capture,
)
from training.evaluation.motion.motion import GESTURES, mean_speed

Array = NDArray[np.floating]
Report = Callable[[str], None]

STYLE_COMPONENTS = 32  # principal components of the distances of one style: it has a few hundred windows
OVERALL_COMPONENTS = 128  # of the distances of all styles together
TRAINING_SECONDS = 150.0  # of a style's training clips, for the classifier and the principal axes
TRAINING_HOP = 20  # frames between two windows
HELD_OUT_SECONDS = 240.0
MIN_GAIT_SECONDS = 2.0  # of a captured gait without which a style is not asked for it


@dataclass(frozen=True)
class Options:
    """How much is generated. Seconds are per style; the seed fixes everything that is drawn."""

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
class Plan:
    """Shared by all models, so that they are scored alike."""

    options: Options
    capture: Capture
    texts: dict[str, list[PartDescriptions]]
    encoder: MotionEncoder | None
    segments: dict[str, list[Segment]]
    reference: dict[str, WindowSet]  # windows of these segments
    training: WindowSet
    training_styles: list[str]  # of its rows
    held_out: dict[str, WindowSet]
    classifier: StyleClassifier
    projections: dict[tuple[str, int], Projection] = field(default_factory=dict)
    skating: dict[tuple[str, str], tuple[Skating, bool]] = field(default_factory=dict)

    @property
    def groups(self) -> list[str]:
        """Styles, and the rollouts where there are any."""
        return list(self.segments)

    @property
    def feature_sets(self) -> list[str]:
        return ["kinematic"] if self.encoder is None else ["encoder", "kinematic"]

    def projection(self, name: str, components: int) -> Projection:
        """Principal axes of a feature set, measured on captured training windows."""
        key = (name, components)
        if key not in self.projections:
            self.projections[key] = Projection.fit(self.training.of(name), components, name == "kinematic")
        return self.projections[key]

    def style_of(self, group: str) -> str:
        """The style whose descriptions a group is generated with."""
        return self.segments[group][0].clip.style

    def gaits(self, group: str) -> list[str]:
        """Gaits that a style was captured in."""
        if group.startswith(GESTURES):
            return []
        return [n for n, g in GAITS.items() if self.capture.seconds(group, g) >= MIN_GAIT_SECONDS]


def make_plan(
    clips: Path, styles: list[str] | None, options: Options, encoder: MotionEncoder | None, report: Report
) -> Plan:
    """Read the capture and train the classifier; FileError when the clips do not do."""
    capture = read_capture(clips, styles)
    groups = capture.groups + ([TERRAIN_GROUP] if capture.of(TERRAIN_GROUP) else [])
    texts = style_texts({clip.style for clip in capture.clips})
    segments, reference, training, held_out, labels = {}, {}, [], {}, []
    for number, group in enumerate(groups):
        report(f"capture {number + 1}/{len(groups)}: {group}")
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
    report(f"classifier: {len(known)} windows")
    classifier = StyleClassifier(windows.for_classifier[known], [labels[int(i)] for i in known], options.seed)
    return Plan(options, capture, texts, encoder, segments, reference, windows, labels, held_out, classifier)


def _parts(capture: Capture, group: str, held_out: bool, seconds: float, seed: int) -> list[Segment]:
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


def style_texts(styles: set[str]) -> dict[str, list[PartDescriptions]]:
    """Six-part descriptions of styles, hand-written and measured ones in turn; FileError names a style without."""
    path = asset_path("prompts/styles.json")
    library = json.loads(path.read_text(encoding="utf-8"))
    missing = styles - set(library)
    if missing:
        raise FileError(f"{path}: no descriptions for '{sorted(missing)[0]}'.", "Add an entry for it.")
    result = {}
    for style in sorted(styles):
        all_parts = [PartDescriptions.from_mapping(d) for d in library[style]["descriptions"]]
        written = len(all_parts) - int(library[style].get("measured", 0))
        pairs = zip_longest(all_parts[:written], all_parts[written:])
        result[style] = [parts for pair in pairs for parts in pair if parts is not None]
    return result


def captured_skating(plan: Plan, group: str, gait: str) -> tuple[Skating, bool]:
    """Skating of a group's held-out clips in a gait, or of all its clips (False) where those are too short."""
    key = (group, gait)
    if key not in plan.skating:
        held_out = plan.capture.seconds(group, GAITS[gait], True) >= MIN_GAIT_SECONDS
        total = Skating()
        for clip, motion in motions(plan.capture.of(group, True if held_out else None)):
            if clip.gaits.get(GAITS[gait], 0):
                total += foot_skating(motion.positions, motion.terrain, motion.gait == GAITS[gait])
        plan.skating[key] = (total, held_out)
    return plan.skating[key]
