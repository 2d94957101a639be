"""Six obstacle courses: a straight path along +Z at full stick, and its scores by style and gait."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np

from runtime.arrays import Array, Flags
from runtime.controls import Controls, Gait
from runtime.motion.control_scripts import LOOK_AHEAD_M
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel
from runtime.terrain.courses import BEAM, BEAM_RAMP_M, GAPS, HURDLES, WALLS, Obstacle
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from training.evaluation.metrics import crossing
from training.evaluation.metrics.classifiers import StyleClassifier, merged
from training.evaluation.metrics.features import window_set
from training.evaluation.metrics.feet import foot_skating
from training.evaluation.metrics.motion import Motion
from training.evaluation.motion.driving import Recorder
from training.evaluation.motion.evaluated_model import EvaluatedModel

BEYOND_M = 1.5  # behind the last obstacle the run is over
SPARE_S = 25.0  # that a run may take longer than the path at full stick


@dataclass(frozen=True)
class ObstacleCourse:
    """Ground with obstacles along +Z; of stairs and hills the whole path is one."""

    name: str
    title: str
    ground: str  # name of a ready terrain
    obstacles: tuple[Obstacle, ...]

    def terrain(self) -> Terrain:
        """The ground, always the same."""
        return make_terrain(self.ground)


COURSES = (
    ObstacleCourse("hurdles", "hurdles of 20 to 60 cm", "hurdles", HURDLES),
    ObstacleCourse("beam", "beam of 20 cm, 40 cm high", "beam", (BEAM,)),
    ObstacleCourse("stairs", "stairs, 8 steps up and down", "stairs", (Obstacle(3.0, 10.7, 1.28, 9.0),)),
    ObstacleCourse("platforms", "platforms to 50 cm, gaps of 40 to 80 cm", "gaps", GAPS),
    ObstacleCourse("hill", "hills to 18 degrees", "hills", (Obstacle(2.5, 14.0, 0.0, 9.0),)),
    ObstacleCourse("wall", "walls of 0.6, 1.0 and 1.4 m", "wall", WALLS),
)
LEVEL = ObstacleCourse("level", "level ground", "flat", (Obstacle(3.0, 12.0, 0.0, 9.0),))  # for comparison


@dataclass(frozen=True)
class ObstacleRun:
    """One character over one course."""

    course: ObstacleCourse
    motion: Motion
    root: Array  # (T, 2) metres
    requested_speed: Array  # (T,) m/s
    blocked: tuple[str, ...]  # what the status line said
    keyed: Flags  # (T,) keyed motion was shown


def run_obstacles(
    model: MotionModel, course: ObstacleCourse, style: str, code: Array, gait: Gait, seed: int
) -> ObstacleRun:
    """From the start mark at full stick along the middle of a course until it is passed or time is up."""
    controller = Controller(model, course.terrain(), seed)
    controller.set_style(code, 0.0)
    controller.reset()
    controller.settle()
    recorder = Recorder(controller)
    end = course.obstacles[-1].end + BEYOND_M
    limit = round((end / controller.full_speed(gait) * 1.3 + SPARE_S) * FPS)
    roots, speeds, blocked = [], [], set()
    keyed = []
    for _ in range(limit):
        root = controller.pose.root_position.astype(np.float64)
        ahead = np.array([-root[0], LOOK_AHEAD_M])
        ahead /= np.linalg.norm(ahead)
        pose = recorder.step(Controls((float(ahead[0]), float(ahead[1])), gait=gait))
        roots.append(pose.root_position[[0, 2]])
        speeds.append(controller.requested_speed)
        keyed.append(bool(controller.traversal))
        if controller.blocked:
            blocked.add(controller.blocked)
        if pose.root_position[2] > end:
            break
    labels = np.full(len(roots), int(gait))
    motion = recorder.motion(f"{style} {gait.label} {course.name}", style, labels, 0)
    return ObstacleRun(
        course, motion, np.stack(roots), np.array(speeds), tuple(sorted(blocked)), np.array(keyed)
    )


def score_run(run: ObstacleRun) -> dict[str, Any]:
    """Figures of one run as plain data; depths in cm, before and after foot lock."""
    course, motion, ground = run.course, run.motion, run.motion.terrain
    assert motion.unlocked is not None
    inside = [crossing.crossing_frames(run.root, o) for o in course.obstacles]
    within = np.any(inside, axis=0)
    sound = [bool(w.any()) and not crossing.first_problem(motion.positions[w], ground) for w in inside]
    own = [s and not run.keyed[w].any() for s, w in zip(sound, inside, strict=True)]
    passed = [crossing.seconds_over(run.root, o) for o in course.obstacles]
    over = [p for p in passed if p is not None]
    times = [p[0] for p in over]
    result: dict[str, Any] = {
        "before": crossing.depths(motion.unlocked, ground, within),
        "after": crossing.depths(motion.positions, ground, within),
        "obstacles": len(passed),
        "passed": len(over),
        "sound": sum(s and p is not None for s, p in zip(sound, passed, strict=True)),
        "own": sum(o and p is not None for o, p in zip(own, passed, strict=True)),
        "seconds_each": float(np.mean(times)) if times else None,
        "slowest_m_s": min((p[1] for p in over), default=None),
        "requested_m_s": float(run.requested_speed.max()),
        "frozen_s": crossing.frozen_seconds(motion.positions, run.root, run.requested_speed),
        "skating": foot_skating(motion.positions, ground, np.ones(len(motion), bool)).soles,
        "blocked": list(run.blocked),
        "keyed_s": float(run.keyed.sum() / FPS),
        "keyed_fraction": float(run.keyed[within].mean()) if within.any() else None,
    }
    for name, positions in (("before", motion.unlocked), ("after", motion.positions)):
        result[name] |= _own_measures(course, positions, motion.contacts)
    return result


def _own_measures(course: ObstacleCourse, positions: Array, contacts: Array) -> dict[str, Any]:
    """What only one kind of course has."""
    if course.name == "hurdles":
        values = crossing.clearances(positions, course.obstacles)
        return {
            "clearance": float(np.median(values)) if values else None,
            "touched": float(np.mean(np.array(values) < 1.0)) if values else None,
        }
    if course.name == "beam":
        on, off = crossing.beam_contacts(positions, contacts, BEAM, BEAM_RAMP_M)
        return {
            "on_beam": on / (on + off) if on + off else None,
            "falls": crossing.falls(positions, contacts, BEAM, BEAM_RAMP_M),
        }
    if course.name == "platforms":
        gaps = [g for g in pairwise(course.obstacles) if positions[-1, 0, 2] > g[1].begin]
        flown, clean = crossing.flights(positions, contacts, gaps)
        return {"gaps": len(gaps), "flown": flown, "not_stepped_into": clean}
    if course.name == "wall":
        hands = crossing.hands_on_edge(positions, course.obstacles)
        tops = [crossing.on_top_after(positions, w) for w in course.obstacles]
        return {"hands_s": hands, "on_top_s": tops}
    return {}


Report = Callable[[str], None]
Runner = Callable[[ObstacleCourse, str, Gait], ObstacleRun]

STYLES = ("neutral", "old", "exhausted", "angry", "drunk", "happy")
GAITS = (Gait.WALK, Gait.JOG)


def runner_of(evaluated: EvaluatedModel, seed: int) -> Runner:
    """Leads a model's character over a course in the first description of a style."""
    return lambda course, style, gait: run_obstacles(
        evaluated.model, course, style, evaluated.style(style, 0), gait, seed
    )


def score_obstacles(
    run: Runner,
    styles: Sequence[str],
    courses: Iterable[ObstacleCourse],
    classifier: StyleClassifier | None,
    report: Report,
    gaits: Sequence[Gait] = GAITS,
) -> dict[str, Any]:
    """A row for each course, style and gait, and how often the style is recognised there and on level ground."""
    rows: list[dict[str, Any]] = []
    grounds = [*courses, *([] if classifier is None else [LEVEL])]
    for course, style, gait in product(grounds, styles, gaits):
        report(f"{course.name}: {style}, {gait.label}")
        done = run(course, style, gait)
        row: dict[str, Any] = {"course": course.name, "style": style, "gait": gait.label}
        row["recognised"] = _recognised(done, classifier)
        rows.append(row if course is LEVEL else row | score_run(done))
    level = [r for r in rows if r["course"] == LEVEL.name]
    return {"rows": [r for r in rows if r["course"] != LEVEL.name], "level": level}


def _recognised(run: ObstacleRun, classifier: StyleClassifier | None) -> float | None:
    """Fraction of the windows that are taken for the style, look-alikes counted as one; None where that is unknown."""
    style = run.motion.style
    if classifier is None or style not in classifier.labels:
        return None
    windows = window_set([run.motion], None)
    answers = classifier.predict(windows.for_classifier)
    return float(np.mean([merged(a) == merged(style) for a in answers])) if answers else None


def by_name(names: Sequence[str]) -> tuple[ObstacleCourse, ...]:
    """The courses of these names, in their order; all without names."""
    return tuple(c for c in COURSES if not names or c.name in names)
