"""Files appear whole or not at all: write beside the target, then rename over it."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from sport.runtime.errors import FileError

_REMEDY = "Choose a folder that can be written, with space left."


@contextlib.contextmanager
def atomic_path(target: str | Path) -> Iterator[Path]:
    """Path of a temporary file beside `target` that replaces it when the block ends without an error.

    Missing folders are made. FileError names the target when it cannot be written; the old file then stays as it was.
    """
    target = Path(target)
    temporary = _temporary_beside(target)
    try:
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.chmod(0o644)  # mkstemp makes files that nobody else can read
        temporary.replace(target)
    except OSError as error:
        raise FileError(f"{target}: {error.strerror or error}.", _REMEDY) from error
    finally:
        temporary.unlink(missing_ok=True)


def check_target(target: str | Path) -> None:
    """FileError when `target` cannot be written: to be asked before the work that it is to hold, not after."""
    _temporary_beside(Path(target)).unlink()


def _temporary_beside(target: Path) -> Path:
    try:
        if target.is_dir():
            raise FileError(f"{target}: this is a folder.", "Add the name of a file.")
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            prefix=f".{target.stem[:80]}-", suffix=target.suffix, dir=target.parent
        )
        os.close(handle)
    except FileExistsError as error:
        raise FileError(f"{target}: {error.filename or target.parent} is not a folder.", _REMEDY) from error
    except (OSError, ValueError) as error:
        raise FileError(f"{target}: {getattr(error, 'strerror', None) or error}.", _REMEDY) from error
    return Path(name)


def write_atomic(target: str | Path, content: str | bytes) -> None:
    """Write a whole text (UTF-8) or binary file; see `atomic_path`."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    with atomic_path(target) as temporary:
        temporary.write_bytes(data)
