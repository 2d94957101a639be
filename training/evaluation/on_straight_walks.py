"""Experiments on scripted walks: gait beside raw files, even blends, kept speed, and 8-bit weights."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.assets import PROJECT_ROOT
from runtime.controls import Controls
from runtime.errors import UsageError
from runtime.feet.skating import skating
from runtime.formats.bvh_clip import save_bvh
from runtime.generate import clip_of, simulate
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel, load_model
from runtime.motion.model_files import INT8_GRAPH, read_metadata
from runtime.motion.paths import control_script
from runtime.motion.style_mix import StyleMix
from runtime.prompts.blend import ALL_A, BlendedPrompt
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.library import load_terrain
from training.data import gait
from training.evaluation.experiment import Arguments, Experiment, Setting
from training.evaluation.metrics.feet import sole_skating
from training.evaluation.metrics.motion import GESTURES
from training.evaluation.motion.driving import flat_ground
from training.evaluation.motion.subject import Subject
from training.frames import root_motion
from training.markdown import table as table_lines

Measures = dict[str, float]

# --- gait: straight walks of every captured style beside the raw capture files ----------------------------------------

WALK_SECONDS = 12.0
RAW_FILES = 8  # of a style at most, evenly spread
WALK = "walk forward"
_CMU_FIRST_FRAME = 3


@dataclass(frozen=True)
class WalkMeasure:
    """A measure: its title, the range in which a single style is right, and that of the median."""

    key: str
    title: str
    low: float
    high: float
    difference: bool = False  # ours - raw in degrees; else ours / raw
    median: tuple[float, float] | None = None


ROWS = (
    WalkMeasure("knee_min", "knee at its straightest, degrees", -5.0, 5.0, True),
    WalkMeasure("foot_up", "toes up at heel strike, degrees", -4.0, 4.0, True),
    WalkMeasure("lean", "forward lean, degrees", -3.0, 3.0, True),
    WalkMeasure("speed", "speed at full stick", 0.95, 1.05, median=(0.95, 1.05)),
    WalkMeasure("cadence", "steps a minute", 0.95, 1.05, median=(0.95, 1.05)),
    WalkMeasure("bob_cm", "pelvis bob", 0.75, 1.3, median=(0.9, 1.1)),
    WalkMeasure("pelvis_yaw", "pelvis yaw", 0.75, 1.3, median=(0.9, 1.1)),
    WalkMeasure("pelvis_roll", "pelvis roll", 0.75, 1.3, median=(0.9, 1.1)),
    WalkMeasure("shoulder_yaw", "shoulder yaw", 0.75, 1.3, median=(0.9, 1.1)),
    WalkMeasure("arm_swing_cm", "arm swing", 0.75, 1.3, median=(0.9, 1.1)),
    WalkMeasure("knee_max", "knee at its most bent", 0.75, 1.3),
    WalkMeasure("clearance_cm", "height of the ankle's lift", 0.75, 1.3),
    WalkMeasure("elbow", "elbow, degrees", -10.0, 10.0, True),
    WalkMeasure("hands_vary_cm", "from stride to stride: way of the hands", 0.6, 1.2, median=(0.6, 1.2)),
    WalkMeasure("tops_vary_cm", "top of the hands", 0.6, 1.2, median=(0.6, 1.2)),
    WalkMeasure("steps_vary_cm", "length of the steps", 0.6, 1.2, median=(0.6, 1.2)),
)


def raw_walks(data: Path) -> dict[str, Measures]:
    """Measures of each style's forward walks in the source files, the median over its files."""
    from training.data.catalog import list_clips

    files: dict[str, list[Path]] = {}
    for clip in list_clips(data)[0]:
        if clip.content == WALK and clip.terrain == "flat":
            files.setdefault(clip.style, []).append(clip.path)
    result = {}
    for style, paths in sorted(files.items()):
        chosen = paths[:: max(1, -(-len(paths) // RAW_FILES))]
        first = _CMU_FIRST_FRAME if style.startswith("cmu") else 0
        measured = [m for m in (gait.measure_file(p, first) for p in chosen) if m is not None]
        if measured:
            result[style] = median_of(measured)
    return result


def median_of(measured: Iterable[Measures]) -> Measures:
    """Median of every measure."""
    items = list(measured)
    keys = dict.fromkeys(key for m in items for key in m)
    return {k: float(np.median([m[k] for m in items if k in m])) for k in keys}


def our_walks(subject: Subject, styles: Iterable[str], speed: float = 1.0) -> dict[str, Measures]:
    """The same of a character that walks straight ahead by each style's prompt, from its BVH; `speed` of the stick."""
    result = {}
    with tempfile.TemporaryDirectory() as folder:
        for style in styles:
            controller = Controller(subject.model, flat_ground(), 0)
            script = control_script("forward", "walk", speed, 0)
            poses = simulate(controller, script, [(0.0, subject.style(style, 0))], round(WALK_SECONDS * FPS))
            path = Path(folder) / f"{style}.bvh"
            save_bvh(clip_of(poses, style, (), "flat"), path)
            measured = gait.measure_file(path)
            if measured is not None:
                result[style] = measured
    return result


def gait_figures(setting: Setting) -> dict[str, Any]:
    """Measures of the raw files and of every model, by style."""
    raw = raw_walks(setting.args.data)
    return {"raw": raw, "models": {s.name: our_walks(s, raw, setting.args.speed) for s in setting.subjects}}


def gait_table(figures: dict[str, Any]) -> str:
    """Medians over the styles of ours over raw, and how many styles are within the bar."""
    raw, models = figures["raw"], figures["models"]
    rows = []
    for row in ROWS:
        unit = f"{row.low:+g} to {row.high:+g}" if row.difference else f"{row.low:g} to {row.high:g}"
        rows.append([row.title, unit, *(cell(row, raw, ours) for ours in models.values())])
    head = [f"straight walks of {len(raw)} styles, ours beside the raw files", "bar", *models]
    return "\n".join(table_lines(head, rows)).rstrip("\n")


def cell(row: WalkMeasure, raw: dict[str, Measures], ours: dict[str, Measures]) -> str:
    """Median over the styles, and how many of them are within the bar."""
    values = compared(row, raw, ours)
    if not len(values):
        return "no walk"
    inside = int(((values >= row.low) & (values <= row.high)).sum())
    middle = float(np.median(values))
    shown = f"{middle:+.1f}" if row.difference else f"{middle:.2f}"
    return f"{shown}; {inside} of {len(values)}"


def compared(row: WalkMeasure, raw: dict[str, Measures], ours: dict[str, Measures]) -> Array:
    """Difference or ratio of every style that both have."""
    pairs = [
        (ours[s][row.key], raw[s][row.key]) for s in raw if row.key in ours.get(s, {}) and row.key in raw[s]
    ]
    return np.array([a - b if row.difference else a / b for a, b in pairs])


def _raw_data(args: Arguments) -> None:
    if args.data is None and args.known is None:
        raise UsageError("gait: neither --data nor --known is given.", "Give one of them.")


GAIT = Experiment(
    "Straight walks of every captured style at full stick beside the raw capture files: is the walk alive?",
    gait_figures,
    gait_table,
    "straight walks",
    models=2,
    options=(
        ("--data", {"type": Path, "metavar": "DIR", "help": "folder of the unpacked source files"}),
        ("--speed", {"type": float, "default": 1.0, "help": "share of the full stick (default: 1)"}),
    ),
    check=_raw_data,
)

# --- blend steps: of the change between two styles, how much lies in the largest of six equal steps ------------------

STEPS = 6
PAIRS = 24
LEAD_IN_SECONDS, BLEND_SECONDS = 3.0, 8.0
STICK = 0.7


def walk_summary(model: MotionModel, style: Array | StyleMix) -> Array:
    """Mean and deviation of the joints `(186,)` in metres of a straight walk, seen from the root."""
    controller = Controller(model, flat_ground(), 0)
    controller.set_style(style, 0.0)
    ahead = Controls(move=(0.0, STICK))
    poses = []
    for frame in range(round((LEAD_IN_SECONDS + BLEND_SECONDS) * FPS)):
        controller.step(ahead)
        if frame >= round(LEAD_IN_SECONDS * FPS):
            poses.append(controller.unlocked)
    hips, local = (np.stack(values) for values in zip(*poses, strict=True))
    joints = SPORT_SKELETON.forward_kinematics(hips, local)[0].astype(np.float64)
    xz, yaw = root_motion(joints)
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, z = joints[..., 0] - xz[:, :1], joints[..., 2] - xz[:, 1:]
    seen = np.stack([c * x - s * z, joints[..., 1], s * x + c * z], -1).reshape(len(joints), -1)
    return np.concatenate([seen.mean(0), seen.std(0)])


def largest_step(summaries: Array) -> float:
    """Share of the largest step in all steps, of summaries `(7, n)`; 1/6 is even."""
    steps = np.linalg.norm(np.diff(summaries, axis=0), axis=1)
    return float(steps.max() / max(steps.sum(), 1e-9))


def random_pairs(names: list[str], count: int) -> list[tuple[str, str]]:
    """Pairs of different styles, the same in every run."""
    rng = np.random.default_rng(0)
    pairs = [rng.choice(names, 2, replace=False) for _ in range(count)]
    return [(str(a), str(b)) for a, b in pairs]


def blend_steps(setting: Setting) -> dict[str, float]:
    """Largest step of every pair, blended by seven weights as the slider and `sport generate --blend` do."""
    subject = setting.subject
    names = sorted(name for name in subject.texts if not name.startswith(GESTURES))
    result = {}
    for first, second in random_pairs(names, setting.args.pairs):
        a, b = (subject.texts[name][0] for name in (first, second))
        blend = BlendedPrompt(a, b, ALL_A)
        mixes = [
            subject.prompter(replace(blend, weights=(k / STEPS,) * len(ALL_A))) for k in range(STEPS + 1)
        ]
        result[f"{first} to {second}"] = largest_step(
            np.stack([walk_summary(subject.model, mix) for mix in mixes])
        )
    return result


def blend_table(found: dict[str, float]) -> str:
    """Median and worst pair."""
    values = np.array(list(found.values()))
    worst = max(found, key=lambda pair: found[pair])
    rows = [["median", f"{np.median(values):.2f}"], [f"worst ({worst})", f"{values.max():.2f}"]]
    head = [f"largest of six equal steps, {len(found)} random pairs", "share"]
    return "\n".join(table_lines(head, rows)).rstrip("\n")


BLEND_STEPS = Experiment(
    "Is a blend even? Of the change between two styles, how much lies in the largest of six equal steps of the blend.",
    blend_steps,
    blend_table,
    "blend steps",
    options=(("--pairs", {"type": int, "default": PAIRS}),),
)

# --- speed: how the root keeps to the speed that the stick requests --------------------------------------------------

PROMPTS = (
    "walking in a relaxed, everyday way",
    "a child pretending to be an aeroplane",
    "a karate fighter chopping",
    "an old man with a bad back",
    "a proud, self-important person",
)
STICKS, TERRAINS = (1.0, 0.6), ("flat", "stairs")
SETTLED = 5.0  # seconds after setting off
WINDOW = FPS // 2


@dataclass(frozen=True)
class WalkSpeed:
    """Figures of one walk: seconds until 80 % of the requested speed; over half seconds the highest speed, the lowest

    after SETTLED, the mean error from then on, and the deviation, as shares of the requested speed.
    """

    prompt: str
    terrain: str
    stick: float
    requested: float  # m/s
    set_off: float
    highest: float
    lowest: float
    error: float
    deviation: float


def describe(speeds: Array, requested: float) -> tuple[float, float, float, float, float]:
    """`set_off`, `highest`, `lowest`, `error` and `deviation` of the root's speeds `(T,)`, m/s."""
    share = speeds / requested
    reached = np.flatnonzero(share > 0.8)
    smooth = np.convolve(share, np.full(WINDOW, 1.0 / WINDOW), "valid")
    settled = smooth[round(SETTLED * FPS) :]
    return (
        float(reached[0] / FPS) if len(reached) else float("inf"),
        float(smooth.max()),
        float(settled.min()),
        float(abs(settled.mean() - 1.0)),
        float(settled.std()),
    )


def speeds(setting: Setting) -> list[dict[str, Any]]:
    """Every prompt straight ahead from standing, on every ground, at every stick."""
    subject = setting.subject
    walks = []
    for prompt, terrain, stick in product(PROMPTS, TERRAINS, STICKS):
        controller = Controller(subject.model, load_terrain(terrain), seed=1)
        controller.set_style(subject.prompter(prompt), 0.0)
        track = [controller.pose.root_position]
        for _ in range(round(setting.args.seconds * FPS)):
            track.append(controller.step(Controls(move=(0.0, stick))).root_position)
        steps = np.diff(np.array(track, np.float64)[:, [0, 2]], axis=0)
        requested = controller.requested_speed
        found = describe(np.linalg.norm(steps, axis=1) * FPS, requested)
        walks.append(asdict(WalkSpeed(prompt, terrain, stick, requested, *found)))
    return walks


def speed_table(walks: list[dict[str, Any]]) -> str:
    """A row for each walk, and their means."""
    rows = [
        [w["prompt"], w["terrain"], f"{w['stick']:g}", f"{w['requested']:.2f}", *_speed_cells(w)]
        for w in walks
    ]
    means = {k: float(np.mean([w[k] for w in walks])) for k in walks[0] if isinstance(walks[0][k], float)}
    rows.append(["mean", "", "", "", *_speed_cells(means)])
    head = ["prompt", "ground", "stick", "requested m/s", "sets off in s", "highest", "lowest", "error"]
    return "\n".join(table_lines([*head, "deviation"], rows)).rstrip("\n")


def _speed_cells(walk: dict[str, Any]) -> list[str]:
    shares = [f"{walk[k]:.2f}" for k in ("set_off", "highest", "lowest")]
    return [*shares, *(f"{100 * walk[k]:.1f} %" for k in ("error", "deviation"))]


def _long_enough(args: Arguments) -> None:
    if args.seconds < SETTLED + 1.0:
        raise UsageError(f"--seconds {args.seconds:g}: expected {SETTLED + 1.0:g} or more.", "Walk longer.")


SPEED = Experiment(
    "How the root keeps to the speed that the stick requests: setting off, and walking on.",
    speeds,
    speed_table,
    "speed",
    options=(("--seconds", {"type": float, "default": 14.0, "help": "of each walk (default: 14)"}),),
    check=_long_enough,
)

# --- precision: a minute of play in full precision, with 8-bit weights, and in another seed --------------------------

RUNS = (("fp32", "fp32", 0), ("int8", "int8", 0), ("fp32, other seed", "fp32", 1))  # name, precision, seed
COURSES = (  # prompt, path, gait, terrain: equal shares of the minute
    ("a proud queen", "circle", "walk", "flat"),
    ("an exhausted soldier, left arm hanging", "figure8", "walk", "hills"),
    ("a happy child skipping along", "circle", "jog", "flat"),
)
LEAD_IN = 2 * FPS  # frames before the character moves as requested


def posture(positions: Array, name: str) -> Measures:
    """How a clip `(T, 31, 3)` on terrain `name` moves and stands: speed, posture and skating by their names."""
    joint = {joint: positions[:, SPORT_SKELETON.index(joint)] for joint in SPORT_SKELETON.names}
    hips, trunk = joint["Hips"], joint["Head"] - joint["Hips"]
    terrain = load_terrain(name)
    ground = terrain.height(hips[:, 0], hips[:, 2])
    lean = np.degrees(np.arctan2(np.hypot(trunk[:, 0], trunk[:, 2]), trunk[:, 1]))
    hands = {side: 100.0 * float((joint[f"{side}Hand"] - hips)[:, 1].mean()) for side in ("Left", "Right")}
    steps = np.linalg.norm(np.diff(hips[:, [0, 2]], axis=0), axis=1)
    spread = np.linalg.norm((joint["LeftFoot"] - joint["RightFoot"])[:, [0, 2]], axis=1)
    return {
        "root speed (m/s)": FPS * float(steps.mean()),
        "hips over the ground (cm)": 100.0 * float((hips[:, 1] - ground).mean()),
        "trunk from upright (degrees)": float(lean.mean()),
        "left hand over the hips (cm)": hands["Left"],
        "right hand over the hips (cm)": hands["Right"],
        "feet apart, p90 (cm)": 100.0 * float(np.percentile(spread, 90)),
        "skating at toe joints (cm a frame)": float(skating(positions, terrain).mean()),
        "skating at the sole (cm a frame)": float(sole_skating(positions, terrain).mean()),
    }


def compare(folder: Path, seconds: float) -> dict[str, Measures]:
    """Means over COURSES of `seconds` together by run, and the mean distance of the hips from the first run's."""
    found: dict[str, list[Measures]] = {}
    first: list[Array] = []
    for name, precision, seed in RUNS:
        model = load_model(folder, precision=precision)
        to_style = Prompter(model)
        for number, (prompt, path, kind, terrain) in enumerate(COURSES):
            controller = Controller(model, load_terrain(terrain), seed)
            frames = LEAD_IN + round(seconds * FPS / len(COURSES))
            poses = simulate(controller, control_script(path, kind), [(0.0, to_style(prompt))], frames)
            positions = np.stack([pose.positions for pose in poses[LEAD_IN:]])
            if name == RUNS[0][0]:
                first.append(positions)
            hips = (positions - first[number])[:, SPORT_SKELETON.index("Hips"), ::2]
            away = 100.0 * float(np.linalg.norm(hips, axis=1).mean())
            row = posture(positions, terrain) | {"hips from the first run's (cm)": away}
            found.setdefault(name, []).append(row)
    return {n: {key: float(np.mean([one[key] for one in ms])) for key in ms[0]} for n, ms in found.items()}


def precision(setting: Setting) -> dict[str, Measures]:
    """The three runs of one model; its 8-bit twin is made where it has none."""
    with tempfile.TemporaryDirectory() as folder:
        return compare(with_twin(setting.folders[0], Path(folder)), setting.args.seconds)


def precision_table(runs: dict[str, Measures]) -> str:
    """One column for each run."""
    keys = list(next(iter(runs.values())))
    rows = [[key, *(f"{run[key]:.3f}" for run in runs.values())] for key in keys]
    return "\n".join(table_lines(["measure", *runs], rows)).rstrip("\n")


def with_twin(model: Path, folder: Path) -> Path:
    """`model`, or a copy of it in `folder` with an 8-bit graph."""
    if INT8_GRAPH in read_metadata(model)["sha256"]:
        return model
    copy = folder / "model"
    shutil.copytree(model, copy)
    command = [sys.executable, "-m", "training.export.quantize", str(copy)]
    done = subprocess.run(command, cwd=PROJECT_ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UsageError(f"8-bit twin of {model}: {last[:300]}", "Run pip install -e '.[train]'.")
    return copy


def _sensible_length(args: argparse.Namespace) -> None:
    if not 1.0 <= args.seconds <= 3600.0:
        raise UsageError(f"--seconds {args.seconds}: expected 1 to 3600.", "Try 60.")


PRECISION = Experiment(
    "A minute of play in full precision and with 8-bit weights, from the same seed and controls, and in another seed: two "
    "runs drift apart in the noise of the feet whatever the cause, so a second seed says how far is far.",
    precision,
    precision_table,
    "precision",
    options=(("--seconds", {"type": float, "default": 60.0, "help": "of play in each run (default: 60)"}),),
    check=_sensible_length,
)
