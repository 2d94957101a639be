"""Minutes of random play without a window, with checks: `python -m training.evaluation soak --minutes 10`."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls, Gait
from runtime.errors import UsageError
from runtime.feet.skating import SOLE_POINTS, joint_heights, skating
from runtime.generate import FPS
from runtime.motion import features
from runtime.motion.controller import Controller
from runtime.motion.model import load_model
from runtime.pose import Pose
from runtime.prompts.prompter import Prompter
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import make_terrain
from training.evaluation.experiment import Arguments, Experiment, Setting
from training.evaluation.metrics.crossing import FROZEN_SHARE
from training.evaluation.metrics.feet import sole_skating
from training.markdown import number, percent, table

TERRAINS = ("flat", "hills", "rough", "stairs", "platforms")
GAITS = (Gait.WALK, Gait.WALK, Gait.WALK, Gait.JOG, Gait.CROUCH, Gait.JUMP)
PROMPTS = (
    "a person walks normally", "an old man", "a proud queen", "walk like a drunk", "an angry man",
    "a happy child", "sneak carefully, head down", "an exhausted soldier, left arm hanging", "a chicken",
    "an aeroplane, arms spread", "a shy girl", "a zombie",
)  # fmt: skip
SEGMENT_SECONDS = 20.0  # on one terrain
PROGRESS_SEGMENTS = 15  # five minutes
SETTLE_SECONDS = 1.5  # after a change; what follows is a steady stretch
STRETCH_SECONDS = 1.0  # shortest steady stretch
TURN_BACK_M = 10.0

HIPS_RANGE_M = (0.3, 2.0)
MAX_BONE_CHANGE_M = 1e-3
SPEED_TOLERANCE = 0.15
MAX_SKATING_CM = 0.05  # per frame, walking on flat ground
MAX_PENETRATION_CM = 2.0  # 99th percentile, hills and stairs
MAX_GROWTH_MB = (
    60.0  # of memory after the first segment; a tenth of it is what the figures themselves take in an hour
)
FEET = list(SOLE_POINTS)


@dataclass
class SoakSegment:
    """Twenty seconds on one terrain: poses, and per frame the request, its speed and the frames since it changed."""

    terrain: Terrain
    poses: list[Pose] = field(default_factory=list)
    gaits: list[Gait] = field(default_factory=list)
    asked: list[float] = field(default_factory=list)  # m/s
    since_change: list[int] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)


def figures(setting: Setting) -> dict[str, Any]:
    """Play; the figures and the bars that were missed."""
    begin = time.perf_counter()
    args = setting.args
    report = soak(args.minutes * 60.0, args.seed, setting.folders[0], setting.report)
    return {**report, "wall_seconds": time.perf_counter() - begin}


def soak(seconds: float, seed: int, model: Path, report: Callable[[str], None]) -> dict[str, Any]:
    """Simulate `seconds` in segments on terrains in random order; the figures and the bars that were missed."""
    network = load_model(model)
    to_style = Prompter(network)
    styles = [to_style(prompt) for prompt in PROMPTS]
    rng = np.random.default_rng(seed)
    grounds = {name: make_terrain(name, seed) for name in TERRAINS}
    controller = Controller(network, grounds["flat"], seed)
    measured: list[dict[str, Any]] = []
    waiting: list[str] = []
    memory: list[float] = []
    count = max(1, round(seconds / SEGMENT_SECONDS))
    for index in range(count):
        waiting = waiting or [str(name) for name in rng.permutation(TERRAINS)]
        ground = grounds[waiting.pop()]
        controller.set_terrain(ground)
        controller.reset(0.0, 0.0, float(rng.uniform(-np.pi, np.pi)))
        measured.append(measure(play_segment(controller, styles, rng)))
        memory.append(resident_mb())
        if (index + 1) % PROGRESS_SEGMENTS == 0 and index + 1 < count:
            report(f"{(index + 1) * SEGMENT_SECONDS / 60.0:.0f} minutes")
    return summarise(measured, memory)


def play_segment(controller: Controller, styles: list[Array], rng: np.random.Generator) -> SoakSegment:
    """Random play on the controller's terrain."""
    segment = SoakSegment(controller.terrain)
    controls, change_at, style_at, since = Controls(), 0, 0, 0
    for frame in range(round(SEGMENT_SECONDS * FPS)):
        if frame == style_at:
            controller.set_style(styles[rng.integers(len(styles))], float(rng.uniform(0.0, SETTLE_SECONDS)))
            style_at, since = frame + round(float(rng.uniform(4.0, 12.0)) * FPS), frame
        if frame == change_at:
            controls = _random_controls(controller.pose, rng)
            change_at, since = frame + round(float(rng.uniform(1.0, 6.0)) * FPS), frame
        segment.poses.append(controller.step(controls))
        segment.gaits.append(controls.gait)
        segment.asked.append(controller.requested_speed)
        segment.since_change.append(frame - since)
        if controller.message:
            segment.messages.append(controller.message)
    return segment


def _random_controls(pose: Pose, rng: np.random.Generator) -> Controls:
    heading = float(rng.uniform(-np.pi, np.pi))
    x, z = float(pose.root_position[0]), float(pose.root_position[2])
    if np.hypot(x, z) > TURN_BACK_M:
        heading = float(np.arctan2(-x, -z) + rng.uniform(-0.7, 0.7))
    length = float(rng.choice([0.0, 0.6, 1.0, 1.0]))
    facing = float(rng.uniform(-np.pi, np.pi))
    strafes = rng.random() < 0.15
    return Controls(
        move=(length * np.sin(heading), length * np.cos(heading)),
        facing=(np.sin(facing), np.cos(facing)) if strafes else None,
        gait=GAITS[rng.integers(len(GAITS))],
    )


def measure(segment: SoakSegment) -> dict[str, Any]:
    """Figures of one segment."""
    positions = np.stack([pose.positions for pose in segment.poses])
    finite = np.isfinite(positions).all(axis=(1, 2))
    hips = positions[:, 0].astype(np.float64)
    bones = np.linalg.norm(positions[:, 1:] - positions[:, list(SPORT_SKELETON.parents[1:])], axis=-1)
    change = np.abs(bones - np.linalg.norm(SPORT_SKELETON.offsets[1:], axis=-1))
    gaits = np.array(segment.gaits)[1:, None]
    walking = np.broadcast_to(gaits == Gait.WALK, (len(gaits), 2))
    return {
        "terrain": segment.terrain.name,
        "frames": len(positions),
        "not_finite": int(np.sum(~finite)),
        "messages": segment.messages,
        "hips": hips[:, 1] - segment.terrain.height(hips[:, 0], hips[:, 2]),
        "bone_change": float(change.max()),
        "speeds": _steady_speeds(segment),
        "foot_movement": foot_movement(segment),
        "skating": skating(positions, segment.terrain)[walking],
        "sole_skating": sole_skating(positions, segment.terrain)[walking],
        "toes": joint_heights(positions, segment.terrain).ravel(),
    }


def _steady_stretches(segment: SoakSegment) -> list[tuple[int, int]]:
    """First and last frame (excluded) of every stretch of moving on which neither request nor style changed for a while."""
    steady = np.array(segment.since_change) >= round(SETTLE_SECONDS * FPS)
    moving = (np.array(segment.asked) > 0.3) & (np.array(segment.gaits) != Gait.JUMP)
    good = np.concatenate([[False], steady & moving, [False]]).astype(int)
    starts, ends = np.flatnonzero(np.diff(good) == 1), np.flatnonzero(np.diff(good) == -1)
    long_enough = ends - starts >= round(STRETCH_SECONDS * FPS)
    return [(int(a), int(b)) for a, b in zip(starts[long_enough], ends[long_enough], strict=True)]


def foot_movement(segment: SoakSegment) -> list[tuple[str, float]]:
    """Gait, and speed of the feet relative to the root over the requested speed, of every whole second of steady moving."""
    root = np.stack([pose.root_position for pose in segment.poses])
    yaw = np.array([pose.root_yaw for pose in segment.poses])
    feet = np.stack([pose.positions for pose in segment.poses])[:, FEET] - root[:, None]
    speed = np.linalg.norm(np.diff(features.to_root(feet, yaw[:, None]), axis=0), axis=-1).mean(1) * FPS
    shares: list[tuple[str, float]] = []
    for first, last in _steady_stretches(segment):
        for begin in range(first, last - FPS, FPS):
            asked = float(np.mean(segment.asked[begin : begin + FPS]))
            share = float(speed[begin : begin + FPS].mean()) / asked
            shares.append((segment.gaits[begin].name.lower(), share))
    return shares


def resident_mb() -> float:
    """Memory of this process in MB; NaN where the system does not tell (not Linux)."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return float("nan")
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _steady_speeds(segment: SoakSegment) -> list[tuple[str, float, float]]:
    """(gait, asked, real) in m/s of every steady stretch."""
    root = np.stack([pose.root_position for pose in segment.poses])[:, [0, 2]]
    result: list[tuple[str, float, float]] = []
    for first, last in _steady_stretches(segment):
        travelled = float(np.linalg.norm(np.diff(root[first:last], axis=0), axis=-1).sum())
        real = travelled * FPS / (last - first - 1)
        result.append((segment.gaits[first].name.lower(), float(np.mean(segment.asked[first:last])), real))
    return result


def summarise(measured: list[dict[str, Any]], memory: list[float]) -> dict[str, Any]:
    """All segments together, per terrain and per gait, and the bars that were missed.

    `memory` is that of the process after every segment, MB.
    """
    hips = np.concatenate([m["hips"] for m in measured])
    report: dict[str, Any] = {
        "frames": sum(m["frames"] for m in measured),
        "not_finite": sum(m["not_finite"] for m in measured),
        "messages": [text for m in measured for text in m["messages"]],
        "hips_m": [float(hips.min()), float(hips.max())],
        "bone_change_m": max(m["bone_change"] for m in measured),
        **_frozen([item for m in measured for item in m["foot_movement"]]),
        "memory_growth_mb": memory[-1] - memory[0] if np.isfinite(memory).all() else None,
        "terrains": {
            name: _feet([m for m in measured if m["terrain"] == name])
            for name in TERRAINS
            if any(m["terrain"] == name for m in measured)
        },
        **_speeds([s for m in measured for s in m["speeds"]]),
    }
    report["missed"] = _missed(report)
    return report


def _frozen(seconds: list[tuple[str, float]]) -> dict[str, Any]:
    """Of whole seconds of steady moving (gait, movement of the feet): how many are frozen."""
    movement = [share for _, share in seconds]
    frozen = Counter(gait for gait, share in seconds if share < FROZEN_SHARE)
    return {
        "moving_seconds": len(movement),
        "frozen_seconds": frozen.total(),
        "frozen_gaits": dict(frozen),
        "least_foot_movement": float(min(movement)) if movement else None,
    }


def _speeds(stretches: list[tuple[str, float, float]]) -> dict[str, Any]:
    """Of steady stretches (gait, requested m/s, real m/s): means by gait, and the error over all."""
    gaits = {}
    for gait in sorted({s[0] for s in stretches}):
        requested, real = np.array([s[1:] for s in stretches if s[0] == gait]).T
        gaits[gait] = {
            "stretches": len(requested),
            "asked": float(requested.mean()),
            "real": float(real.mean()),
            "worst_ratio": float(max(real / requested, key=lambda r: abs(r - 1.0))),
        }
    if not stretches:
        return {"gaits": gaits}
    requested, real = np.array([s[1:] for s in stretches]).T
    return {
        "gaits": gaits,
        "speed_ratio": float(real.sum() / requested.sum()),
        "speed_error": float(np.mean(np.abs(real - requested) / requested)),
    }


def _feet(measured: list[dict[str, Any]]) -> dict[str, float]:
    toes = np.concatenate([m["toes"] for m in measured])
    return {
        "skating_cm": float(np.concatenate([m["skating"] for m in measured]).mean()),
        "sole_skating_cm": float(np.concatenate([m["sole_skating"] for m in measured]).mean()),
        "penetration_p99_cm": float(max(0.0, -np.percentile(toes, 1)) * 100.0),
        "penetration_max_cm": float(max(0.0, -toes.min()) * 100.0),
    }


def _missed(report: dict[str, Any]) -> list[str]:
    terrains = report["terrains"]
    low, high = report["hips_m"]
    bars = {
        "poses that are not finite": report["not_finite"] == 0 and not report["messages"],
        "hips height over ground": HIPS_RANGE_M[0] <= low and high <= HIPS_RANGE_M[1],
        "frozen poses": report["frozen_seconds"] == 0,
        "memory growth": (report["memory_growth_mb"] or 0.0) <= MAX_GROWTH_MB,
        "bone lengths": report["bone_change_m"] <= MAX_BONE_CHANGE_M,
        "speed on steady stretches": report.get("speed_error", 0.0) <= SPEED_TOLERANCE,
        "skating on flat ground": terrains.get("flat", {"skating_cm": 0.0})["skating_cm"] <= MAX_SKATING_CM,
    }
    for name in ("hills", "stairs"):
        if name in terrains:
            bars[f"toe penetration on {name}"] = terrains[name]["penetration_p99_cm"] <= MAX_PENETRATION_CM
    return [name for name, met in bars.items() if not met]


def markdown(report: dict[str, Any]) -> str:
    """The figures as tables."""
    growth, least = report["memory_growth_mb"], report["least_foot_movement"]
    rows = [
        ["minutes, frames", f"{report['frames'] / FPS / 60.0:.1f}, {report['frames']}"],
        ["frames with values that are not finite", str(report["not_finite"])],
        ["messages", f"{len(report['messages'])} {'; '.join(report['messages'][:2])}".strip()],
        ["hips over the ground", f"{report['hips_m'][0]:.2f} to {report['hips_m'][1]:.2f} m"],
        [
            f"moving seconds that count as frozen (under {FROZEN_SHARE} of the requested speed)",
            f"{report['frozen_seconds']} of {report['moving_seconds']}",
        ],
        ["least movement of the feet, of the requested speed", number(least, 2)],
        ["growth of memory", f"{number(growth, 0)} MB"],
        ["largest change of a bone's length", f"{report['bone_change_m'] * 1000:.4f} mm"],
        ["real over requested speed", number(report.get("speed_ratio"), 3)],
        ["mean speed error of steady stretches", percent(report.get("speed_error"))],
        ["missed", ", ".join(report["missed"]) or "nothing"],
    ]
    terrains = [
        [
            name,
            f"{t['skating_cm']:.4f}",
            f"{t['sole_skating_cm']:.4f}",
            f"{t['penetration_p99_cm']:.2f}",
            f"{t['penetration_max_cm']:.2f}",
        ]
        for name, t in report["terrains"].items()
    ]
    gaits = [
        [n, f"{g['stretches']}", *(f"{g[k]:.2f}" for k in ("asked", "real", "worst_ratio"))]
        for n, g in report["gaits"].items()
    ]
    lines = table(["measure", "value"], rows)
    head = ["walking; cm a frame, cm", "skating", "at the sole", "toes sunk p99", "at most"]
    lines += table(head, terrains)
    lines += table(["m/s", "stretches", "requested", "real", "worst ratio"], gaits)
    return "\n".join(lines)


def _minutes(args: Arguments) -> None:
    if not 0.1 <= args.minutes <= 1440.0:
        raise UsageError(f"--minutes {args.minutes}: expected 0.1 to 1440.", "Try 10.")


SOAK = Experiment(
    "Minutes of random play without a window, with checks: sticks, gaits, prompts and terrains at random; the exit code is 1 "
    "when a bar is missed. An hour takes about a quarter of one.",
    figures,
    markdown,
    "soak",
    options=(
        ("--minutes", {"type": float, "default": 10.0, "help": "of simulated time (default: 10)"}),
        ("--seed", {"type": int, "default": 0}),
    ),
    check=_minutes,
    missed=lambda report: bool(report["missed"]),
)
