"""Experiments in which every style is led along its own captured paths: distances, told from capture, amplitudes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.assets import model_folder
from runtime.controls import Gait
from runtime.errors import FileError
from runtime.formats.bvh_clip import save_bvh
from runtime.motion.features import FPS
from runtime.motion.motion_encoder import ExportedMotionEncoder
from runtime.takes.clip import Clip
from training.evaluation.experiment import Experiment, Setting
from training.evaluation.metrics.classifiers import area_under_curve, halves_auc
from training.evaluation.metrics.feature_groups import GROUPS, group_features
from training.evaluation.metrics.features import has_encoder, kinematic_features, temporal_features
from training.evaluation.metrics.motion import (
    GESTURES,
    Motion,
    load_motion,
    original_clips,
    window_index,
    window_starts,
)
from training.evaluation.motion.capture import Options, driving_segments, make_plan, read_capture
from training.evaluation.motion.driving import follow
from training.evaluation.motion.scores import score_following
from training.evaluation.motion.subject import Subject
from training.frames import root_motion, smooth
from training.markdown import table as table_lines

SEED_IN_NAME = re.compile(r" seed\d+")  # of a model, `Subject.name`
SEED: tuple[str, dict[str, Any]] = ("--seed", {"type": int, "default": 0})


def seconds(default: float) -> tuple[str, dict[str, Any]]:
    """The option for how much is walked."""
    return (
        "--seconds",
        {"type": float, "default": default, "help": f"of each style's paths (default: {default:g})"},
    )


# --- distances: is the diffusion worth its steps, what does each part of the model bring ----------------------------


def distances(setting: Setting) -> dict[str, Any]:
    """Frechet distances and recognition of several models, a tenth of the whole evaluation.

    One encoder serves all: that of --features, or the first model's that has one.
    """
    args = setting.args
    options = replace(Options(), follow_seconds=args.seconds, recognise_seconds=8.0, seed=args.seed)
    folder = args.features or next((f for f in setting.folders if has_encoder(f)), None)
    plan = make_plan(
        setting.clips,
        args.styles,
        options,
        None if folder is None else ExportedMotionEncoder(folder),
        setting.report,
    )
    subjects = [Subject(folder, plan.texts) for folder in setting.folders]
    return {f"{s.name} ({s.decoder})": score_following(plan, s, setting.report) for s in subjects}


def distances_table(results: dict[str, dict[str, Any]]) -> str:
    """Overall distance, its ratio to two halves of the capture (whole takes, cut takes), and recognition.

    Seeds of one model share a row: means, and deviations of the distance.
    """
    sets = sorted({name for r in results.values() for name in r["fmd"]})
    groups: dict[str, dict[str, dict[str, Any]]] = {}
    for label, result in results.items():
        groups.setdefault(SEED_IN_NAME.sub("", label), {})[label] = result
    rows = []
    for name_of_all, by_label in groups.items():
        seeds = list(by_label.values())
        cells = [*by_label] if len(seeds) == 1 else [f"{name_of_all}, {len(seeds)} seeds"]
        for name in sets:
            found = [r["fmd"][name] for r in seeds]
            takes = [f["takes"]["distance"] for f in found]
            spread = f" ± {np.std(takes, ddof=1):.2f}" if len(takes) > 1 else ""
            ratios = np.mean([[f["takes"]["ratio"], f["ratio"]] for f in found], axis=0)
            cells.append(f"{np.mean(takes):.2f}{spread} ({ratios[0]:.1f} x, {ratios[1]:.1f} x)")
        scores = [v for r in seeds for v in r["recognition"]["score"].values()]
        rows.append([*cells, f"{100 * sum(scores) / max(1, len(scores)):.0f} %"])
    head = ["model", *(f"FMD, {n} (halves)" for n in sets), "styles recognised, mean"]
    return "\n".join(table_lines(head, rows)).rstrip("\n")


DISTANCES = Experiment(
    "Models beside each other: distance to capture and style recognition along captured paths.",
    distances,
    distances_table,
    "distances",
    clips=True,
    models=2,
    options=(
        seconds(12.0),
        SEED,
        ("--styles", {"nargs": "+", "metavar": "STYLE", "help": "default: every style of the clips"}),
        (
            "--features",
            {"type": model_folder, "metavar": "DIR", "help": "model whose motion encoder serves all"},
        ),
    ),
)

# --- told from capture: whole windows, and part by part --------------------------------------------------------------

HOP = 20  # frames between two windows
SAMPLES = 10  # of a window's 40, of its joint trajectories
WHOLE = ("kinematic", "trajectories")
FEATURES = (*WHOLE, *GROUPS)


@dataclass(frozen=True)
class WindowFeatures:
    """Features of windows `(N, n)` by their names, and the take `(N,)` that each lies in."""

    features: dict[str, Array]
    takes: NDArray[np.int64]


def windows_of(motions: Iterable[Motion]) -> WindowFeatures:
    """Windows of all motions; each motion is a take.

    *kinematic* are 322 numbers (ranges, angles, speeds, frequencies), *trajectories* the joints' places seen from the root.
    """
    rows: dict[str, list[Array]] = {name: [] for name in FEATURES}
    takes = []
    for number, motion in enumerate(motions):
        root = motion.root_features()
        starts = window_starts(len(motion), HOP)
        index = window_index(starts)
        rows["kinematic"].append(
            np.hstack([kinematic_features(root, starts), temporal_features(root, starts)])
        )
        joints = root.joints[index[:, :: index.shape[1] // SAMPLES]]
        rows["trajectories"].append(joints.reshape(len(starts), -1))
        for name, features in group_features(root, starts).items():
            rows[name].append(features)
        takes.append(np.full(len(starts), number))
    return WindowFeatures({n: np.concatenate(r) for n, r in rows.items()}, np.concatenate(takes))


def captured(clips: Path, length: float, styles: Iterable[str] | None = None) -> list[Motion]:
    """Segments of every walked style, held-out clips first."""
    capture = read_capture(clips, styles)
    groups = [g for g in capture.groups if not g.startswith(GESTURES)]
    return [s.load() for g in groups for s in driving_segments(capture, g, length)]


def two_sample_auc(ours: WindowFeatures, theirs: WindowFeatures) -> dict[str, float]:
    """AUC of each kind of features; a path and its clip lie in the same fold."""
    labels = np.repeat([1, 0], [len(ours.takes), len(theirs.takes)])
    takes = np.concatenate([ours.takes, theirs.takes])
    return {
        n: area_under_curve(
            np.concatenate([ours.features[n], theirs.features[n]]), labels, takes, forest=n in GROUPS
        )
        for n in FEATURES
    }


def two_sample(setting: Setting) -> dict[str, Any]:
    """Every model, and one half of the captured takes from the other."""
    segments = captured(setting.clips, setting.args.seconds, setting.args.styles)
    theirs = windows_of(segments)
    rows = {}
    for subject in setting.subjects:
        setting.report(f"{subject.name}: {len(segments)} paths")
        made = [follow(subject.model, m, subject.style(m.style, 0), k) for k, m in enumerate(segments)]
        rows[subject.name] = two_sample_auc(windows_of(made), theirs)
    rows["capture, half of the takes from the other"] = {
        n: halves_auc(theirs.features[n], theirs.takes, forest=n in GROUPS) for n in FEATURES
    }
    return {"windows": len(theirs.takes), "rows": rows}


def two_sample_table(found: dict[str, Any]) -> str:
    """Area under the curve of each kind of features."""
    rows = [[n, *(f"{row[f]:.2f}" for f in FEATURES)] for n, row in found["rows"].items()]
    lines = table_lines([f"area under the curve, {found['windows']} windows", *FEATURES], rows)
    return "\n".join(lines).rstrip("\n")


TWO_SAMPLE = Experiment(
    "Is our motion told from capture? Trees see windows of captured clips and of the character on the same paths, "
    "whole and part of the body by part, and are tested on takes that they have not seen.",
    two_sample,
    two_sample_table,
    "told from capture",
    clips=True,
    models=2,
    options=(
        seconds(24.0),
        ("--styles", {"nargs": "+", "metavar": "STYLE", "help": "default: every style of the clips"}),
    ),
)

# --- the same path: does the character swing as far as the clip, and are its hands as calm ---------------------------

CLIPS = 16
MAX_FRAMES = 6 * FPS
FAST_HZ = 4.0
_HANDS, _FEET, _HEAD = (20, 27), (4, 9), (16,)
_HIPS, _SHOULDERS = (2, 7), (18, 25)


def walks(clips: Path, count: int) -> list[Motion]:
    """One walk of each style, evenly spread over the styles: held-out ones where there are, at most six seconds."""
    found: dict[str, Motion] = {}
    for path in original_clips(clips):
        if path.stem.startswith(("layer_", "rollout_")):
            continue
        with np.load(path, allow_pickle=False) as file:
            style, forward = str(file["style"]), str(file["content"]) == "walk forward"
            held_out, frames = str(file["split"]) == "held_out", len(file["gait"])
        if not forward or frames < 3 * FPS or (style in found and not held_out):
            continue
        motion = load_motion(path)
        middle = max(0, (len(motion) - MAX_FRAMES) // 2)
        found[style] = motion.cut(middle, middle + MAX_FRAMES)
    styles = sorted(found)
    chosen = [styles[i] for i in np.unique(np.linspace(0, len(styles) - 1, count).round().astype(int))]
    return [replace(found[s], gait=np.full(len(found[s]), Gait.WALK)) for s in chosen]


def amplitudes(positions: Array) -> dict[str, float]:
    """Deviations of what swings, of joints `(T, 31, 3)`, and the energy of the hands over 4 Hz."""
    p = positions.astype(np.float64)
    xz, yaw = root_motion(p)
    c, s = np.cos(-yaw)[:, None], np.sin(-yaw)[:, None]
    local = p - np.stack([xz[:, 0], np.zeros(len(xz)), xz[:, 1]], -1)[:, None]
    local = np.stack(
        [local[..., 0] * c + local[..., 2] * s, local[..., 1], local[..., 2] * c - local[..., 0] * s], -1
    )

    def spread(joints: tuple[int, ...]) -> float:
        q = local[:, list(joints)]
        return float(np.sqrt(((q - smooth(q, FPS / 2)) ** 2).sum(-1).mean()))

    def angle(pair: tuple[int, int], of: Callable[[Array], Array]) -> float:
        values = of(local[:, pair[0]] - local[:, pair[1]])
        return float(np.std(values - smooth(values[:, None], FPS / 2)[:, 0]))

    def level(v: Array) -> Array:
        return np.arctan2(v[:, 2], v[:, 0])

    def tilt(v: Array) -> Array:
        return np.arcsin(v[:, 1] / np.linalg.norm(v, axis=-1))

    speed = np.gradient(local[:, list(_HANDS)], axis=0) * FPS
    spectrum = np.abs(np.fft.rfft((speed - speed.mean(0)) * np.hanning(len(p))[:, None, None], axis=0)) ** 2
    fast = np.fft.rfftfreq(len(p), 1 / FPS) > FAST_HZ
    return {
        "hands": spread(_HANDS),
        "feet": spread(_FEET),
        "head": spread(_HEAD),
        "pelvis bob": float(np.std(p[:, 0, 1] - smooth(p[:, 0, 1:2], FPS / 2)[:, 0])),
        "pelvis yaw": angle(_HIPS, level),
        "pelvis roll": angle(_HIPS, tilt),
        "shoulder yaw": angle(_SHOULDERS, level),
        "hands over 4 Hz": float(spectrum[fast].sum()),
    }


def same_path(setting: Setting) -> dict[str, Any]:
    """Median over the walks of ours over the clip's, for every amplitude; with --bvh both walks as files."""
    motions = walks(setting.clips, setting.args.count)
    if setting.args.styles:
        motions = _of_styles(setting)
    found = {}
    alone = len(setting.subjects) == 1
    for subject in setting.subjects:
        ratios: dict[str, list[float]] = {}
        for clip in motions:
            made = follow(subject.model, clip, subject.style(clip.style, 0))
            assert made.unlocked is not None
            ours, theirs = amplitudes(made.unlocked), amplitudes(clip.positions)
            for key, value in ours.items():
                ratios.setdefault(key, []).append(value / max(theirs[key], 1e-9))
            if setting.args.bvh is not None:
                _save_pair(setting.args.bvh, clip, made, "ours" if alone else subject.name)
        found[subject.name] = {key: float(np.median(values)) for key, values in ratios.items()}
    return {"walks": len(motions), "rows": found}


def _of_styles(setting: Setting) -> list[Motion]:
    found = {motion.style: motion for motion in walks(setting.clips, 10_000)}
    missing = sorted(set(setting.args.styles) - set(found))
    if missing:
        raise FileError(
            f"{setting.clips}: no walk of {', '.join(missing)}.", f"There are {', '.join(sorted(found))}."
        )
    return [found[style] for style in setting.args.styles]


def _save_pair(folder: Path, captured: Motion, made: Motion, name: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for motion, who in ((captured, "captured"), (made, name)):
        clip = Clip(motion.name, FPS, motion.hips, motion.local, motion.contacts)
        save_bvh(clip, folder / f"{motion.style}_{who}.bvh")


def same_path_table(found: dict[str, Any]) -> str:
    """A row for each model."""
    keys = list(next(iter(found["rows"].values())))
    rows = [[n, *(f"{r[k]:.2f}" for k in keys)] for n, r in found["rows"].items()]
    head = [f"ours over the clip's, median of {found['walks']} walks", *keys]
    return "\n".join(table_lines(head, rows)).rstrip("\n")


SAME_PATH = Experiment(
    "The same path at the same speed: does the character swing as far as the clip, and are its hands as calm? Before "
    "foot lock; amplitudes are deviations over the clip's.",
    same_path,
    same_path_table,
    "same path",
    clips=True,
    models=2,
    options=(
        ("--count", {"type": int, "default": CLIPS, "help": f"styles, evenly spread (default: {CLIPS})"}),
        ("--styles", {"nargs": "+", "metavar": "STYLE", "help": "these alone"}),
        ("--bvh", {"type": Path, "metavar": "DIR", "help": "write each walk, captured and made, as BVH"}),
    ),
)
