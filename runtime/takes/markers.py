"""Prompts and gaits of a take as named markers on its time line, and what else a file tells of its origin."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from runtime.takes.clip import Clip
from runtime.takes.metadata import gait_changes, title
from runtime.takes.prepare import PreparedTake

MARKERS_VERSION = 1


def markers(clip: Clip) -> list[dict[str, Any]]:
    """Markers `{"kind": "prompt" | "gait", "name", "seconds", "frame"}` in the order of time.

    Gaits are there where the clip knows them frame by frame.
    """
    found = [_marker("prompt", title(event), max(event.seconds, 0.0), clip.fps) for event in clip.prompts]
    found += [
        _marker("gait", name, seconds, clip.fps) for seconds, name in gait_changes(clip.gaits, clip.fps)
    ]
    return sorted(found, key=lambda marker: float(marker["seconds"]))


def _marker(kind: str, name: str, seconds: float, fps: float) -> dict[str, Any]:
    return {"kind": kind, "name": name, "seconds": round(seconds, 4), "frame": round(seconds * fps)}


def take_extras(take: PreparedTake) -> dict[str, Any]:
    """What a GLB keeps in `extras` under "sport": markers, ground, origin, loop, and the rest frame."""
    clip = take.clip
    value: dict[str, Any] = {
        "format": "sport-take",
        "version": MARKERS_VERSION,
        "name": clip.name,
        "fps": clip.fps,
        "frames": len(clip),
        "ground": Path(clip.terrain).name,
        "rest_frame": take.rest_frame,
        "markers": markers(clip),
        "origin": {name: v for name, v in asdict(clip.origin).items() if v not in ("", None)},
    }
    if take.loop is not None:
        value["loop"] = {name: round(v, 4) for name, v in asdict(take.loop).items()}
    return value
