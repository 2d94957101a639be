"""Writes files completely or not at all: next to the target, then renamed over it or linked to a free name."""

import contextlib
import errno
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from runtime.errors import FileError
from runtime.interrupts import forget, remove_when_ended, undo_when_ended
from runtime.safe_read import printable

_REMEDY = "Choose a folder that can be written, with space left."
_REMEDY_TMP = "Make room there, or name another folder for temporary files by TMPDIR."
NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
_OURS = re.compile(r"\..*-sport-([0-9a-f]{6})[0-9a-f]{6}(\.[^.]*)?")  # process id and a random number
MAX_NUMBER = 100_000  # of names tried by `write_new`


@contextlib.contextmanager
def atomic_path(target: str | Path) -> Iterator[Path]:
    """Yield the path of a temporary file next to `target`, which it replaces when the block ends without an error.

    Missing folders are created, links are followed, and the mode is the old file's or follows the umask. FileError names
    the target when it cannot be written or is a device or pipe; the old file then stays as it was.
    """
    target = Path(target)
    final, temporary = _temporary_beside(target)
    try:
        yield temporary
        _finish(temporary)
        temporary.replace(final)
    except OSError as error:
        raise FileError(f"{target}: {error.strerror or error}.", _REMEDY) from error
    finally:
        _remove(temporary)


def sweep(folder: Path, older_s: float = 600.0) -> list[Path]:
    """Remove the temporary files and folders that a killed program left in a folder, and return them.

    Files are kept if their process still runs or if they are younger than `older_s`, since another machine may be writing here.
    """
    removed = []
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            name = _OURS.fullmatch(path.name)
            if name is not None and not _runs(int(name[1], 16)):
                with contextlib.suppress(OSError):
                    if time.time() - path.lstat().st_mtime > older_s:
                        _discard(path)
                        removed.append(path)
    return removed


def sweep_of(process: int, folder: Path) -> None:
    """Remove the temporary files that a killed process left in a folder."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            name = _OURS.fullmatch(path.name)
            if name is not None and int(name[1], 16) == process & 0xFFFFFF:
                _discard(path)


def _discard(path: Path) -> None:
    """Remove a file, or a folder with its contents; OSError."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextlib.contextmanager
def temporary_folder(beside: Path | None = None) -> Iterator[Path]:
    """Make a temporary folder for the duration of the block, in the system's temporary folder or next to the file `beside`.

    The folder is removed when the block ends or a signal ends the process. Raises FileError if it cannot be made.
    """
    parent = Path(tempfile.gettempdir()) if beside is None else beside.parent
    folder = parent / _temporary_name("" if beside is None else beside.stem)

    def remove() -> None:
        for _ in range(3):  # another thread may be writing into it
            with contextlib.suppress(OSError):
                _discard(folder)

    undo_when_ended(folder, remove)
    try:
        _make_folder(parent)
        folder.mkdir(mode=0o700)
        yield folder
    except (OSError, FileError) as error:
        cause = error.__cause__ if isinstance(error, FileError) else error
        of_folder = error is cause or str(folder) in str(error)
        if not isinstance(cause, OSError) or not of_folder or (beside is None and cause.errno not in NO_ROOM):
            raise
        why = f"{beside or parent}: {cause.strerror or cause}."
        raise FileError(why, _REMEDY if beside else _REMEDY_TMP) from error
    finally:
        remove()
        forget(folder)


def _runs(process: int) -> bool:
    """Return whether a process with this id runs here; False on Windows, where such a check would end it."""
    if process == 0 or sys.platform == "win32":
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # belongs to another user
    return True


def write_new(target: str | Path, content: str | bytes) -> Path:
    """Write a file as `target`, or as the first free name of name-2, name-3, …; return its path.

    The name is reserved and filled in one step, so that programs writing at the same moment all keep their files.
    """
    target = Path(target)
    temporary = _temporary(target, target)
    try:
        temporary.write_bytes(_bytes(content))
        _finish(temporary)
        return _take_name(temporary, target)
    except OSError as error:
        raise FileError(f"{target}: {error.strerror or error}.", _REMEDY) from error
    finally:
        _remove(temporary)


def _take_name(temporary: Path, target: Path) -> Path:
    """Give the finished file the first free name; return its path."""
    for number in range(1, MAX_NUMBER):
        candidate = target if number == 1 else target.with_stem(f"{target.stem}-{number}")
        try:
            os.link(temporary, candidate)
        except FileExistsError:
            continue
        except (OSError, AttributeError, NotImplementedError):  # a disk without hard links, such as FAT
            try:
                os.close(os.open(candidate, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            except FileExistsError:
                continue
            try:
                temporary.replace(candidate)  # the name is reserved by us
            except OSError:
                candidate.unlink(missing_ok=True)
                raise
        return candidate
    raise FileError(f"{target}: {MAX_NUMBER} files of this name exist.", "Choose another name.")


def check_target(target: str | Path) -> None:
    """Raise FileError if `target` cannot be written; call it before the work whose result goes there."""
    _remove(_temporary_beside(Path(target))[1])


def _temporary_beside(target: Path) -> tuple[Path, Path]:
    """Return the file that `target` refers to, with links followed, and a new empty file next to it with the right mode."""
    try:
        found = _existing(target)
        final = Path(os.path.realpath(target)) if target.is_symlink() else target
    except (OSError, ValueError) as error:
        raise FileError(f"{target}: {getattr(error, 'strerror', None) or error}.", _REMEDY) from error
    return final, _temporary(target, final, found)


def _temporary(target: Path, final: Path, found: os.stat_result | None = None) -> Path:
    """Create an empty file next to `final`, with its mode or the umask's; errors name `target`."""
    temporary = final.with_name(_temporary_name(final.stem, final.suffix))
    flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY
    try:
        _make_folder(final.parent)
        remove_when_ended(temporary)
        os.close(os.open(temporary, flags, 0o666))  # less the umask
        if found is not None:
            temporary.chmod(stat.S_IMODE(found.st_mode))
    except FileExistsError as error:
        raise FileError(f"{target}: {error.filename or target.parent} is not a folder.", _REMEDY) from error
    except (OSError, ValueError) as error:
        raise FileError(f"{target}: {getattr(error, 'strerror', None) or error}.", _REMEDY) from error
    return temporary


def _temporary_name(stem: str, suffix: str = "") -> str:
    return f".{stem[:20]}-sport-{os.getpid() & 0xFFFFFF:06x}{os.urandom(3).hex()}{suffix[:12]}"


def _make_folder(folder: Path) -> None:
    """Create a folder and its parents; a signal that ends the process removes those still empty."""
    missing = [path for path in (folder, *folder.parents) if not os.path.exists(path)]
    folder.mkdir(parents=True, exist_ok=True)
    for path in reversed(missing):
        remove_when_ended(path)


def _remove(temporary: Path) -> None:
    temporary.unlink(missing_ok=True)
    forget(temporary)


def _existing(target: Path) -> os.stat_result | None:
    """Return a file's status, None if it is missing; FileError for folders, devices and pipes, which must not be replaced."""
    try:
        found = target.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    if stat.S_ISDIR(found.st_mode):
        raise FileError(f"{target}: this is a folder.", "Add the name of a file.")
    if not stat.S_ISREG(found.st_mode):
        raise FileError(f"{target}: this is a device or a pipe, not a file.", "Choose the name of a file.")
    return found


def _finish(temporary: Path) -> None:
    with temporary.open("rb") as file:
        os.fsync(file.fileno())


def _bytes(content: str | bytes) -> bytes:
    return printable(content).encode("utf-8") if isinstance(content, str) else content


def write_atomic(target: str | Path, content: str | bytes) -> None:
    """Write a text (UTF-8) or binary file completely or not at all; see `atomic_path`."""
    data = _bytes(content)
    with atomic_path(target) as temporary:
        temporary.write_bytes(data)


def write_together(contents: Mapping[Path, str | bytes]) -> None:
    """Write several files, replacing none until all are written; see `atomic_path`."""
    with contextlib.ExitStack() as stack:
        for target, content in contents.items():
            temporary = stack.enter_context(atomic_path(target))
            temporary.write_bytes(_bytes(content))
            _finish(temporary)
