"""A take as plain arrays: NPZ for programs that compute, CSV for tables."""

from __future__ import annotations

import importlib.util
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
from runtime.formats.sidecar import CONTACTS, FEET, foot_phases, markers
from runtime.skeleton import SPORT_SKELETON


def take_arrays(take: PreparedTake) -> dict[str, NDArray[Any]]:
    """Named arrays of a prepared take; metres, radians, seconds, quaternions w, x, y, z.

    `positions` `(T, J, 3)`, `rotations` and `local_rotations` `(T, J, 4)`, `root_positions` `(T, 3)`, `root_yaw` `(T,)`,
    `contacts` `(T, 4)`, `phase` `(T, 2)` (radians of each foot's cycle, NaN while it has none), `gaits` `(T,)` (names),
    `seconds` `(T,)`, `fps`, `names` `(J,)`, `parents` `(J,)`, `offsets` `(J, 3)`, `contact_names`, `prompts` and
    `origin` (JSON texts).
    """
    clip = take.clip
    positions, world = clip.world()
    known = {int(gait): gait.label for gait in Gait}
    gaits = np.full(len(clip), -1) if clip.gaits is None else clip.gaits
    return {
        "positions": (positions * clip.size).astype(np.float32),
        "rotations": world.astype(np.float32),
        "local_rotations": clip.local_rotations,
        "root_positions": (take.root.positions * clip.size).astype(np.float32),
        "root_yaw": take.root.yaw.astype(np.float32),
        "contacts": clip.contacts.astype(np.float32),
        "phase": foot_phases(clip),
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
    found += columns("", CONTACTS, arrays["contacts"]) + columns("phase_", FEET, arrays["phase"])
    for j, name in enumerate(SPORT_SKELETON.names):
        found += columns(f"{name}_", "xyz", arrays["positions"][:, j])
        found += columns(f"{name}_q", "wxyz", arrays["rotations"][:, j])
    begun = [(m["seconds"], m["name"]) for m in markers(take.clip) if m["kind"] == "prompt"]
    at = arrays["seconds"].tolist()
    prompts = [next((name for when, name in reversed(begun) if when <= s + 1e-6), "") for s in at]
    return found, (arrays["gaits"].tolist(), prompts)
