"""A take as plain arrays: NPZ for programs that compute, CSV for tables."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path
from runtime.controls import Gait
from runtime.formats.prepare import Check, PreparedTake
from runtime.formats.sidecar import CONTACTS, FEET, foot_phases, markers
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip

# a spreadsheet evaluates cells that begin with these; a ' before makes it text
FORMULAS = ("=", "+", "-", "@", "\t", "\r")
ROWS = 1024  # of a table that are in memory at once
ALL = slice(None)


def take_arrays(take: PreparedTake) -> dict[str, NDArray[Any]]:
    """Return named arrays of a prepared take; metres, radians, seconds, quaternions w, x, y, z.

    `positions` `(T, J, 3)`, `rotations` and `local_rotations` `(T, J, 4)`, `root_positions` `(T, 3)`, `root_yaw` `(T,)`,
    `contacts` `(T, 4)`, `phase` `(T, 2)` (radians of each foot's cycle, NaN while it has none), `gaits` `(T,)` (names),
    `seconds` `(T,)`, `fps`, `names` `(J,)`, `parents` `(J,)`, `offsets` `(J, 3)`, `contact_names`, `prompts` and
    `origin` (JSON texts).
    """
    clip = take.clip
    positions, world = clip.world()
    return {
        "positions": (positions * clip.size).astype(np.float32),
        "rotations": world.astype(np.float32),
        "local_rotations": clip.local_rotations,
        "root_positions": (take.root.positions * clip.size).astype(np.float32),
        "root_yaw": take.root.yaw.astype(np.float32),
        "contacts": clip.contacts.astype(np.float32),
        "phase": foot_phases(clip),
        "gaits": gait_names(clip),
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
    """Write the arrays of `take_arrays` as a compressed NPZ archive. Raises FileError."""
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **take_arrays(take))  # type: ignore[arg-type]
        check()


def save_csv(take: PreparedTake, path: Path, options: object, terrain: object, check: Check) -> None:
    """Write a CSV with one row per frame: time, root, contacts, phase, gait, prompt, joint positions and rotations. Raises FileError."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        for first in range(0, len(take.clip), ROWS):
            check()
            columns, words = take_columns(take, slice(first, first + ROWS))
            if first == 0:
                file.write(",".join([*columns, "gait", "prompt"]) + "\n")
            for row, gait, prompt in zip(np.column_stack([*columns.values()]).tolist(), *words, strict=True):
                plain = f"'{prompt}" if prompt.startswith(FORMULAS) else prompt
                quoted = plain.replace('"', '""')
                file.write(",".join("" if v != v else f"{v:.7g}" for v in row) + f',{gait},"{quoted}"\n')


def save_parquet(take: PreparedTake, path: Path, options: object, terrain: object, check: Check) -> None:
    """Write the columns of `save_csv` as Parquet, numbers as float32. Raises FileError."""
    import pandas

    columns, (gaits, prompts) = take_columns(take)
    frame = pandas.DataFrame({name: values.astype(np.float32) for name, values in columns.items()})
    frame["gait"], frame["prompt"] = gaits, prompts
    frame.attrs = {"fps": take.clip.fps, "name": take.clip.name}
    # Arrow requires UTF-8 names
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        frame.to_parquet(file, index=False)
        check()


def take_columns(
    take: PreparedTake, rows: slice = ALL
) -> tuple[dict[str, NDArray[Any]], tuple[list[str], list[str]]]:
    """Return the numeric columns by name, and the gait and prompt of each frame, for the frames in `rows`."""
    clip = take.clip
    positions, world = SPORT_SKELETON.forward_kinematics(
        clip.hips_positions[rows], clip.local_rotations[rows]
    )
    seconds = np.arange(len(clip))[rows] / clip.fps
    found: dict[str, NDArray[Any]] = {"seconds": seconds}

    def add(name: str, parts: Sequence[str], values: NDArray[Any]) -> None:
        found.update((f"{name}{part}", values[:, k].astype(np.float32)) for k, part in enumerate(parts))

    add("root_", "xyz", take.root.positions[rows] * clip.size)
    found["root_yaw"] = take.root.yaw[rows].astype(np.float32)
    add("", CONTACTS, clip.contacts[rows])
    add("phase_", FEET, foot_phases(clip)[rows])
    for j, name in enumerate(SPORT_SKELETON.names):
        add(f"{name}_", "xyz", positions[:, j] * clip.size)
        add(f"{name}_q", "wxyz", world[:, j])
    begun = [(m["seconds"], m["name"]) for m in markers(clip) if m["kind"] == "prompt"][::-1]
    prompts = [next((name for when, name in begun if when <= s + 1e-6), "") for s in seconds.tolist()]
    return found, (gait_names(clip)[rows].tolist(), prompts)


def gait_names(clip: Clip) -> NDArray[Any]:
    """Return the gait name of each frame `(T,)`, "" if unknown."""
    known = {int(gait): gait.label for gait in Gait}
    gaits = np.full(len(clip), -1) if clip.gaits is None else clip.gaits
    return np.array([known.get(int(gait), "") for gait in gaits])
