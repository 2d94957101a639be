"""A take as plain arrays: NPZ for programs that compute, CSV for tables."""

from __future__ import annotations

import importlib.util
import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path, write_atomic
from runtime.controls import Gait
from runtime.errors import UsageError
from runtime.formats.prepare import Check, PreparedTake
from runtime.formats.sidecar import markers
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip

CONTACTS = ("left_heel", "left_toe", "right_heel", "right_toe")
SOLES = ("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase")
STANDING_M_PER_S, STANDING_M = 0.25, 0.04  # of a joint that bears: its speed, and its height over its lowest


def take_arrays(take: PreparedTake) -> dict[str, NDArray[Any]]:
    """Named arrays of a prepared take; metres, radians, seconds, quaternions w, x, y, z.

    `positions` `(T, J, 3)`, `rotations` and `local_rotations` `(T, J, 4)`, `root_positions` `(T, 3)`, `root_yaw` `(T,)`,
    `contacts` `(T, 4)`, `phase` `(T, 2)` (radians of each foot's cycle, NaN while it has none), `gaits` `(T,)` (names),
    `seconds` `(T,)`, `fps`, `names` `(J,)`, `parents` `(J,)`, `offsets` `(J, 3)`, `contact_names`, `prompts` and
    `origin` (JSON texts).
    """
    clip = take.clip
    positions, world = clip.world()
    contacts = foot_contacts(clip)
    known = {int(gait): gait.label for gait in Gait}
    gaits = np.full(len(clip), -1) if clip.gaits is None else clip.gaits
    return {
        "positions": (positions * clip.size).astype(np.float32),
        "rotations": world.astype(np.float32),
        "local_rotations": clip.local_rotations,
        "root_positions": (take.root.positions * clip.size).astype(np.float32),
        "root_yaw": take.root.yaw.astype(np.float32),
        "contacts": contacts.astype(np.float32),
        "phase": np.stack([_phase(contacts[:, side : side + 2].max(axis=1)) for side in (0, 2)], axis=1),
        "gaits": np.array([known.get(int(gait), "") for gait in gaits]),
        "seconds": np.arange(len(clip)) / clip.fps,
        "fps": np.array(clip.fps),
        "names": np.array(SPORT_SKELETON.names),
        "parents": np.array(SPORT_SKELETON.parents),
        "offsets": SPORT_SKELETON.offsets * np.float32(clip.size),
        "contact_names": np.array(CONTACTS),
        "prompts": np.array(json.dumps(markers(clip), ensure_ascii=False)),
        "origin": np.array(json.dumps({"ground": Path(clip.terrain).name, **asdict(clip.origin)})),
    }


def foot_contacts(clip: Clip) -> NDArray[np.floating]:
    """Contacts `(T, 4)` of a clip, or those that its motion shows where it has none: a BVH has none."""
    if clip.contacts.any():
        return clip.contacts
    positions, fps = clip.world()[0], clip.fps
    feet = positions[:, [SPORT_SKELETON.index(name) for name in SOLES]].astype(np.float64)
    speed = (
        np.linalg.norm(np.gradient(feet, axis=0), axis=-1) * fps
        if len(feet) > 1
        else np.zeros(feet.shape[:2])
    )
    low = feet[..., 1] - feet[..., 1].min(axis=0) < STANDING_M
    return ((speed < STANDING_M_PER_S) & low).astype(np.float32)


def _phase(contact: NDArray[np.floating]) -> NDArray[np.float32]:
    """The phase `(T,)` of a foot: 0 where it comes down, 2 pi where it does so again; NaN before, after, and at rest."""
    down = contact > 0.5
    begins = np.flatnonzero(down[1:] & ~down[:-1]) + 1
    phase = np.full(len(contact), np.nan, np.float32)
    for first, last in itertools.pairwise(begins):
        phase[first:last] = 2.0 * np.pi * np.arange(last - first) / (last - first)
    return phase


def save_npz(take: PreparedTake, path: Path, options: object, terrain: object, check: Check) -> None:
    """Write the arrays of `take_arrays` as a compressed archive; FileError."""
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **take_arrays(take))  # type: ignore[arg-type]
        check()


def save_csv(take: PreparedTake, path: Path, options: object, terrain: object, check: Check) -> None:
    """Write a row a frame: time, root, contacts, phase, gait, prompt, joint positions and rotations; FileError."""
    columns, words = take_columns(take)
    table = np.column_stack([values for _, values in columns])
    lines = [",".join([name for name, _ in columns] + ["gait", "prompt"])]
    for row, gait, prompt in zip(table.tolist(), *words, strict=True):
        quoted = prompt.replace('"', '""')
        lines.append(",".join("" if v != v else f"{v:.7g}" for v in row) + f',{gait},"{quoted}"')
    check()
    write_atomic(path, "\n".join(lines) + "\n")


def check_parquet(path: Path) -> None:
    """UsageError says how to get Parquet where pandas or pyarrow is not there."""
    missing = [name for name in ("pandas", "pyarrow") if importlib.util.find_spec(name) is None]
    if missing:
        raise UsageError(
            f"{path}: Parquet is written by pandas and pyarrow, and {' and '.join(missing)} is not installed.",
            "Run pip install pandas pyarrow (or '.[tables]'), or write a .csv.",
        )


def save_parquet(take: PreparedTake, path: Path, options: object, terrain: object, check: Check) -> None:
    """Write the columns of `save_csv` as Parquet, numbers as float32; UsageError without pandas, FileError."""
    check_parquet(path)
    import pandas

    columns, (gaits, prompts) = take_columns(take)
    frame = pandas.DataFrame({name: values.astype(np.float32) for name, values in columns})
    frame["gait"], frame["prompt"] = gaits, prompts
    frame.attrs = {"fps": take.clip.fps, "name": take.clip.name}
    with atomic_path(path) as temporary:
        frame.to_parquet(temporary, index=False)
        check()


def take_columns(take: PreparedTake) -> tuple[list[tuple[str, NDArray[Any]]], tuple[list[str], list[str]]]:
    """Named columns of numbers `(T,)`, and the gait and the prompt of each frame."""
    arrays = take_arrays(take)

    def columns(name: str, parts: Sequence[str], values: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
        return [(f"{name}{part}", values[:, k]) for k, part in enumerate(parts)]

    found = [("seconds", arrays["seconds"])]
    found += [*columns("root_", "xyz", arrays["root_positions"]), ("root_yaw", arrays["root_yaw"])]
    found += columns("", CONTACTS, arrays["contacts"]) + columns("phase_", ("left", "right"), arrays["phase"])
    for j, name in enumerate(SPORT_SKELETON.names):
        found += columns(f"{name}_", "xyz", arrays["positions"][:, j])
        found += columns(f"{name}_q", "wxyz", arrays["rotations"][:, j])
    begun = [(m["seconds"], m["name"]) for m in markers(take.clip) if m["kind"] == "prompt"]
    at = arrays["seconds"].tolist()
    prompts = [next((name for when, name in reversed(begun) if when <= s + 1e-6), "") for s in at]
    return found, (arrays["gaits"].tolist(), prompts)
