"""Blinded films of every method in an offline page.

The page contains the films under random names; only `key.json`, for the organiser, maps them to methods. Obstacles are
crossed in neutral style, walking and jogging (the paper's two animations of each); styles are walked on level ground along
the path of their own capture. For the method capture only obstacles that were captured are filmed.
"""

import base64
import json
import secrets
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from runtime.atomic import temporary_folder, write_atomic
from runtime.controls import Gait
from runtime.errors import UsageError
from runtime.motion.features import FPS
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from training.evaluation.metrics.motion import Motion, load_motion
from training.evaluation.motion.capture import TERRAIN_GROUP, ClipInfo, read_capture
from training.evaluation.motion.driving import Take, flat_ground, follow
from training.evaluation.motion.evaluated_model import EvaluatedModel, style_texts
from training.evaluation.on_obstacles import COURSES, ObstacleCourse, run_obstacles
from training.evaluation.text.walks import straight_walks

Report = Callable[[str], None]

FORMAT = "sport-study"
PAGE, KEY = "index.html", "key.json"
CAPTURE = "capture"  # films of this method with low ratings are shown again
STYLES = ("old", "proud", "drunk", "chicken", "aeroplane", "exhausted")
SIZE, FILM_FPS = (448, 252), 20.0
BEFORE_M, BEHIND_M = 1.6, 1.2  # filmed before and behind an obstacle
SHOWN = {"hurdles": 1, "platforms": 1, "wall": 1}  # index of the filmed obstacle of a course, if not 0
# part of the content of clips that were captured on an obstacle
CAPTURED = {"stairs": "climb 3 steps", "platforms": "platform", "hill": "uneven terrain", "hurdles": "hurdle"}
GROUND_M, CELL_M = 28.0, 0.1  # size and cell of the filmed ground
STILL_M = 0.4  # minimum distance walked in a film


@dataclass(frozen=True)
class Scene:
    """One film of the study, before rendering."""

    method: str
    kind: str  # "obstacle" or "style"
    title: str  # shown to the participant
    clip: Clip
    terrain: Terrain


def make(
    out: Path, methods: dict[str, Path], clips: Path | None, seconds: float, report: Report = lambda _: None
) -> Path:
    """Write page and key into the new folder `out`; returns the page. `clips`: imported capture, as a further method.

    UsageError if the folder contains a study, or for fewer than two methods.
    """
    if (out / KEY).exists():
        raise UsageError(
            f"{out}: already contains a study, whose answers need its key.", "Choose a new folder."
        )
    if len(methods) + (clips is not None) < 2:
        raise UsageError(
            "A study compares at least two methods.",
            "Give another --model, or --clips for the capture itself.",
        )
    if CAPTURE in methods:
        raise UsageError(f"--model {CAPTURE}: this name is reserved for the capture.", "Choose another name.")
    films = []
    for scene in _scenes(methods, clips, seconds):
        report(f"{scene.title}: {scene.method}")
        films.append((scene, draw(scene)))
    return write_study(out, films)


def write_study(out: Path, films: Sequence[tuple[Scene, bytes]]) -> Path:
    """Write the page with all films (MP4) embedded, and the key next to it; returns the page."""
    out.mkdir(parents=True, exist_ok=True)
    study = secrets.token_hex(8)
    named = {secrets.token_hex(6): film for film in films}
    content = {
        "format": FORMAT,
        "study": study,
        "clips": [
            {
                "id": name,
                "kind": scene.kind,
                "title": scene.title,
                "again": scene.method == CAPTURE,
                "film": "data:video/mp4;base64," + base64.b64encode(data).decode("ascii"),
            }
            for name, (scene, data) in sorted(named.items(), key=lambda item: item[0])  # no order of methods
        ],
    }
    key = {
        "format": f"{FORMAT}-key",
        "study": study,
        "methods": list(dict.fromkeys(scene.method for scene, _ in films)),
        "clips": {
            name: {k: getattr(scene, k) for k in ("method", "kind", "title")}
            for name, (scene, _) in named.items()
        },
    }
    template = (Path(__file__).parent / "page.html").read_text(encoding="utf-8")
    page = template.replace("/*STUDY*/null", json.dumps(content).replace("</", "<\\/"))
    write_atomic(out / PAGE, page)
    write_atomic(out / KEY, json.dumps(key, indent=1) + "\n")
    return out / PAGE


def draw(scene: Scene) -> bytes:
    """Render the film of a scene by the viewer's renderer, without a caption."""
    from viewer.filming.film import FilmOptions, make_film

    camera = "side" if scene.kind == "obstacle" else "front"
    options = FilmOptions(*SIZE, fps=FILM_FPS, camera=camera, captions=False, quality="software")
    with temporary_folder() as folder:
        path = folder / "film.mp4"
        make_film(scene.clip, _widened(scene.terrain, scene.clip), path, options)
        return path.read_bytes()


# --- scenes -----------------------------------------------------------------------------------------------------------


def _scenes(methods: dict[str, Path], clips: Path | None, seconds: float) -> Iterator[Scene]:
    """Yield every motion of every method."""
    models = {name: EvaluatedModel(folder, style_texts()) for name, folder in methods.items()}
    capture = [] if clips is None else [c for c in read_capture(clips).clips if c.group != TERRAIN_GROUP]
    capture.sort(key=lambda clip: not clip.held_out)
    for course in COURSES:
        for gait, (name, evaluated) in product((Gait.WALK, Gait.JOG), models.items()):
            yield Scene(name, "obstacle", course.title, *_over(evaluated, course, gait, seconds))
        for motion in _captured_obstacles(capture, course.name, 2):
            clip = clip_of(_middle(motion, seconds))
            yield Scene(CAPTURE, "obstacle", course.title, clip, motion.terrain)
    yield from _style_scenes(models, capture, seconds)


def _style_scenes(
    models: dict[str, EvaluatedModel], capture: Sequence[ClipInfo], seconds: float
) -> Iterator[Scene]:
    """Yield walks in styles along the path of their own capture."""
    for style in STYLES:
        title, path = style.replace("_", " "), _captured_walk(capture, style)
        for name, evaluated in models.items():
            yield Scene(name, "style", title, *_in_style(evaluated, style, path, seconds))
        if path is not None:
            yield Scene(CAPTURE, "style", title, clip_of(_middle(path, seconds)), path.terrain)


def _captured_walk(capture: Iterable[ClipInfo], style: str) -> Motion | None:
    """Return the middle of a captured forward walk in a style."""
    walks = (c.path for c in capture if c.style == style and c.content == "walk forward")
    path = next(walks, None)
    return None if path is None else _middle(load_motion(path), 6.0)


def _widened(terrain: Terrain, clip: Clip) -> Terrain:
    """Return the ground around a clip, extended beyond its edges, which would reveal captured patches."""
    x, z = (float(v) for v in clip.hips_positions[:, [0, 2]].mean(0))
    along = np.arange(-GROUND_M / 2, GROUND_M / 2 + CELL_M, CELL_M)
    heights = terrain.height((x + along)[:, None], (z + along)[None, :])
    return Terrain("ground", heights.astype(np.float32), CELL_M, (x - GROUND_M / 2, z - GROUND_M / 2))


def clip_of(motion: Motion) -> Clip:
    """Return the clip of a motion, without a name that reveals its method."""
    return Clip("clip", FPS, motion.hips, motion.local, motion.contacts)


def _middle(motion: Motion, seconds: float) -> Motion:
    length = min(len(motion), round(seconds * FPS))
    first = (len(motion) - length) // 2
    return motion.cut(first, first + length)


def _over(
    evaluated: EvaluatedModel, course: ObstacleCourse, gait: Gait, seconds: float
) -> tuple[Clip, Terrain]:
    """Generate a traversal of one obstacle of a course, starting shortly before it."""
    number = SHOWN.get(course.name, 0)
    shown = course.obstacles[number]
    upto = replace(course, obstacles=course.obstacles[: number + 1])
    run = run_obstacles(evaluated.model, upto, "neutral", evaluated.style("neutral", 0), gait, 0)
    z = run.root[:, 1]
    near = np.flatnonzero((z > shown.begin - BEFORE_M) & (z < shown.end + BEHIND_M))
    first = int(near[0]) if len(near) else 0
    motion = run.motion.cut(first, min(first + round(seconds * FPS), len(run.motion)))
    return clip_of(motion), run.motion.terrain


def _in_style(
    evaluated: EvaluatedModel, style: str, path: Motion | None, seconds: float
) -> tuple[Clip, Terrain]:
    """Generate a walk in a style along a captured path, or straight ahead."""
    z = evaluated.style(style, 0)
    if path is None:
        (walk,) = straight_walks(evaluated.model, [z], seconds)
        return Clip("clip", FPS, *walk), flat_ground()
    walked = replace(path, gait=np.full(len(path), Gait.WALK))
    (made,) = follow(evaluated.model, [Take(walked, z)])
    return clip_of(_middle(made, seconds)), path.terrain


def _captured_obstacles(capture: Iterable[ClipInfo], course: str, count: int) -> list[Motion]:
    """Return captured motions over an obstacle of this kind that travel a minimum distance."""
    if course not in CAPTURED:
        return []
    motions = (load_motion(c.path) for c in capture if CAPTURED[course] in c.content)
    moving = [m for m in motions if np.ptp(m.hips[:, [0, 2]], axis=0).max() > STILL_M]
    return moving[:count]
