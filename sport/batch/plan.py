"""From rows to tasks: the arguments of each clip as `sport generate` takes them, its files, and what tells it apart."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NoReturn

from runtime.assets import model_folder
from runtime.errors import UsageError
from sport.batch.rows import BatchRow

NOT_COLUMNS = ("batch", "ray", "workers", "help")
STYLES = (
    "prompt",
    "prompts",
    "parts",
)  # a row that gives one of them has none of the others from the command
MAX_HASHED_BYTES = 1 << 29  # of a file that a row names; no reader takes a larger one
_FILES = ("terrain", "parts", "character", "joint_map")
_TRUE, _FALSE = ("true", "yes", "on", "1", "x"), ("false", "no", "off", "0")


@dataclass(frozen=True)
class Task:
    """One clip to make: `options` are the arguments of `sport generate`; `key` changes with them and what they name."""

    number: int
    values: dict[str, Any]
    options: argparse.Namespace
    key: str


@dataclass(frozen=True)
class Refused:
    """A row that no clip can be made of, and why."""

    number: int
    values: dict[str, Any]
    error: str


class RowParser(argparse.ArgumentParser):
    """Raises UsageError for what is wrong with a row in place of ending the program."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def plan(
    rows: Sequence[BatchRow], parser: RowParser, base: argparse.Namespace
) -> tuple[list[Task], list[Refused]]:
    """Tasks of the rows that can be made, and the others; UsageError for a column that is no argument.

    `parser` knows the arguments of `sport generate`, `base` has those that stand for every row.
    """
    known = {a.dest: a for a in parser._actions if a.option_strings and a.dest not in NOT_COLUMNS}
    unknown = sorted({name for row in rows for name in row.values} - set(known))
    if unknown:
        names = ", ".join(sorted(known))
        raise UsageError(f" column {unknown[0][:60]}: no argument.", f"Columns are {names}.", "batch")
    tasks: list[Task] = []
    refused: list[Refused] = []
    writers: dict[str, int] = {}
    prints: dict[Path, str] = {}
    for row in rows:
        try:
            if row.error:
                raise UsageError(row.error)
            options = _options(row, parser, known, base)
            for path in _targets(options):
                first = writers.setdefault(str(path).lower(), row.number)
                if first != row.number:
                    raise UsageError(f"{path}: row {first} writes this file.", "Choose another name.")
            tasks.append(Task(row.number, row.values, options, _key(options, prints)))
        except UsageError as error:
            refused.append(Refused(row.number, row.values, str(error)))
    return tasks, refused


def _options(
    row: BatchRow, parser: RowParser, known: dict[str, argparse.Action], base: argparse.Namespace
) -> argparse.Namespace:
    """The arguments of a row over those of the command."""
    options = argparse.Namespace(**vars(base))
    options.out = None
    if any(name in row.values for name in STYLES):
        for name in STYLES:
            setattr(options, name, None)
    words = []
    for name, value in {"out": f"{row.number:05d}.bvh", **row.values}.items():
        action = known[name]
        if action.nargs == 0:
            on = _switch(name, value)
            setattr(options, name, on)
        else:
            words.append(f"{action.option_strings[-1]}={value}")
    return parser.parse_args(words, options)


def _switch(name: str, value: Any) -> bool:
    text = str(value).lower()
    if text not in _TRUE + _FALSE:
        raise UsageError(f"{name} {text[:40]}: expected true or false.")
    return text in _TRUE


def _targets(options: argparse.Namespace) -> list[Path]:
    """What a row writes, below the folder of the batch. UsageError."""
    names = [options.out, *([options.ground_out] if options.ground_out is not None else [])]
    for path in names:
        parts = PurePosixPath(path.as_posix()).parts
        if path.is_absolute() or path.drive or ".." in parts or not path.name or parts[0].startswith("."):
            raise UsageError(f"{path}: expected a name below the folder of --out.", "Leave its folder out.")
    return names


def _key(options: argparse.Namespace, prints: dict[Path, str]) -> str:
    """Changes with every argument, and with the content of the files and the model that they name."""
    values = {k: str(v) if isinstance(v, Path) else v for k, v in vars(options).items()}
    model = model_folder(options.model)
    paths = [model / "metadata.json", *(Path(p) for name in _FILES if (p := getattr(options, name)))]
    found = [_print(path, prints) for path in paths]
    return hashlib.sha256(json.dumps([values, found], sort_keys=True).encode()).hexdigest()


def _print(path: Path, prints: dict[Path, str]) -> str:
    if path not in prints:
        prints[path] = ""
        with contextlib.suppress(
            OSError, ValueError
        ):  # a name of the library, or a file that the row will miss
            if path.is_file():
                size = path.stat().st_size  # what is larger than any file that is read is refused by its row
                prints[path] = f"{size} bytes"
                if size <= MAX_HASHED_BYTES:
                    with path.open("rb") as file:
                        prints[path] = hashlib.file_digest(file, "sha256").hexdigest()
    return prints[path]
