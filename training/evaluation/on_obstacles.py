"""Six obstacle courses along +Z at full stick: scores by style and gait, and tables."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from math import isnan
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
from training.evaluation import log
from training.evaluation.experiment import Experiment, Setting, command_of, option
from training.evaluation.metrics import traversal
from training.evaluation.metrics.classifiers import StyleClassifier, merged
from training.evaluation.metrics.features import window_set
from training.evaluation.metrics.feet import foot_skating, skating_means
from training.evaluation.metrics.motion import Motion
from training.evaluation.motion.capture import Options, make_plan
from training.evaluation.motion.driving import Stick, Track, characters, walked
from training.evaluation.motion.evaluated_model import EvaluatedModel
from training.markdown import columns, number, percent

BEYOND_M = 1.5  # behind the last obstacle, where the run ends
SPARE_S = 25.0  # allowed in addition to the time of the path at full stick


@dataclass(frozen=True)
class ObstacleCourse:
    """Ground with obstacles along +Z; stairs and hills count as one obstacle."""

    name: str
    title: str
    ground: str  # name of a predefined terrain
    obstacles: tuple[Obstacle, ...]

    def terrain(self) -> Terrain:
        """Load the ground, which is always the same."""
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
    keyed: Flags  # (T,) keyframed motion was active


def run_obstacles(
    model: MotionModel, course: ObstacleCourse, style: str, code: Array, gait: Gait, seed: int
) -> ObstacleRun:
    """Walk a character from the start mark at full stick along a course until its end or the time limit."""
    controller = at_start(model, course.terrain(), code, seed)
    end = course.obstacles[-1].end + BEYOND_M
    limit = round((end / controller.full_speed(gait) * 1.3 + SPARE_S) * FPS)
    track = walked_to(end, controller, partial(along_the_middle, gait=gait), limit)
    motion = track.motion(f"{style} {gait.label} {course.name}", style, gait)
    return ObstacleRun(course, motion, track.root, np.array(track.requested_speed), np.array(track.keyed))


def at_start(model: MotionModel, ground: Terrain, code: Array, seed: int) -> Controller:
    """Create a character in a style, standing at the start mark."""
    (controller,) = characters(model, ground, [code], [seed])
    controller.reset()
    controller.settle()
    return controller


def walked_to(end_m: float, controller: Controller, stick: Stick, frames: int) -> Track:
    """Walk a character until it is `end_m` along +Z, or for `frames`."""
    return walked([controller], stick, frames, lambda member: member.pose.root_position[2] > end_m)[0]


def along_the_middle(
    controller: Controller,
    frame: int,
    gait: Gait,
    amount: float = 1.0,
    side: Callable[[float], float] = lambda z: 0.0,
) -> Controls:
    """Return controls that follow +Z, at an offset of `side` metres to the left of the middle."""
    root = controller.pose.root_position.astype(np.float64)
    ahead = np.array([side(root[2]) - root[0], LOOK_AHEAD_M])
    ahead = amount * (ahead / np.linalg.norm(ahead))
    return Controls((float(ahead[0]), float(ahead[1])), gait=gait)


def score_run(run: ObstacleRun) -> dict[str, Any]:
    """Score a run; returns plain data, depths in cm, before and after foot lock."""
    course, motion, ground = run.course, run.motion, run.motion.terrain
    assert motion.unlocked is not None
    within = np.any([traversal.traversal_frames(run.root, o) for o in course.obstacles], axis=0)
    result: dict[str, Any] = {
        "obstacles": len(course.obstacles),
        **_passed(run),
        "requested_m_s": float(run.requested_speed.max()),
        "frozen_s": traversal.frozen_seconds(motion.positions, run.root, run.requested_speed),
        "skating": skating_means([foot_skating(motion.positions, ground)])["soles"],
        "keyed_s": float(run.keyed.sum() / FPS),
        "keyed_fraction": float(run.keyed[within].mean()) if within.any() else None,
    }
    for name, positions in (("before", motion.unlocked), ("after", motion.positions)):
        own = _OWN_MEASURES.get(course.name, lambda *_: {})
        result[name] = traversal.depths(positions, ground, within)
        result[name] |= own(course, positions, motion.contacts)
    return result


def _passed(run: ObstacleRun) -> dict[str, Any]:
    """Count obstacles passed and traversals that pass every check, with time per obstacle and lowest speed."""
    motion, frames, paces = run.motion, [], []
    for obstacle in run.course.obstacles:
        pace = traversal.seconds_over(run.root, obstacle)
        if pace is not None:
            frames.append(traversal.traversal_frames(run.root, obstacle))
            paces.append(pace)
    sound = [
        w for w in frames if w.any() and not traversal.first_problem(motion.positions[w], motion.terrain)
    ]
    return {
        "passed": len(paces),
        "sound": len(sound),
        "own": sum(not run.keyed[w].any() for w in sound),
        "seconds_each": float(np.mean([seconds for seconds, _ in paces])) if paces else None,
        "slowest_m_s": min((slowest for _, slowest in paces), default=None),
    }


def _hurdles(course: ObstacleCourse, positions: Array, contacts: Array) -> dict[str, Any]:
    values = np.array(traversal.clearances(positions, course.obstacles))
    if not len(values):
        return {"clearance": None, "touched": None}
    return {"clearance": float(np.median(values)), "touched": float((values < 1.0).mean())}


def _beam(course: ObstacleCourse, positions: Array, contacts: Array) -> dict[str, Any]:
    on, off = traversal.beam_contacts(positions, contacts, BEAM, BEAM_RAMP_M)
    fraction = on / (on + off) if on + off else None
    return {"on_beam": fraction, "falls": traversal.falls(positions, contacts, BEAM, BEAM_RAMP_M)}


def _platforms(course: ObstacleCourse, positions: Array, contacts: Array) -> dict[str, Any]:
    gaps = [g for g in pairwise(course.obstacles) if positions[-1, 0, 2] > g[1].begin]
    flown, clean = traversal.flights(positions, contacts, gaps)
    return {"gaps": len(gaps), "flown": flown, "not_stepped_into": clean}


def _walls(course: ObstacleCourse, positions: Array, contacts: Array) -> dict[str, Any]:
    tops = [traversal.on_top_after(positions, wall) for wall in course.obstacles]
    return {"hands_s": traversal.hands_on_edge(positions, course.obstacles), "on_top_s": tops}


# measures specific to one kind of course
_OWN_MEASURES: dict[str, Callable[[ObstacleCourse, Array, Array], dict[str, Any]]] = {
    "hurdles": _hurdles,
    "beam": _beam,
    "platforms": _platforms,
    "wall": _walls,
}


STYLES = ("neutral", "old", "exhausted", "angry", "drunk", "happy")
GAITS = (Gait.WALK, Gait.JOG)


def obstacle_courses(setting: Setting) -> dict[str, Any]:
    """Return all figures as plain data; styles are recognised if clips are given, as in `sport evaluate`."""
    args, classifier = setting.args, None
    if args.clips is not None:
        classifier = make_plan(args.clips, None, Options(), None).classifier
    results = score_obstacles(setting.models[0], args.seed, args.styles or STYLES, COURSES, classifier)
    command = command_of("sport evaluate --courses", args)
    return {"command": command, "model": setting.models[0].name, **results}


def score_obstacles(
    evaluated: EvaluatedModel,
    seed: int,
    styles: Sequence[str],
    courses: Iterable[ObstacleCourse],
    classifier: StyleClassifier | None,
) -> dict[str, Any]:
    """Score each course, style and gait, with recognition of the style there and on level ground."""
    rows: list[dict[str, Any]] = []
    grounds = [*courses, *([] if classifier is None else [LEVEL])]
    for course, style, gait in product(grounds, styles, GAITS):
        log.info(f"{course.name}: {style}, {gait.label}")
        done = run_obstacles(evaluated.model, course, style, evaluated.style(style, 0), gait, seed)
        row: dict[str, Any] = {"course": course.name, "style": style, "gait": gait.label}
        row["recognised"] = _recognised(done, classifier)
        rows.append(row if course is LEVEL else row | score_run(done))
    level = [r for r in rows if r["course"] == LEVEL.name]
    return {"rows": [r for r in rows if r["course"] != LEVEL.name], "level": level}


def _recognised(run: ObstacleRun, classifier: StyleClassifier | None) -> float | None:
    """Return the fraction of windows recognised as the style or a similar one; None if the classifier lacks it."""
    style = run.motion.style
    if classifier is None or style not in classifier.labels:
        return None
    windows = window_set([run.motion], None, under_body=True)
    answers = classifier.predict(windows.for_classifier)
    return float(np.mean([merged(a) == merged(style) for a in answers])) if answers else None


# --- tables -----------------------------------------------------------------------------------------------------------


Row = dict[str, Any]


def markdown(results: dict[str, Any]) -> str:
    """Return all tables of `results`, the content of `--json`: means per course, then a row per style and gait."""
    found = [[r for r in results["rows"] if r["course"] == course.name] for course in COURSES]
    found = [runs for runs in found if runs]
    level = traversal.mean_of(results["level"], "recognised")

    def recognised(runs: list[Row]) -> str:
        known = traversal.mean_of(runs, "recognised")
        return percent(known) + ("" if isnan(known / level) else f" ({known / level:.2f})")

    name = f"recognised (of level ground's {percent(level)})"
    lines = [f"`{results['command']}`", "", *columns(OVERVIEW_COLUMNS | {name: recognised}, found)]
    for runs in found:
        title, own = _title(runs), OWN_COLUMNS.get(runs[0]["course"], {})
        shown = RUN_COLUMNS | own | {"recognised": lambda r: percent(r["recognised"])}
        lines += [f"### {title[0].upper()}{title[1:]}", "", *columns(shown, runs)]
    return "\n".join(lines) + "\n"


def _title(runs: list[Row]) -> str:
    return next(course.title for course in COURSES if course.name == runs[0]["course"])


def _total(runs: list[Row], key: str) -> int:
    return sum(run[key] for run in runs)


OVERVIEW_COLUMNS: dict[str, Callable[[list[Row]], str]] = {
    "means over styles and gaits; before > after foot lock": _title,
    "got over": lambda runs: f"{_total(runs, 'passed')} of {_total(runs, 'obstacles')}",
    "soles sunk p99, cm": lambda runs: _both(runs, "sole_p99"),
    "joint inside": lambda runs: _both(runs, "joint_inside", percent),
    "over 3 cm": lambda runs: _both(runs, "joint_deep", percent),
    "thigh over 3 cm": lambda runs: _both(runs, "thighs_deep", percent),
    "shin": lambda runs: _both(runs, "shins_deep", percent),
    "hand": lambda runs: _both(runs, "hands_deep", percent),
    "soles slide, cm a frame": lambda runs: number(traversal.mean_of(runs, "skating"), 2),
    "frozen s": lambda runs: str(_total(runs, "frozen_s")),
    "keyed": lambda runs: percent(traversal.mean_of(runs, "keyed_fraction")),
    "traversals that pass every check": lambda runs: percent(
        _total(runs, "sound") / _total(runs, "obstacles")
    ),
    "by the network alone": lambda runs: percent(_total(runs, "own") / _total(runs, "obstacles")),
}


def _both(rows: Sequence[Row], key: str, show: Any = number) -> str:
    return " > ".join(show(traversal.mean_of([r[side] for r in rows], key)) for side in ("before", "after"))


RUN_COLUMNS: dict[str, Callable[[Row], str]] = {
    "": lambda r: f"{r['style']} {r['gait']}",
    "got over": lambda r: f"{r['passed']} of {r['obstacles']}",
    "s each": lambda r: number(r["seconds_each"]),
    "slowest / requested m/s": lambda r: f"{number(r['slowest_m_s'], 2)} / {number(r['requested_m_s'], 2)}",
    "soles p99, cm": lambda r: _both([r], "sole_p99"),
    "deepest joint, cm": lambda r: _both([r], "joint_max"),
    "thigh, shin, hand p99, cm, after lock": lambda r: ", ".join(
        number(r["after"].get(f"{limb}_p99")) for limb in traversal.CAPSULES
    ),
}


def _each(row: Row, key: str) -> str:
    return " / ".join(number(v) for v in row["after"][key])


OWN_COLUMNS: dict[str, dict[str, Callable[[Row], str]]] = {
    "hurdles": {
        "clearance, median cm": lambda r: _both([r], "clearance"),
        "feet that touch": lambda r: _both([r], "touched", percent),
    },
    "beam": {
        "contacts on it": lambda r: _both([r], "on_beam", percent),
        "falls off": lambda r: f"{r['before']['falls']} > {r['after']['falls']}",
    },
    "platforms": {
        "gaps flown over, after lock": lambda r: f"{r['after']['flown']} of {r['after']['gaps']}",
        "not stepped into": lambda r: f"{r['after']['not_stepped_into']} of {r['after']['gaps']}",
    },
    "wall": {
        "both hands on the edge, s": lambda r: _each(r, "hands_s"),
        "both feet on top after, s": lambda r: _each(r, "on_top_s"),
        "keyed s": lambda r: number(r["keyed_s"]),
    },
}

OBSTACLES = Experiment(
    "Lead a character over six obstacle courses and measure how it crosses them. Equal arguments give equal figures.",
    obstacle_courses,
    markdown,
    "obstacle courses",
    options=(
        "clips",
        "model",
        option("--styles", nargs="+", metavar="STYLE", help=f"default: {' '.join(STYLES)}"),
        "seed",
    ),
)
