"""The list of a batch: one clip a row, from CSV with a header or from JSON lines."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.errors import FileError, UsageError
from runtime.safe_read import decode_text, parse_json, read_bounded, reason

MAX_LIST_BYTES = 256 * 1024 * 1024
SUFFIXES = (".csv", ".jsonl")
_REMEDY = "Write a CSV with a header, or one JSON object a line."


@dataclass(frozen=True)
class BatchRow:
    """One clip: its number from 1 on, what its row gives by the name of the argument, and why it cannot be read."""

    number: int
    values: dict[str, Any]
    error: str = ""


def read_rows(path: Path) -> list[BatchRow]:
    """The rows of a list; a row that cannot be read has an `error`. FileError or UsageError for the list as a whole."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f" {path}: expected {' or '.join(SUFFIXES)}.", _REMEDY, "batch")
    text = decode_text(read_bounded(path, MAX_LIST_BYTES, "Use several lists."))
    rows = _csv_rows(path, text) if path.suffix.lower() == ".csv" else _json_rows(text)
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


def _json_rows(text: str) -> list[BatchRow]:
    lines = [line for line in text.splitlines() if line.strip()]
    return [_json_row(number, line) for number, line in enumerate(lines, 1)]


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
    """The name of an argument as columns may spell it: "--ground-out", "Ground out" and "ground_out" are one."""
    return (text or "").strip().lstrip("-").replace("-", "_").replace(" ", "_").lower()
