"""How fast a prompt acts: text to Z^t in milliseconds, frames until the motion answers, and how smooth the change is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls
from runtime.motion.controller import Controller
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel
from runtime.prompts.prompter import Prompter
from training.evaluation.metrics.variation import transition_jerk
from training.evaluation.motion.driving import flat_ground, transition

DEFAULT_BLEND_SECONDS = 1.0
_WALKED, _AFTER = 2 * FPS, 4 * FPS  # frames before and after a change of prompt
LATENCY_BAR_MS = 50.0


def latency(model: MotionModel, prompts: Sequence[str], text_encoder: Path | None = None) -> dict[str, float]:
    """Milliseconds from a prompt to Z^t by the library: the first, which loads files and networks, and new ones after."""
    times = []
    prompter = Prompter(model, text_encoder=text_encoder)
    for prompt in prompts:
        wall, processor = time.perf_counter(), time.process_time()
        prompter(prompt)
        times.append((1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - processor)))
    first, *warm = times
    return {
        "first_ms": first[0],
        "first_processor_ms": first[1],
        "warm_median_ms": float(np.median([t[0] for t in warm])),
        "warm_median_processor_ms": float(np.median([t[1] for t in warm])),
        "warm_worst_processor_ms": float(max(t[1] for t in warm)),
        "prompts": len(prompts),
    }


def response(model: MotionModel, before: Array, after: Array, blend_seconds: float) -> dict[str, float]:
    """Frames after a change of Z^t `(6, 64)` until the pose differs at all, and until half of the way to the new one.

    The walk with the change is compared with the same walk without it, joint for joint, so that only the change counts.
    """
    changed, unchanged = (_walk(model, before, z, blend_seconds) for z in (after, None))
    apart = np.linalg.norm(changed - unchanged, axis=-1).mean(1)[_WALKED:]
    settled = float(apart[-FPS:].mean())
    return {
        "first_frame": float(np.argmax(apart > 0.0)) if (apart > 0.0).any() else float("nan"),
        "half_seconds": float(np.argmax(apart >= 0.5 * settled)) / FPS,
        "settled_cm": 100.0 * settled,
    }


def _walk(model: MotionModel, before: Array, after: Array | None, blend_seconds: float) -> Array:
    """Joints `(T, 31, 3)` relative to the root of a walk straight ahead."""
    controller = Controller(model, flat_ground())
    controller.set_style(before, 0.0)
    joints = []
    for frame in range(_WALKED + _AFTER):
        if frame == _WALKED and after is not None:
            controller.set_style(after, blend_seconds)
        pose = controller.step(Controls((0.0, 1.0)))
        joints.append(pose.positions - pose.root_position)
    return np.stack(joints).astype(np.float64)


def transitions(model: MotionModel, changes: dict[str, tuple[Array, Array]]) -> dict[str, Any]:
    """Jerk of each named change from one Z^t to another (blended over a second) against that inside the two."""
    rows = {}
    for name, (first, second) in changes.items():
        positions, change = transition(model, first, second, 0)
        found = transition_jerk(positions, change)
        rows[name] = {"ratio": found.ratio, "peak": found.peak, "inside": found.inside}
    return rows


def timing(
    model: MotionModel,
    prompts: Sequence[str],
    changes: dict[str, tuple[Array, Array]],
    text_encoder: Path | None = None,
) -> dict[str, Any]:
    """Latency over `prompts`, and response and smoothness over `changes` of Z^t."""
    waits = {
        f"{seconds:g}": [response(model, a, b, seconds) for a, b in changes.values()]
        for seconds in (DEFAULT_BLEND_SECONDS, 0.0)
    }
    return {
        "latency": latency(model, prompts, text_encoder),
        "response": {
            seconds: {
                "first_frame_worst": float(np.max([r["first_frame"] for r in rows])),
                "half_seconds_median": float(np.median([r["half_seconds"] for r in rows])),
            }
            for seconds, rows in waits.items()
        },
        "transitions": transitions(model, changes),
    }
