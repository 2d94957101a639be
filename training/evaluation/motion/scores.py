"""All scores of one model, of held-out capture and of the terrain rollouts, as plain data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.controls import Gait
from runtime.motion.model import MotionModel
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from training.evaluation.metrics.classifiers import recognition
from training.evaluation.metrics.features import WindowSet, joined, window_set
from training.evaluation.metrics.feet import GAITS, Skating, foot_skating, terrain_feet
from training.evaluation.metrics.frechet import Comparison, compare, frechet_distance
from training.evaluation.metrics.motion import Motion, load_motion, mean_speed
from training.evaluation.metrics.variation import FRAMES, LEAD_IN, Diversity, pair_distance, transition_jerk
from training.evaluation.motion.capture import (
    OVERALL_COMPONENTS,
    STYLE_COMPONENTS,
    TERRAIN_GROUP,
    ClipInfo,
    ClipSegment,
    EvaluationPlan,
    captured_skating,
    motions,
)
from training.evaluation.motion.driving import flat_ground, follow, replay, run_course, transition
from training.evaluation.motion.evaluated_model import EvaluatedModel, count_parameters, frame_times

Report = Callable[[str], None]


@dataclass
class Followed:
    """What came of leading the character along a group's segments."""

    windows: WindowSet  # of the segments, one take each
    recognised: WindowSet  # of the held-out segments (of all, where there are none), several takes
    path_error: float  # m, mean distance from the clip's root at the same time
    speed_ratio: float  # distance travelled over the clip's
    skating: dict[str, Skating]  # by gait, on the capture's own paths and ground


def follow_group(plan: EvaluationPlan, evaluated: EvaluatedModel, group: str) -> Followed:
    """Lead the character along every segment of a group, in descriptions that take turns."""
    segments, style = plan.segments[group], plan.style_of(group)
    first, extra, errors, distances = [], [], [], []
    skating = {gait: Skating() for gait in GAITS}

    def take(segment: ClipSegment, number: int) -> Motion:
        clip = segment.load()
        made = follow(evaluated.model, clip, evaluated.style(style, number), plan.options.seed + number)
        errors.append(np.linalg.norm(clip.positions[:, 0, ::2] - made.positions[:, 0, ::2], axis=-1))
        distances.append([len(m) * mean_speed(m.positions) for m in (clip, made)])
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
    travelled = np.sum(distances, axis=0)
    return Followed(
        windows,
        recognised,
        float(np.concatenate(errors).mean()),
        float(travelled[1] / max(travelled[0], 1e-6)),
        skating,
    )


def score_following(plan: EvaluationPlan, evaluated: EvaluatedModel, report: Report) -> dict[str, Any]:
    """Distances per style and overall, recognition, path and speed along the captured paths."""
    done: dict[str, Followed] = {}
    for number, group in enumerate(plan.groups):
        report(f"{evaluated.name}: following {number + 1}/{len(plan.groups)}: {group}")
        done[group] = follow_group(plan, evaluated, group)
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


def style_distance(plan: EvaluationPlan, name: str, group: str, windows: WindowSet) -> dict[str, Any]:
    """Frechet distance of a group's windows to the captured ones, and the capture's own."""
    project = plan.projection(name, STYLE_COMPONENTS)
    reference = plan.reference[group]
    return _comparison(compare(project(windows.of(name)), project(reference.of(name)), reference.unit))


def overall_distance(plan: EvaluationPlan, name: str, windows: dict[str, WindowSet]) -> dict[str, Any]:
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


def score_courses(
    plan: EvaluationPlan, evaluated: EvaluatedModel, rough: Terrain, report: Report
) -> dict[str, Any]:
    """Skating before and after foot lock, path error and speed, per style and gait, on level and on rough ground."""
    result: dict[str, Any] = {}
    styles = [g for g in plan.groups if g != TERRAIN_GROUP and plan.gaits(g)]
    for number, style in enumerate(styles):
        report(f"{evaluated.name}: courses {number + 1}/{len(styles)}: {style}")
        result[style] = {}
        for gait in plan.gaits(style):
            captured, held_out = captured_skating(plan, style, gait)
            result[style][gait] = {"captured": captured.as_dict() | {"held_out": held_out}}
            for ground in (flat_ground(), rough):
                result[style][gait][ground.name] = _course(plan, evaluated, ground, style, gait, number)
    return result


def _course(
    plan: EvaluationPlan, evaluated: EvaluatedModel, ground: Terrain, style: str, gait: str, number: int
) -> dict[str, Any]:
    seed = plan.options.seed + number
    z = evaluated.style(style, number)
    run = run_course(evaluated.model, ground, style, z, GAITS[gait], plan.options.course_seconds, seed)
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
        "requested_m_s": float(run.requested_speed.mean()),
    }


TERRAINS = ("hills", "stairs", "rough")
DETERMINISM_CLIPS = 5  # that temperature 0 gives the same twice takes no more


def score_model(plan: EvaluationPlan, evaluated: EvaluatedModel, report: Report) -> dict[str, Any]:
    """Generate what the plan asks for and score it."""
    metadata = evaluated.model.metadata
    result: dict[str, Any] = {
        "name": evaluated.name,
        "decoder": evaluated.decoder,
        "config": metadata["config"],
        "parameters": count_parameters(metadata),
        "runtime": frame_times(evaluated.model),
    }
    result["following"] = score_following(plan, evaluated, report)
    result["courses"] = score_courses(plan, evaluated, make_terrain("rough", plan.options.seed), report)
    result["terrain"] = score_terrain(plan, evaluated, report)
    result["transitions"] = score_transitions(plan, evaluated, report)
    result["diversity"] = score_diversity(plan, evaluated, report)
    return result


def score_terrain(plan: EvaluationPlan, evaluated: EvaluatedModel, report: Report) -> dict[str, Any]:
    """Sinking and floating of soles, and path error, on uneven ground: neutral first, then other styles."""
    result: dict[str, Any] = {}
    styles = _walking_styles(plan)[: plan.options.terrain_styles]
    for name in TERRAINS:
        ground = make_terrain(name, plan.options.seed)
        for gait in GAITS:
            report(f"{evaluated.name}: {gait} on {name}")
            runs = [
                run_course(
                    evaluated.model,
                    ground,
                    style,
                    evaluated.style(style, k),
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


def _walking_styles(plan: EvaluationPlan) -> list[str]:
    styles = [g for g in plan.groups if g != TERRAIN_GROUP and "walk" in plan.gaits(g)]
    order = np.random.default_rng(plan.options.seed).permutation(len(styles))
    mixed = [styles[i] for i in order]
    return sorted(mixed, key=lambda s: s != "neutral")  # stable: the rest stays mixed


def score_transitions(plan: EvaluationPlan, evaluated: EvaluatedModel, report: Report) -> dict[str, float]:
    """Jerk around changes of prompt between random styles, walking, against that inside the styles."""
    rng = np.random.default_rng(plan.options.seed + 2)
    styles = _walking_styles(plan)
    if len(styles) < 2:
        return {}
    rows = []
    for k in range(plan.options.transitions):
        first, second = (styles[i] for i in rng.choice(len(styles), 2, replace=False))
        if k % 10 == 0:
            report(f"{evaluated.name}: transition {k + 1}/{plan.options.transitions}")
        positions, change = transition(
            evaluated.model, evaluated.style(first, k), evaluated.style(second, k), plan.options.seed + k
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


def diversity(model: MotionModel, clips: Sequence[tuple[Motion, Array]], temperature: float) -> Diversity:
    """Diversity over clips with their Z^t `(6, 64)`; each has `LEAD_IN` frames before those that count.

    Control variables are those of the clip in both generations; only the seed of the noise differs.
    """
    rows = []
    for clip, z in clips:
        pair = [replay(model, clip, z, seed, temperature, LEAD_IN) for seed in (1, 2)]
        whole, joint = pair_distance(pair[0][0], pair[1][0])
        rows.append((whole, joint, pair_distance(pair[0][1], pair[1][1])[0]))
    return Diversity(*(float(v) for v in np.mean(rows, axis=0)))


def score_diversity(plan: EvaluationPlan, evaluated: EvaluatedModel, report: Report) -> dict[str, Any]:
    """Diversity at temperature 1, and over a few clips at 0, of random captured clips, held-out ones first."""
    clips = diversity_clips(plan)
    styled = [(clip, evaluated.style(clip.style, k)) for k, clip in enumerate(clips)]
    result: dict[str, Any] = {"clips": len(clips)}
    for temperature in (0.0, 1.0):
        report(f"{evaluated.name}: diversity at temperature {temperature:.0f}")
        chosen = styled if temperature > 0 else styled[:DETERMINISM_CLIPS]
        result[f"temperature_{temperature:.0f}"] = asdict(diversity(evaluated.model, chosen, temperature))
    return result


def diversity_clips(plan: EvaluationPlan) -> list[Motion]:
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


DRAWS = 10


def score_held_out(plan: EvaluationPlan, report: Report) -> dict[str, Any]:
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


def _split_distance(plan: EvaluationPlan, name: str, styles: list[str]) -> dict[str, float]:
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
