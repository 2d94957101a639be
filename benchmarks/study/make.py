"""Films of every method, blinded, in a page that needs no network.

The page holds the films under random names; which method made which is in `key.json` alone, which stays with whoever runs the
study. Obstacles are crossed in a neutral style, walking and jogging (the paper's two animations of each), styles are walked on
level ground along the path of their own capture. Of capture, obstacles are filmed that were captured: no one else's are made up.
"""

from __future__ import annotations

import base64
import json
import secrets
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.atomic import write_atomic
from runtime.controls import Gait
from runtime.errors import UsageError
from runtime.motion.features import FPS
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain

if TYPE_CHECKING:
    from training.evaluation.metrics.motion import Motion
    from training.evaluation.motion.evaluated_model import EvaluatedModel

Report = Callable[[str], None]

FORMAT = "sport-study"
PAGE, KEY = "index.html", "key.json"
CAPTURE = "capture"  # the method whose low rating asks again
STYLES = ("old", "proud", "drunk", "chicken", "aeroplane", "exhausted")
SECONDS = 5.0  # of a film
SIZE, FILM_FPS = (448, 252), 20.0
BEFORE_M, BEHIND_M = 1.6, 1.2  # of an obstacle, that a film shows
SHOWN = {
    "hurdles": 1,
    "beam": 0,
    "stairs": 0,
    "platforms": 1,
    "hill": 0,
    "wall": 1,
}  # which obstacle of a course
# what was captured of an obstacle: a part of the imported clip's content
CAPTURED = {"stairs": "climb 3 steps", "platforms": "platform", "hill": "uneven terrain", "hurdles": "hurdle"}
GROUND_M, CELL_M = 28.0, 0.1  # of the ground that a film shows
STILL_M = 0.4  # metres that a film's character goes at least


@dataclass(frozen=True)
class Scene:
    """One film of the study, before it is drawn."""

    method: str
    kind: str  # "obstacle" or "style"
    title: str  # what the participant is told
    variant: str  # "walk", "jog"
    clip: Clip
    terrain: Terrain


@dataclass(frozen=True)
class Film:
    """A drawn film: MP4 bytes and what it shows."""

    scene: Scene
    data: bytes


def make(
    out: Path,
    methods: dict[str, Path],
    clips: Path | None = None,
    styles: Sequence[str] = STYLES,
    obstacles: Sequence[str] = tuple(SHOWN),
    seconds: float = SECONDS,
    gaits: Sequence[Gait] = (Gait.WALK, Gait.JOG),
    report: Report = lambda _: None,
) -> Path:
    """Write the page and its key into the new folder `out`; the page. `clips`: imported capture, the method to compare with.

    UsageError for a folder that holds a study, and for too few methods.
    """
    if (out / KEY).exists():
        raise UsageError(
            f"{out}: holds a study already; its answers belong to its key.", "Choose a new folder."
        )
    if len(methods) + (clips is not None) < 2:
        raise UsageError(
            "A study compares two methods at least.",
            "Give another --model, or --clips for the capture itself.",
        )
    if CAPTURE in methods:
        raise UsageError(f"--model {CAPTURE}: that name is the capture's.", "Choose another name.")
    out.mkdir(parents=True, exist_ok=True)
    films = [
        Film(scene, draw(scene))
        for scene in _scenes(methods, clips, styles, obstacles, seconds, gaits, report)
    ]
    return write_study(out, films)


def write_study(out: Path, films: Sequence[Film]) -> Path:
    """The page with all films inside, and the key beside it."""
    study = secrets.token_hex(8)
    names = [secrets.token_hex(6) for _ in films]
    shown = sorted(
        zip(names, films, strict=True), key=lambda pair: pair[0]
    )  # no order of methods in the page
    content = {
        "format": FORMAT,
        "study": study,
        "clips": [
            {
                "id": name,
                "kind": film.scene.kind,
                "title": film.scene.title,
                "again": film.scene.method == CAPTURE,
                "film": "data:video/mp4;base64," + base64.b64encode(film.data).decode("ascii"),
            }
            for name, film in shown
        ],
    }
    key = {
        "format": f"{FORMAT}-key",
        "study": study,
        "methods": list(dict.fromkeys(film.scene.method for film in films)),
        "clips": {
            name: {k: getattr(film.scene, k) for k in ("method", "kind", "title", "variant")}
            for name, film in zip(names, films, strict=True)
        },
    }
    template = (Path(__file__).parent / "page.html").read_text(encoding="utf-8")
    page = template.replace("/*STUDY*/null", json.dumps(content).replace("</", "<\\/"))
    write_atomic(out / PAGE, page)
    write_atomic(out / KEY, json.dumps(key, indent=1) + "\n")
    return out / PAGE


def draw(scene: Scene) -> bytes:
    """The film of a scene by the viewer's own renderer, without a caption."""
    from viewer.filming.film import FilmOptions, make_film

    options = FilmOptions(
        *SIZE,
        fps=FILM_FPS,
        camera="side" if scene.kind == "obstacle" else "front",
        captions=False,
        quality="software",
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        make_film(scene.clip, _widened(scene.terrain, scene.clip), path, options)
        return path.read_bytes()


# --- what is filmed ---------------------------------------------------------------------------------------------------


def _scenes(
    methods: dict[str, Path],
    clips: Path | None,
    styles: Sequence[str],
    obstacles: Sequence[str],
    seconds: float,
    gaits: Sequence[Gait],
    report: Report,
) -> Iterator[Scene]:
    """Every motion by every method, one after the other."""
    from training.evaluation.motion.evaluated_model import EvaluatedModel, style_texts
    from training.evaluation.motion.obstacles import by_name

    subjects = {name: EvaluatedModel(folder, style_texts()) for name, folder in methods.items()}
    captured = {} if clips is None else _captured_walks(clips, styles)
    for course in by_name(obstacles):
        for gait in gaits:
            variant = gait.label
            for name, subject in subjects.items():
                report(f"{course.title}, {variant}: {name}")
                clip, ground = _over(subject, course, gait, seconds)
                yield Scene(name, "obstacle", course.title, variant, clip, ground)
        if clips is not None:
            for number, motion in enumerate(_captured_obstacles(clips, course.name, len(gaits))):
                report(f"{course.title}: {CAPTURE}")
                part = _middle(motion, seconds)
                yield Scene(CAPTURE, "obstacle", course.title, str(number), clip_of(part), motion.terrain)
    for style in styles:
        path = captured.get(style)
        for name, subject in subjects.items():
            report(f"{style}: {name}")
            yield Scene(
                name, "style", style.replace("_", " "), "walk", *_in_style(subject, style, path, seconds)
            )
        if path is not None:
            part = _middle(path, seconds)
            yield Scene(CAPTURE, "style", style.replace("_", " "), "walk", clip_of(part), path.terrain)


def _widened(terrain: Terrain, clip: Clip) -> Terrain:
    """The ground around a clip, goes on as it ends: a captured patch must not be told from ours by its edge."""
    x, z = (float(v) for v in clip.hips_positions[:, [0, 2]].mean(0))
    along = np.arange(-GROUND_M / 2, GROUND_M / 2 + CELL_M, CELL_M)
    heights = terrain.height((x + along)[:, None], (z + along)[None, :])
    return Terrain("ground", heights.astype(np.float32), CELL_M, (x - GROUND_M / 2, z - GROUND_M / 2))


def clip_of(motion: Motion) -> Clip:
    """What a motion shows, without a name that tells who made it."""
    return Clip("clip", FPS, motion.hips, motion.local, motion.contacts)


def _middle(motion: Motion, seconds: float) -> Motion:
    length = min(len(motion), round(seconds * FPS))
    first = (len(motion) - length) // 2
    return motion.cut(first, first + length)


def _over(subject: EvaluatedModel, course: Any, gait: Gait, seconds: float) -> tuple[Clip, Terrain]:
    """A character over one obstacle of a course, from a little before it."""
    from training.evaluation.motion.obstacles import run_obstacles

    shown = course.obstacles[SHOWN[course.name]]
    upto = replace(course, obstacles=course.obstacles[: SHOWN[course.name] + 1])
    run = run_obstacles(subject.model, upto, "neutral", subject.style("neutral", 0), gait, 0)
    z = run.root[:, 1]
    near = np.flatnonzero((z > shown.begin - BEFORE_M) & (z < shown.end + BEHIND_M))
    first = int(near[0]) if len(near) else 0
    motion = run.motion.cut(first, min(first + round(seconds * FPS), len(run.motion)))
    return clip_of(motion), run.motion.terrain


def _in_style(
    subject: EvaluatedModel, style: str, path: Motion | None, seconds: float
) -> tuple[Clip, Terrain]:
    """A walk in a style along a captured path, or straight ahead."""
    from runtime.generate import simulate
    from runtime.motion.control_scripts import control_script
    from runtime.motion.controller import Controller
    from training.evaluation.motion.driving import flat_ground, follow

    if path is not None:
        made = follow(subject.model, path, subject.style(style, 0))
        return clip_of(_middle(made, seconds)), path.terrain
    ground = flat_ground()
    frames = round((seconds + 2.0) * FPS)
    script = control_script("forward", "walk")
    poses = simulate(Controller(subject.model, ground), script, [(0.0, subject.style(style, 0))], frames)
    shown = poses[2 * FPS :]
    hips = np.stack([pose.hips_position for pose in shown])
    local = np.stack([pose.local_rotations for pose in shown])
    return Clip("clip", FPS, hips, local, np.stack([pose.contacts for pose in shown])), ground


def _captured_walks(clips: Path, styles: Sequence[str]) -> dict[str, Motion]:
    """A walk ahead of each style, held out where one is: the six seconds in its middle."""
    from training.evaluation.metrics.motion import load_motion, original_clips

    found: dict[str, Motion] = {}
    for path in original_clips(clips):
        if path.stem.startswith(("layer_", "rollout_")):
            continue
        with np.load(path, allow_pickle=False) as file:
            style, forward = str(file["style"]), str(file["content"]) == "walk forward"
            held_out, frames = str(file["split"]) == "held_out", len(file["gait"])
        if style in styles and forward and frames >= 3 * FPS and (held_out or style not in found):
            walk = _middle(load_motion(path), 6.0)
            found[style] = replace(walk, gait=np.full(len(walk), Gait.WALK))
    return found


def _captured_obstacles(clips: Path, course: str, count: int) -> list[Motion]:
    """Captured motion over an obstacle of this kind: held-out clips first, those that go somewhere."""
    from training.evaluation.metrics.motion import load_motion

    if course not in CAPTURED:
        return []
    found = []
    for path in sorted(clips.glob("*.npz")):
        if path.stem.endswith("_m") or path.stem.startswith(("layer_", "rollout_")):
            continue
        with np.load(path, allow_pickle=False) as file:
            if CAPTURED[course] in str(file["content"]) and len(file["gait"]) >= 2 * FPS:
                found.append((str(file["split"]) != "held_out", path))
    motions = (load_motion(path) for _, path in sorted(found))
    moving = [m for m in motions if np.ptp(m.hips[:, [0, 2]], axis=0).max() > STILL_M]
    return moving[:count]
