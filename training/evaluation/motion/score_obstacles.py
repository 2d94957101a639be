"""Scores of a model on the six obstacle courses, by style and gait, and how far its styles are recognised on them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from runtime.controls import Gait
from training.evaluation.metrics.recognition import StyleClassifier, merged
from training.evaluation.metrics.window_sets import window_set
from training.evaluation.motion.obstacle_courses import (
    COURSES,
    LEVEL,
    CourseRun,
    ObstacleCourse,
    run_obstacles,
    score_run,
)
from training.evaluation.motion.subject import Subject

Report = Callable[[str], None]
Runner = Callable[[ObstacleCourse, str, Gait], CourseRun]

STYLES = ("neutral", "old", "exhausted", "angry", "drunk", "happy")
GAITS = (Gait.WALK, Gait.JOG)


def runner_of(subject: Subject, seed: int) -> Runner:
    """Leads a model's character over a course in the first description of a style."""
    return lambda course, style, gait: run_obstacles(
        subject.model, course, style, subject.style(style, 0), gait, seed
    )


def score_obstacles(
    run: Runner,
    styles: Sequence[str],
    courses: Iterable[ObstacleCourse],
    classifier: StyleClassifier | None,
    report: Report,
    keep: Callable[[CourseRun], None] | None = None,
    gaits: Sequence[Gait] = GAITS,
) -> dict[str, Any]:
    """A row for each course, style and gait, and the share of windows taken for their style there and on level ground.

    `keep` is given every run, to draw it.
    """
    rows: list[dict[str, Any]] = []
    for course in (*courses, LEVEL):
        for style in styles:
            for gait in gaits:
                if course is LEVEL and classifier is None:
                    continue
                report(f"{course.name}: {style}, {gait.name.lower()}")
                done = run(course, style, gait)
                row: dict[str, Any] = {"course": course.name, "style": style, "gait": gait.name.lower()}
                row["recognised"] = _recognised(done, classifier)
                if course is not LEVEL:
                    row |= score_run(done)
                    if keep is not None:
                        keep(done)
                rows.append(row)
    level = [r for r in rows if r["course"] == LEVEL.name]
    return {"rows": [r for r in rows if r["course"] != LEVEL.name], "level": level}


def _recognised(run: CourseRun, classifier: StyleClassifier | None) -> float | None:
    """Share of the windows that are taken for the style, look-alikes counted as one; None where it cannot be decided."""
    style = run.motion.style
    if classifier is None or style not in classifier.labels:
        return None
    windows = window_set([run.motion], None)
    answers = classifier.predict(windows.for_classifier)
    return float(np.mean([merged(a) == merged(style) for a in answers])) if answers else None


def by_name(names: Sequence[str]) -> tuple[ObstacleCourse, ...]:
    """The courses of these names, in their order; all without names."""
    return tuple(c for c in COURSES if not names or c.name in names)
