"""The list of a batch (CSV with a header, or JSON lines), and the task of each row: arguments of `sport generate`."""

import argparse
import csv
import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any, NoReturn
from unicodedata import normalize

from runtime.assets import model_folder
from runtime.errors import FileError, SportError, UsageError
from runtime.safe_read import decode_text, parse_json, read_bounded, reason

MAX_LIST_BYTES = 256 * 1024 * 1024
MAX_HASHED_BYTES = 1 << 29  # of a file named by a row; no reader accepts larger ones
NOT_COLUMNS = ("batch", "workers", "help")
# a row that gives one of these inherits none of the others from the command
STYLES = ("prompt", "prompts", "parts")
_REMEDY = "Write a CSV with a header, or one JSON object a line."
_FILES = ("terrain", "parts", "character", "joint_map")
_SWITCH = {
    **dict.fromkeys(("true", "yes", "on", "1", "x"), True),
    **dict.fromkeys(("false", "no", "off", "0"), False),
}


@dataclass(frozen=True)
class BatchRow:
    """A row of the list: its number from 1 on, its values by argument name, and the error if it is invalid."""

    number: int
    values: dict[str, Any]
    error: str = ""


@dataclass(frozen=True)
class Task:
    """A clip to make: `options` are the arguments of `sport generate`; `key` changes with them and with the files they name."""

    number: int
    values: dict[str, Any]
    options: argparse.Namespace
    key: str


class RowParser(argparse.ArgumentParser):
    """Raises UsageError for an invalid row instead of ending the program."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(message)


def read_rows(path: Path) -> list[BatchRow]:
    """Return the rows of a list; a row that cannot be read has an `error`. FileError or UsageError for the list as a whole."""
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".jsonl"):
        raise UsageError(f" {path}: expected .csv or .jsonl.", _REMEDY, "batch")
    text = decode_text(read_bounded(path, MAX_LIST_BYTES, "Use several lists."))
    if suffix == ".csv":
        rows = _csv_rows(path, text)
    else:
        # unlike `splitlines`, which ends a line also at what may be in a text
        lines = [line for line in io.StringIO(text, newline=None) if line.strip()]
        rows = [_json_row(number, line) for number, line in enumerate(lines, 1)]
    if not rows:
        raise FileError(f"{path}: no rows.", _REMEDY)
    return rows


def _csv_rows(path: Path, text: str) -> list[BatchRow]:
    try:
        reader = csv.DictReader(io.StringIO(text, newline=""), restkey="", strict=True)
        names = [_name(name) for name in reader.fieldnames or []]
        if len(set(names)) != len(names) or "" in names:
            raise FileError(f"{path}: a column without a name, or two with the same one.", _REMEDY)
        reader.fieldnames = names
        return [_csv_row(k, cells) for k, cells in enumerate(reader, 1)]
    except csv.Error as error:
        raise FileError(f"{path}: not CSV ({error}).", _REMEDY) from error


def _csv_row(number: int, cells: dict[str, Any]) -> BatchRow:
    error = "more cells than the header has" if "" in cells else ""
    values = {name: cell.strip() for name, cell in cells.items() if name and cell and cell.strip()}
    return BatchRow(number, values, error)


def _json_row(number: int, line: str) -> BatchRow:
    try:
        value = parse_json(line.encode("utf-8"))
    except ValueError as error:
        return BatchRow(number, {}, f"not JSON ({reason(error)})")
    if not isinstance(value, dict):
        return BatchRow(number, {}, "not a JSON object")
    given = {_name(name): v for name, v in value.items() if v is not None and v != ""}
    wrong = [name for name, v in given.items() if not isinstance(v, str | int | float)]
    return BatchRow(
        number, given, f"{', '.join(wrong)}: expected text, a number, true or false" if wrong else ""
    )


def _name(text: str | None) -> str:
    """Return the argument name of a column: "--ground-out", "Ground out" and "ground_out" are equivalent."""
    return (text or "").strip().lstrip("-").replace("-", "_").replace(" ", "_").lower()


def plan(
    rows: Sequence[BatchRow], parser: RowParser, base: argparse.Namespace
) -> tuple[list[Task], list[BatchRow]]:
    """Return tasks of the valid rows, and the others with their errors; UsageError for an unknown column.

    `parser` has the arguments of `sport generate`, `base` those of the command, which apply to every row.
    """
    known = {a.dest: a for a in parser._actions if a.option_strings and a.dest not in NOT_COLUMNS}
    unknown = sorted({name for row in rows for name in row.values} - set(known))
    if unknown:
        names = ", ".join(sorted(known))
        raise UsageError(f" column {unknown[0][:60]}: no argument.", f"Columns are {names}.", "batch")
    tasks: list[Task] = []
    refused: list[BatchRow] = []
    writers: dict[str, int] = {}
    _fingerprint.cache_clear()
    for row in rows:
        try:
            options = _options(row, parser, known, base)
            _check_targets(options, row.number, writers)
            tasks.append(Task(row.number, row.values, options, _key(options)))
        except SportError as error:
            refused.append(BatchRow(row.number, row.values, str(error)))
    return tasks, refused


def _options(
    row: BatchRow, parser: RowParser, known: dict[str, argparse.Action], base: argparse.Namespace
) -> argparse.Namespace:
    if row.error:
        raise UsageError(row.error)
    kept = {name: value for name, value in vars(base).items() if name not in (*NOT_COLUMNS, "command")}
    options = argparse.Namespace(**kept | {"out": None})
    if any(name in row.values for name in STYLES):
        vars(options).update(dict.fromkeys(STYLES))
    words = []
    for name, value in {"out": f"{row.number:05d}.bvh", **row.values}.items():
        if known[name].nargs != 0:
            words.append(f"{known[name].option_strings[-1]}={value}")
        elif (text := str(value).lower()) in _SWITCH:
            setattr(options, name, _SWITCH[text])
        else:
            raise UsageError(f"{name} {text[:40]}: expected true or false.")
    return parser.parse_args(words, options)


def _check_targets(options: argparse.Namespace, number: int, writers: dict[str, int]) -> None:
    """Raise UsageError unless a row writes below the folder of the batch, and not to the file of an earlier row."""
    for path in filter(None, (options.out, options.ground_out)):
        parts = PurePosixPath(path.as_posix()).parts
        if path.is_absolute() or path.drive or ".." in parts or not path.name or parts[0].startswith("."):
            raise UsageError(f"{path}: expected a name below the folder of --out.", "Leave its folder out.")
        first = writers.setdefault(normalize("NFC", str(path)).casefold(), number)
        if first != number:
            raise UsageError(f"{path}: row {first} writes this file.", "Choose another name.")


def _key(options: argparse.Namespace) -> str:
    """Return a hash of all arguments, and of the files and the model that they name."""
    values = {k: str(v) if isinstance(v, Path) else v for k, v in vars(options).items()}
    model = model_folder(options.model)
    paths = [model / "metadata.json", *(Path(p) for name in _FILES if (p := getattr(options, name)))]
    found = [_fingerprint(path) for path in paths]
    return hashlib.sha256(json.dumps([values, found], sort_keys=True).encode()).hexdigest()


@cache  # per plan: rows name the same files
def _fingerprint(path: Path) -> str:
    """Return the hash of a file; "" for a name of the library, or a file that does not exist."""
    try:
        size = path.stat().st_size if path.is_file() else -1
        if 0 <= size <= MAX_HASHED_BYTES:
            return sha256(path)
    except (OSError, ValueError):
        return ""
    return "" if size < 0 else f"{size} bytes"  # larger than any readable file: its row will fail


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
