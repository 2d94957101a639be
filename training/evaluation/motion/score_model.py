"""All scores of one model, as plain data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.controls import Gait
from runtime.terrain.library import make_terrain
from training.evaluation.metrics.diversity import FRAMES, LEAD_IN, diversity
from training.evaluation.metrics.foot_skating import GAITS
from training.evaluation.metrics.smoothness import transition_jerk
from training.evaluation.metrics.terrain_feet import terrain_feet
from training.evaluation.motion.capture import TERRAIN_GROUP, ClipInfo
from training.evaluation.motion.courses import run_course
from training.evaluation.motion.driving import transition
from training.evaluation.motion.motion import Motion, load_motion
from training.evaluation.motion.plan import Plan
from training.evaluation.motion.score_styles import score_courses, score_following
from training.evaluation.motion.subject import Subject, count_parameters, frame_times

Array = NDArray[np.floating]
Report = Callable[[str], None]

TERRAINS = ("hills", "stairs", "rough")
DETERMINISM_CLIPS = 5  # that temperature 0 gives the same twice takes no more


def score_model(plan: Plan, subject: Subject, report: Report) -> dict[str, Any]:
    """Generate what the plan asks for and score it."""
    metadata = subject.model.metadata
    result: dict[str, Any] = {
        "name": subject.name,
        "decoder": subject.decoder,
        "config": metadata["config"],
        "parameters": count_parameters(metadata),
        "runtime": frame_times(subject.model),
    }
    result["following"] = score_following(plan, subject, report)
    result["courses"] = score_courses(plan, subject, make_terrain("rough", plan.options.seed), report)
    result["terrain"] = score_terrain(plan, subject, report)
    result["transitions"] = score_transitions(plan, subject, report)
    result["diversity"] = score_diversity(plan, subject, report)
    return result


def score_terrain(plan: Plan, subject: Subject, report: Report) -> dict[str, Any]:
    """Sinking and floating of soles, and path error, on uneven ground: neutral first, then other styles."""
    result: dict[str, Any] = {}
    styles = _walking_styles(plan)[: plan.options.terrain_styles]
    for name in TERRAINS:
        ground = make_terrain(name, plan.options.seed)
        for gait in GAITS:
            report(f"{subject.name}: {gait} on {name}")
            runs = [
                run_course(
                    subject.model,
                    ground,
                    style,
                    subject.style(style, k),
                    GAITS[gait],
                    plan.options.course_seconds,
                    plan.options.seed + k,
                )
                for k, style in enumerate(styles)
                if gait in plan.gaits(style)
            ]
            if not runs:
                continue
            rows = [list(asdict(terrain_feet(r.motion.positions, ground)).values()) for r in runs]
            keys = asdict(terrain_feet(runs[0].motion.positions, ground))
            result[f"{name} {gait}"] = dict(zip(keys, np.mean(rows, axis=0).tolist(), strict=True)) | {
                "path_error_m": float(np.mean([r.path_error.mean() for r in runs])),
                "runs": len(runs),
            }
    return result


def _walking_styles(plan: Plan) -> list[str]:
    styles = [g for g in plan.groups if g != TERRAIN_GROUP and "walk" in plan.gaits(g)]
    order = np.random.default_rng(plan.options.seed).permutation(len(styles))
    mixed = [styles[i] for i in order]
    return sorted(mixed, key=lambda s: s != "neutral")  # stable: the rest stays mixed


def score_transitions(plan: Plan, subject: Subject, report: Report) -> dict[str, float]:
    """Jerk around changes of prompt between random styles, walking, against that inside the styles."""
    rng = np.random.default_rng(plan.options.seed + 2)
    styles = _walking_styles(plan)
    if len(styles) < 2:
        return {}
    rows = []
    for k in range(plan.options.transitions):
        first, second = (styles[i] for i in rng.choice(len(styles), 2, replace=False))
        if k % 10 == 0:
            report(f"{subject.name}: transition {k + 1}/{plan.options.transitions}")
        positions, change = transition(
            subject.model, subject.style(first, k), subject.style(second, k), plan.options.seed + k
        )
        result = transition_jerk(positions, change)
        rows.append((result.inside, result.around, result.ratio, result.peak))
    inside, around, ratio, peak = np.array(rows).T
    return {
        "inside_m_s3": float(inside.mean()),
        "around_m_s3": float(around.mean()),
        "ratio": float(ratio.mean()),
        "ratio_p95": float(np.percentile(ratio, 95)),
        "peak_ratio": float(peak.mean()),
        "count": len(rows),
    }


def score_diversity(plan: Plan, subject: Subject, report: Report) -> dict[str, Any]:
    """Diversity at temperature 1, and over a few clips at 0, of random captured clips, held-out ones first."""
    clips = diversity_clips(plan)
    styled = [(clip, subject.style(clip.style, k)) for k, clip in enumerate(clips)]
    result: dict[str, Any] = {"clips": len(clips)}
    for temperature in (0.0, 1.0):
        report(f"{subject.name}: diversity at temperature {temperature:.0f}")
        chosen = styled if temperature > 0 else styled[:DETERMINISM_CLIPS]
        result[f"temperature_{temperature:.0f}"] = asdict(diversity(subject.model, chosen, temperature))
    return result


def diversity_clips(plan: Plan) -> list[Motion]:
    """Clips of 180 frames and their lead-in, every one of another group as far as these reach."""
    rng = np.random.default_rng(plan.options.seed + 3)
    length = LEAD_IN + FRAMES
    by_group: dict[str, list[ClipInfo]] = {}
    for clip in plan.capture.clips:
        if clip.frames >= length and clip.gaits.get(Gait.JUMP, 0) == 0:
            by_group.setdefault(clip.group, []).append(clip)
    pools = [
        sorted((c[i] for i in rng.permutation(len(c))), key=lambda clip: not clip.held_out)
        for _, c in sorted(by_group.items())
    ]
    chosen = [p[k] for k in range(max(map(len, pools))) for p in pools if k < len(p)]
    result = []
    for clip in chosen[: plan.options.diversity_clips]:
        first = int(rng.integers(0, clip.frames - length + 1))
        result.append(load_motion(clip.path).cut(first, first + length))
    return result
