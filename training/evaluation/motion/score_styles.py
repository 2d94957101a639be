"""Scores of the styles one by one: the character led along captured paths, and round the standard course."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.terrain.height_map import Terrain
from training.evaluation.metrics.foot_skating import GAITS, Skating, foot_skating
from training.evaluation.metrics.frechet import Comparison, compare
from training.evaluation.metrics.recognition import recognition
from training.evaluation.metrics.window_sets import WindowSet, joined, window_set
from training.evaluation.motion.capture import TERRAIN_GROUP, Segment
from training.evaluation.motion.courses import run_course
from training.evaluation.motion.driving import flat_ground, follow
from training.evaluation.motion.motion import Motion, mean_speed
from training.evaluation.motion.plan import (
    OVERALL_COMPONENTS,
    STYLE_COMPONENTS,
    Plan,
    captured_skating,
)
from training.evaluation.motion.subject import Subject

Array = NDArray[np.floating]
Report = Callable[[str], None]


@dataclass
class Followed:
    """What came of leading the character along a group's segments."""

    windows: WindowSet  # of the segments, one take each
    recognised: WindowSet  # of the held-out segments (of all, where there are none), several takes
    path_error: float  # m, mean distance from the clip's root at the same time
    speed_ratio: float  # way made over the clip's
    skating: dict[str, Skating]  # by gait, on the capture's own paths and ground


def follow_group(plan: Plan, subject: Subject, group: str) -> Followed:
    """Lead the character along every segment of a group, in descriptions that take turns."""
    segments, style = plan.segments[group], plan.style_of(group)
    first, extra, errors, ways = [], [], [], []
    skating = {gait: Skating() for gait in GAITS}

    def take(segment: Segment, number: int) -> Motion:
        clip = segment.load()
        made = follow(subject.model, clip, subject.style(style, number), plan.options.seed + number)
        errors.append(np.linalg.norm(clip.positions[:, 0, ::2] - made.positions[:, 0, ::2], axis=-1))
        ways.append([len(m) * mean_speed(m.positions) for m in (clip, made)])
        for name, gait in GAITS.items():
            skating[name] += foot_skating(made.positions, made.terrain, made.gait == gait)
        return made

    for number, segment in enumerate(segments):
        first.append(take(segment, number))
    tested = [s.clip.held_out for s in segments]
    tested = tested if any(tested) else [True] * len(segments)
    seconds = sum(s.seconds for s, t in zip(segments, tested, strict=True) if t)
    takes = int(np.clip(round(plan.options.recognise_seconds / seconds), 1, 4))
    for again in range(1, takes):
        for number, (segment, test) in enumerate(zip(segments, tested, strict=True)):
            if test:
                extra.append(take(segment, number + again))
    windows = window_set(first, plan.encoder)
    own = window_set((m for m, t in zip(first, tested, strict=True) if t), None)
    recognised = joined([own, window_set(extra, None)])
    way = np.sum(ways, axis=0)
    return Followed(
        windows, recognised, float(np.concatenate(errors).mean()), float(way[1] / max(way[0], 1e-6)), skating
    )


def score_following(plan: Plan, subject: Subject, report: Report) -> dict[str, Any]:
    """Distances per style and overall, recognition, path and speed along the captured paths."""
    done: dict[str, Followed] = {}
    for number, group in enumerate(plan.groups):
        report(f"{subject.name}: following {number + 1}/{len(plan.groups)}: {group}")
        done[group] = follow_group(plan, subject, group)
    styles = [g for g in plan.groups if g != TERRAIN_GROUP]
    answers = {g: plan.classifier.predict(done[g].recognised.for_classifier) for g in styles}
    known = {g: a for g, a in answers.items() if g in plan.classifier.labels}
    return {
        "styles": {
            group: {
                "fmd": {n: style_distance(plan, n, group, made.windows) for n in plan.feature_sets},
                "path_error_m": made.path_error,
                "speed_ratio": made.speed_ratio,
                "skating": {g: s.as_dict() for g, s in made.skating.items() if s.frames},
            }
            for group, made in done.items()
        },
        "fmd": {
            n: overall_distance(plan, n, {g: done[g].windows for g in styles}) for n in plan.feature_sets
        },
        "recognition": asdict(recognition(known)),
    }


def style_distance(plan: Plan, name: str, group: str, windows: WindowSet) -> dict[str, Any]:
    """Frechet distance of a group's windows to the captured ones, beside the capture's own."""
    project = plan.projection(name, STYLE_COMPONENTS)
    reference = plan.reference[group]
    return _comparison(compare(project(windows.of(name)), project(reference.of(name)), reference.unit))


def overall_distance(plan: Plan, name: str, windows: dict[str, WindowSet]) -> dict[str, Any]:
    """Frechet distance of all styles' windows together."""
    project = plan.projection(name, OVERALL_COMPONENTS)
    reference = joined([plan.reference[group] for group in windows])
    made = joined(list(windows.values()))
    return _comparison(compare(project(made.of(name)), project(reference.of(name)), reference.unit))


def _comparison(c: Comparison) -> dict[str, Any]:
    return {
        "distance": c.within.distance,
        "reference": c.within.reference,
        "ratio": c.within.ratio,
        "windows": c.within.windows,
        "takes": asdict(c.takes) | {"ratio": c.takes.ratio},
    }


def score_courses(plan: Plan, subject: Subject, rough: Terrain, report: Report) -> dict[str, Any]:
    """Skating before and after foot lock, path error and speed, per style and gait, on level and on rough ground."""
    result: dict[str, Any] = {}
    styles = [g for g in plan.groups if g != TERRAIN_GROUP and plan.gaits(g)]
    for number, style in enumerate(styles):
        report(f"{subject.name}: courses {number + 1}/{len(styles)}: {style}")
        result[style] = {}
        for gait in plan.gaits(style):
            captured, held_out = captured_skating(plan, style, gait)
            result[style][gait] = {"captured": captured.as_dict() | {"held_out": held_out}}
            for ground in (flat_ground(), rough):
                result[style][gait][ground.name] = _course(plan, subject, ground, style, gait, number)
    return result


def _course(
    plan: Plan, subject: Subject, ground: Terrain, style: str, gait: str, number: int
) -> dict[str, Any]:
    seed = plan.options.seed + number
    z = subject.style(style, number)
    run = run_course(subject.model, ground, style, z, GAITS[gait], plan.options.course_seconds, seed)
    everything = np.ones(len(run.motion), bool)
    assert run.motion.unlocked is not None
    before = foot_skating(run.motion.unlocked, ground, everything)
    after = foot_skating(run.motion.positions, ground, everything)
    return {
        "before": before.as_dict(),
        "after": after.as_dict(),
        "path_error_m": float(run.path_error.mean()),
        "path_error_p95_m": float(np.percentile(run.path_error, 95)),
        "speed_m_s": mean_speed(run.motion.positions),
        "asked_m_s": float(run.requested_speed.mean()),
    }
