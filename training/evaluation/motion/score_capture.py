"""Rows that no model of ours made: held-out capture, and the terrain rollouts of a published network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from training.evaluation.metrics.foot_skating import GAITS, Skating, foot_skating
from training.evaluation.metrics.frechet import frechet_distance
from training.evaluation.metrics.recognition import recognition
from training.evaluation.metrics.terrain_feet import terrain_feet
from training.evaluation.metrics.window_sets import WindowSet, joined
from training.evaluation.motion.capture import TERRAIN_GROUP, motions
from training.evaluation.motion.motion import Motion
from training.evaluation.motion.plan import OVERALL_COMPONENTS, Plan

Array = NDArray[np.floating]
Report = Callable[[str], None]

DRAWS = 10


def score_held_out(plan: Plan, report: Report) -> dict[str, Any]:
    """The capture's own held-out clips, scored by the same code."""
    report("held-out capture")
    styles = [g for g in plan.groups if g != TERRAIN_GROUP and len(plan.held_out[g])]
    answers = {g: plan.classifier.predict(plan.held_out[g].for_classifier) for g in styles}
    known = {g: a for g, a in answers.items() if g in plan.classifier.labels}
    skating = {gait: Skating() for gait in GAITS}
    for group in styles:
        for _, motion in motions(plan.capture.of(group, True)):
            _add(skating, motion)
    return {
        "name": "held-out capture",
        "clips": sum(len(plan.capture.of(g, True)) for g in styles),
        "fmd": {n: _split_distance(plan, n, styles) for n in plan.feature_sets},
        "skating": {g: s.as_dict() for g, s in skating.items()},
        "recognition": asdict(recognition(known)),
    }


def _add(skating: dict[str, Skating], motion: Motion) -> None:
    for name, gait in GAITS.items():
        skating[name] += foot_skating(motion.positions, motion.terrain, motion.gait == gait)


def _split_distance(plan: Plan, name: str, styles: list[str]) -> dict[str, float]:
    """Held-out against training windows, with as many of either from every style."""
    rng = np.random.default_rng(plan.options.seed)
    project = plan.projection(name, OVERALL_COMPONENTS)
    labels = np.asarray(plan.training_styles)
    distances, count = [], 0
    for _ in range(DRAWS):
        sides: tuple[list[Array], list[Array]] = ([], [])
        for style in styles:
            held, own = plan.held_out[style].of(name), plan.training.of(name)[labels == style]
            n = min(len(held), len(own))
            sides[0].append(held[rng.permutation(len(held))[:n]])
            sides[1].append(own[rng.permutation(len(own))[:n]])
        a, b = (project(np.concatenate(side)) for side in sides)
        distances.append(frechet_distance(a, b))
        count = len(a)
    return {"distance": float(np.mean(distances)), "windows": count}


def score_rollouts(plan: Plan, report: Report) -> dict[str, Any] | None:
    """The terrain rollouts as a row of their own, against captured neutral motion; None without rollouts."""
    clips = plan.capture.of(TERRAIN_GROUP, True)
    if not clips:
        return None
    report("terrain rollouts")
    skating = {gait: Skating() for gait in GAITS}
    rows: dict[str, list[list[float]]] = {}
    keys: list[str] = []
    for _, motion in motions(clips):
        _add(skating, motion)
        for gait, label in GAITS.items():
            chosen = motion.gait == label
            if chosen.sum() >= 60:
                found = asdict(terrain_feet(motion.positions[chosen], motion.terrain))
                keys = list(found)
                rows.setdefault(gait, []).append(list(found.values()))
    result: dict[str, Any] = {
        "name": "terrain rollouts (PFNN)",
        "clips": len(clips),
        "skating": {g: s.as_dict() for g, s in skating.items()},
        "terrain": {
            gait: dict(zip(keys, np.mean(values, axis=0).tolist(), strict=True))
            for gait, values in rows.items()
        },
    }
    neutral = [g for g in plan.groups if g.startswith("neutral") and g != TERRAIN_GROUP]
    if neutral:
        windows = joined([plan.reference[g] for g in neutral])
        result["fmd"] = {n: _rollout_distance(plan, n, windows) for n in plan.feature_sets}
    return result


def _rollout_distance(plan: Plan, name: str, neutral: WindowSet) -> dict[str, float]:
    """Windows of rollouts against captured neutral windows, as many of either."""
    rng = np.random.default_rng(plan.options.seed)
    project = plan.projection(name, OVERALL_COMPONENTS)
    a, b = project(plan.reference[TERRAIN_GROUP].of(name)), project(neutral.of(name))
    n = min(len(a), len(b))
    draws = [
        frechet_distance(a[rng.permutation(len(a))[:n]], b[rng.permutation(len(b))[:n]]) for _ in range(DRAWS)
    ]
    return {"distance": float(np.mean(draws)), "windows": n}
