"""The manifest of a batch: a JSON line for each row, written as soon as the row is done."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

from runtime.atomic import write_atomic
from runtime.errors import FileError
from runtime.safe_read import parse_json, read_bounded
from sport.batch.plan import Task

NAME = "manifest.jsonl"
MAX_BYTES = 1024 * 1024 * 1024


def entry(number: int, values: dict[str, Any], key: str = "", error: str = "", **made: Any) -> dict[str, Any]:
    """A line: row, arguments, file, files with their hashes, seconds of work, sha256 of the file, error."""
    return {
        "row": number,
        "arguments": values,
        "file": made.get("file"),
        "sha256": made.get("sha256"),
        "seconds": made.get("seconds"),
        "error": error or None,
        "notes": made.get("notes", []),
        "files": made.get("files", {}),
        "key": key,
    }


class Manifest:
    """What is known of the rows of `folder`; `add` appends a line that a crash cannot take back."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        self.lines = read_lines(self.path)
        self._file: IO[bytes] | None = None

    def done(self, task: Task) -> bool:
        """Whether a task was made, of these arguments, and all its files are still as they were."""
        line = self.lines.get(task.number, {})
        if line.get("error") or line.get("key") != task.key or not isinstance(line.get("files"), dict):
            return False
        files = [(self.path.parent / name, sha) for name, sha in line["files"].items()]
        return bool(files) and all(path.is_file() and sha256(path) == sha for path, sha in files)

    def add(self, line: dict[str, Any]) -> None:
        """Append a line. FileError when it cannot be written."""
        self.lines[line["row"]] = line
        try:
            if self._file is None:
                self._file = self.path.open("ab")
                if self._file.tell() and not self.path.read_bytes().endswith(b"\n"):
                    self._file.write(b"\n")  # after a line that was cut off
            self._file.write(_text(line).encode("utf-8"))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise FileError(
                f"{self.path}: {error.strerror or error}.", "Make room; the batch goes on from here."
            ) from error

    def finish(self, numbers: Iterable[int]) -> None:
        """One line for each of these rows, in their order; older ones go."""
        self.close()
        write_atomic(self.path, "".join(_text(self.lines[n]) for n in sorted(numbers) if n in self.lines))

    def close(self) -> None:
        """Let go of the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def read_lines(path: Path) -> dict[int, dict[str, Any]]:
    """The last line of each row; lines that are damaged, as the last one of a run that was killed, are left out."""
    if not path.exists():
        return {}
    found = {}
    for text in read_bounded(path, MAX_BYTES).splitlines():
        try:
            line = parse_json(text)
        except ValueError:
            continue
        if isinstance(line, dict) and isinstance(line.get("row"), int):
            found[line["row"]] = line
    return found


def sha256(path: Path) -> str:
    """Hash of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _text(line: dict[str, Any]) -> str:
    return json.dumps(line, ensure_ascii=False, default=str) + "\n"
