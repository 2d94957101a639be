"""All scores of a model, of held-out capture and of terrain rollouts, as plain data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from runtime.controls import Gait
from runtime.terrain.library import make_terrain
from training.evaluation import log
from training.evaluation.metrics.classifiers import recognition
from training.evaluation.metrics.features import WindowSet, joined, window_set
from training.evaluation.metrics.feet import GAITS, foot_skating, skating_means, terrain_feet
from training.evaluation.metrics.frechet import Distances, compare, frechet_distance
from training.evaluation.metrics.motion import (
    DIVERSITY_FRAMES,
    DIVERSITY_LEAD_IN,
    Motion,
    load_motion,
    mean_speed,
    pair_distance,
    transition_jerk,
)
from training.evaluation.motion import driving
from training.evaluation.motion.capture import (
    OVERALL_COMPONENTS,
    STYLE_COMPONENTS,
    ClipInfo,
    EvaluationPlan,
    clip_skating,
)
from training.evaluation.motion.driving import RingRun, RingWalk, Take
from training.evaluation.motion.evaluated_model import EvaluatedModel, count_parameters, frame_times

TERRAINS = ("hills", "stairs", "rough")
DETERMINISM_CLIPS = 5  # enough to show that temperature 0 is deterministic
DRAWS = 10
GROUPS_TOGETHER = 8  # groups simulated in one batch and kept in memory until scored


def score_model(plan: EvaluationPlan, evaluated: EvaluatedModel) -> dict[str, Any]:
    """Generate the motion of the plan and score it."""
    metadata = evaluated.model.metadata
    return {
        "name": evaluated.name,
        "decoder": evaluated.decoder,
        "config": metadata["config"],
        "parameters": count_parameters(metadata),
        "runtime": frame_times(evaluated.model),
        "following": score_following(plan, evaluated),
        "courses": score_courses(plan, evaluated),
        "terrain": score_terrain(plan, evaluated),
        "transitions": score_transitions(plan, evaluated),
        "diversity": score_diversity(plan, evaluated),
    }


# --- along captured paths ---------------------------------------------------------------------------------------------


@dataclass
class Followed:
    """Takes of a group to follow, with alternating descriptions."""

    group: str
    clips: list[Motion]  # captured
    tested: list[int]  # indices of held-out clips, or of all if there are none
    takes: list[Take]  # one per clip, then repetitions of the tested ones

    @staticmethod
    def of(plan: EvaluationPlan, evaluated: EvaluatedModel, group: str) -> Followed:
        """Choose takes of a total length that is sufficient for style recognition."""
        segments, style = plan.segments[group], plan.style_of(group)
        clips = [segment.load() for segment in segments]
        tested = [k for k, s in enumerate(segments) if s.clip.held_out] or list(range(len(segments)))
        seconds = sum(segments[k].seconds for k in tested)
        again = int(np.clip(round(plan.options.recognise_seconds / seconds), 1, 4))
        drawn = [(k, k) for k in range(len(clips))]
        drawn += [(k, k + number) for number in range(1, again) for k in tested]
        takes = [Take(clips[k], evaluated.style(style, n), plan.options.seed + n) for k, n in drawn]
        return Followed(group, clips, tested, takes)

    def scored(
        self, plan: EvaluationPlan, made: Sequence[Motion]
    ) -> tuple[WindowSet, WindowSet, dict[str, float]]:
        """Return windows of the first takes, windows of all tested takes, and path figures.

        These are the mean distance from the clip's root at the same time, metres, and the ratio of distances travelled.
        """
        pairs = [(take.clip, motion) for take, motion in zip(self.takes, made, strict=True)]
        errors = [np.linalg.norm(c.positions[:, 0, ::2] - m.positions[:, 0, ::2], axis=-1) for c, m in pairs]
        captured, travelled = np.sum([[len(m) * mean_speed(m.positions) for m in pair] for pair in pairs], 0)
        first, again = made[: len(self.clips)], made[len(self.clips) :]
        recognised = joined([window_set((first[k] for k in self.tested), None), window_set(again, None)])
        path = {
            "path_error_m": float(np.concatenate(errors).mean()),
            "speed_ratio": float(travelled / max(captured, 1e-6)),
        }
        return window_set(first, plan.encoder), recognised, path


def score_following(plan: EvaluationPlan, evaluated: EvaluatedModel) -> dict[str, Any]:
    """Score motion along captured paths: distances per style and overall, recognition, path and speed."""
    windows, recognised, styles = {}, {}, {}
    for begin in range(0, len(plan.groups), GROUPS_TOGETHER):
        groups = plan.groups[begin : begin + GROUPS_TOGETHER]
        log.info(f"{evaluated.name}: following {', '.join(groups)}")
        paths = [Followed.of(plan, evaluated, group) for group in groups]
        made = iter(driving.follow(evaluated.model, [take for path in paths for take in path.takes]))
        for path in paths:
            group, own = path.group, list(islice(made, len(path.takes)))
            windows[group], recognised[group], measured = path.scored(plan, own)
            styles[group] = {"fmd": _distances(plan, {group: windows[group]}, STYLE_COMPONENTS), **measured}
    return {
        "styles": styles,
        "fmd": _distances(plan, {style: windows[style] for style in plan.styles}, OVERALL_COMPONENTS),
        "recognition": _recognition(plan, {style: recognised[style] for style in plan.styles}),
    }


def _distances(plan: EvaluationPlan, windows: dict[str, WindowSet], components: int) -> dict[str, Distances]:
    """Return, per feature set, the Frechet distance of groups' windows to capture, and between halves of the capture."""
    reference, made = joined(plan.reference[g] for g in windows), joined(windows.values())
    result = {}
    for name in plan.feature_sets:
        project = plan.projection(name, components)
        result[name] = compare(project(made.of(name)), project(reference.of(name)), reference.unit)
    return result


def _recognition(plan: EvaluationPlan, windows: dict[str, WindowSet]) -> dict[str, Any]:
    """Score recognition of the groups that the classifier knows."""
    known = {g: w for g, w in windows.items() if g in plan.classifier.labels}
    return recognition({g: plan.classifier.predict(w.for_classifier) for g, w in known.items()})


# --- on courses -------------------------------------------------------------------------------------------------------


def score_courses(plan: EvaluationPlan, evaluated: EvaluatedModel, rough: bool = True) -> dict[str, Any]:
    """Score skating before and after foot lock, path error and speed by style and gait, on level (and `rough`) ground."""
    result: dict[str, Any] = {}
    walks = _walks(plan, evaluated, [style for style in plan.styles if plan.gaits(style)], GAITS)
    for walk in walks:
        found = {"captured": plan.captured_skating(walk.style, walk.gait.label)}
        result.setdefault(walk.style, {})[walk.gait.label] = found
    grounds = [driving.flat_ground(), *([make_terrain("rough", plan.options.seed)] if rough else [])]
    for ground in grounds:
        log.info(f"{evaluated.name}: courses on {ground.name}")
        runs = driving.run_ring(evaluated.model, ground, walks, plan.options.course_seconds)
        for walk, run in zip(walks, runs, strict=True):
            result[walk.style][walk.gait.label][ground.name] = _course_scores(run)
    return result


def _walks(
    plan: EvaluationPlan, evaluated: EvaluatedModel, styles: Sequence[str], gaits: Iterable[str]
) -> list[RingWalk]:
    """Return walks of every style in each of `gaits` that it has."""
    return [
        RingWalk(style, evaluated.style(style, k), GAITS[gait], plan.options.seed + k)
        for k, style in enumerate(styles)
        for gait in gaits
        if gait in plan.gaits(style)
    ]


def _course_scores(run: RingRun) -> dict[str, Any]:
    motion = run.motion
    assert motion.unlocked is not None
    return {
        "before": skating_means([foot_skating(motion.unlocked, motion.terrain)]),
        "after": skating_means([foot_skating(motion.positions, motion.terrain)]),
        "path_error_m": float(run.path_error.mean()),
        "speed_m_s": mean_speed(motion.positions),
        "requested_m_s": float(run.requested_speed.mean()),
    }


def score_terrain(plan: EvaluationPlan, evaluated: EvaluatedModel) -> dict[str, Any]:
    """Score sinking and floating of soles, and path error, on uneven ground: neutral first, then other styles."""
    result: dict[str, Any] = {}
    styles = _walking_styles(plan)[: plan.options.terrain_styles]
    walks = _walks(plan, evaluated, styles, GAITS)
    for name in TERRAINS:
        ground = make_terrain(name, plan.options.seed)
        log.info(f"{evaluated.name}: on {name}")
        runs = driving.run_ring(evaluated.model, ground, walks, plan.options.course_seconds)
        for gait, label in GAITS.items():
            rows = [
                {**terrain_feet(run.motion.positions, ground), "path_error_m": run.path_error.mean()}
                for walk, run in zip(walks, runs, strict=True)
                if walk.gait == label
            ]
            if rows:
                result[f"{name} {gait}"] = {key: float(np.mean([r[key] for r in rows])) for key in rows[0]}
    return result


def _walking_styles(plan: EvaluationPlan) -> list[str]:
    styles = [style for style in plan.styles if "walk" in plan.gaits(style)]
    order = np.random.default_rng(plan.options.seed).permutation(len(styles))
    mixed = [styles[i] for i in order]
    return sorted(mixed, key=lambda s: s != "neutral")  # stable sort: the others stay shuffled


# --- transitions and diversity ----------------------------------------------------------------------------------------


def score_transitions(plan: EvaluationPlan, evaluated: EvaluatedModel) -> dict[str, float]:
    """Score jerk around prompt changes between random styles, walking, relative to that within the styles."""
    rng = np.random.default_rng(plan.options.seed + 2)
    count, styles = plan.options.transitions, _walking_styles(plan)
    if len(styles) < 2:
        return {}
    log.info(f"{evaluated.name}: {count} transitions")
    pairs = [rng.choice(len(styles), 2, replace=False) for _ in range(count)]
    codes = [
        (evaluated.style(styles[one], k), evaluated.style(styles[other], k))
        for k, (one, other) in enumerate(pairs)
    ]
    walks = driving.transitions(evaluated.model, codes, plan.options.seed)
    ratios = [transition_jerk(positions, driving.STEADY_FRAMES) for positions in walks]
    return {"ratio": float(np.mean(ratios)), "count": count}


def score_diversity(
    plan: EvaluationPlan, evaluated: EvaluatedModel, temperatures: Sequence[float] = (0.0, 1.0)
) -> dict[str, Any]:
    """Score diversity at temperature 1, and on a few clips at 0, on random captured clips, held-out ones first.

    Both generations use the clip's control variables; only the seed of the noise differs.
    """
    result: dict[str, Any] = {}
    clips = list(enumerate(diversity_clips(plan)))
    for temperature in temperatures:
        log.info(f"{evaluated.name}: diversity at temperature {temperature:.0f}")
        shown = clips if temperature > 0 else clips[:DETERMINISM_CLIPS]
        takes = [Take(clip, evaluated.style(clip.style, k), seed) for k, clip in shown for seed in (1, 2)]
        made = driving.replay(evaluated.model, takes, temperature, DIVERSITY_LEAD_IN)
        distances = [pair_distance(*pair) for pair in zip(made[::2], made[1::2], strict=True)]
        result[f"temperature_{temperature:.0f}"] = float(np.mean(distances))
    return result


def diversity_clips(plan: EvaluationPlan) -> Iterator[Motion]:
    """Yield clips of 180 frames plus lead-in, cycling through the groups."""
    rng = np.random.default_rng(plan.options.seed + 3)
    length = DIVERSITY_LEAD_IN + DIVERSITY_FRAMES
    by_group: dict[str, list[ClipInfo]] = {}
    for clip in plan.capture.clips:
        if clip.frames >= length and clip.gaits.get(Gait.JUMP, 0) == 0:
            by_group.setdefault(clip.group, []).append(clip)
    pools = [
        sorted((c[i] for i in rng.permutation(len(c))), key=lambda clip: not clip.held_out)
        for _, c in sorted(by_group.items())
    ]
    chosen = [p[k] for k in range(max(map(len, pools))) for p in pools if k < len(p)]
    for clip in chosen[: plan.options.diversity_clips]:
        first = int(rng.integers(0, clip.frames - length + 1))
        yield load_motion(clip.path).cut(first, first + length)


# --- the capture itself -----------------------------------------------------------------------------------------------


def score_held_out(plan: EvaluationPlan) -> dict[str, Any]:
    """Score held-out captured clips with the same code."""
    log.info("held-out capture")
    styles = [style for style in plan.styles if len(plan.held_out[style])]
    clips = [clip for style in styles for clip in plan.capture.of(style, True)]
    return {
        "name": "held-out capture",
        "fmd": {n: _split_distance(plan, n, styles) for n in plan.feature_sets},
        "skating": {name: clip_skating(clips, gait) for name, gait in GAITS.items()},
        "recognition": _recognition(plan, {g: plan.held_out[g] for g in styles}),
    }


def _split_distance(plan: EvaluationPlan, name: str, styles: list[str]) -> dict[str, float]:
    """Return the distance between held-out and training windows, equally many per style."""
    rng = np.random.default_rng(plan.options.seed)
    project = plan.projection(name, OVERALL_COMPONENTS)
    labels = np.asarray(plan.training_styles)
    distances, count = [], 0
    for _ in range(DRAWS):
        drawn = []
        for style in styles:
            sides = plan.held_out[style].of(name), plan.training.of(name)[labels == style]
            n = min(map(len, sides))
            drawn.append([side[rng.permutation(len(side))[:n]] for side in sides])
        a, b = (project(np.concatenate(side)) for side in zip(*drawn, strict=True))
        distances.append(frechet_distance(a, b))
        count = len(a)
    return {"distance": float(np.mean(distances)), "windows": count}
