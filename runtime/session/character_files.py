"""A character's files as stored in a session: the glTF, and the files in its folder that it refers to.

They are stored under names valid on every system (`safe_name`), to which the glTF's references are changed.
"""

import hashlib
import itertools
import json
import os
import re
import struct
from pathlib import Path, PurePosixPath
from typing import Any
from unicodedata import normalize
from urllib.parse import quote, unquote

from runtime.atomic import write_atomic
from runtime.character.read import MAX_FILE_BYTES, SUFFIXES, open_gltf
from runtime.errors import FileError
from runtime.safe_read import is_text, parse_json, read_bounded

MAX_FILES = 1000
MAX_NAME_BYTES = 200  # bytes
MAX_ALL_BYTES = MAX_FILE_BYTES  # of all files
REMEDY = "Choose another project."
Files = dict[str, bytes]
_UNSAFE = re.compile(r"""[\x00-\x1f\x7f\\/:*?"<>|\ud800-\udfff]+""")


def read_character_files(path: Path) -> Files:
    """Read the files of a character: the glTF, its buffers and images, and settings of the same name. Raises FileError."""
    stem, suffix = os.path.splitext(path.name)
    stem = _UNSAFE.sub("-", stem).encode()[:80].decode(errors="ignore").strip(" .-")
    main, left = (stem or "character") + suffix, MAX_ALL_BYTES
    files, names = {main: read_bounded(path, left)}, dict[str, str]()
    taken = {_one_file(main)}
    for uri in _local_uris(path):
        name = unquote(uri)
        names[uri] = _kept_name(name, taken)
        left -= len(files[main])
        files[names[uri]] = read_bounded(path.parent / name, max(left, 0))
    if any(unquote(uri) != name for uri, name in names.items()):
        files[main] = _with_uris(files[main], {uri: quote(name) for uri, name in names.items()})
    for settings in sorted(path.parent.glob("*.json")):
        kept = _settings_name(settings.name, path, main)
        if kept and _kept_name(kept, taken) == kept:
            files[kept] = read_bounded(settings, MAX_FILE_BYTES)
    return files


def _local_uris(path: Path) -> list[str]:
    """Return the existing files in a glTF's own folder that it refers to: a missing image costs its texture only."""
    gltf = open_gltf(path).gltf
    uris: list[Any] = [entry.uri for entry in (*(gltf.buffers or []), *(gltf.images or []))]
    local = dict.fromkeys(uri for uri in uris if isinstance(uri, str) and not uri.startswith("data:"))
    return [uri for uri in local if _is_in_folder(path, unquote(uri))]


def _settings_name(name: str, path: Path, main: str) -> str:
    """Return the stored name of a JSON settings file named like the glTF; "" for any other file."""
    for begin, safe in ((path.name, main), (path.stem, Path(main).stem)):
        rest = name.removeprefix(begin)
        if rest != name and rest.startswith(".") and safe_name(safe + rest):
            return safe + rest
    return ""


def _is_in_folder(path: Path, name: str) -> bool:
    try:
        file = (path.parent / name).resolve()
        return file.is_relative_to(path.parent.resolve()) and file.is_file()
    except (OSError, ValueError, RuntimeError):
        return False


def _kept_name(name: str, taken: set[str]) -> str:
    """Return the name that a file is stored under: its own, or another if that is invalid or taken; adds it to `taken`."""
    kept = name
    if not safe_name(name) or _one_file(name) in taken:
        suffix = re.search(r"\.[a-zA-Z0-9]{1,8}$", name)
        others = (f"file {k}{suffix[0] if suffix else ''}" for k in itertools.count(1))
        kept = next(other for other in others if _one_file(other) not in taken)
    taken.add(_one_file(kept))
    return kept


def _one_file(name: str) -> str:
    """Return a canonical form, equal for names that some system takes for one file: they differ in case or Unicode form."""
    return normalize("NFC", name).casefold()


def _with_uris(content: bytes, names: dict[str, str]) -> bytes:
    binary = content[:4] == b"glTF"
    length = struct.unpack_from("<I", content, 12)[0] if binary else len(content)
    document = parse_json(content[20 : 20 + length] if binary else content)
    for entry in (*(document.get("buffers") or []), *(document.get("images") or [])):
        if entry.get("uri") in names:
            entry["uri"] = names[entry["uri"]]
    text = json.dumps(document).encode("ascii")
    if not binary:
        return text
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    version = content[4:8]
    return (
        b"glTF" + version + struct.pack("<II4s", 20 + len(text) + len(rest), len(text), b"JSON") + text + rest
    )


def write_character_files(files: Files, folder: Path) -> Path:
    """Write the files into a folder of their own below `folder` and return the path of the glTF."""
    digest = hashlib.sha256()
    for name, content in files.items():
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    home = folder / digest.hexdigest()[:24]
    for name, content in files.items():
        target = home.joinpath(*PurePosixPath(name).parts)
        if not target.is_file() or target.stat().st_size != len(content):
            write_atomic(target, content)
    return home / next(iter(files))


def check_character_files(files: Files) -> None:
    """Raise FileError unless all names are safe and the first one is a glTF; no files at all is valid."""
    names = list(files)
    if names and (len(names) > MAX_FILES or Path(names[0]).suffix.lower() not in SUFFIXES):
        raise FileError("its character: no glTF file.", REMEDY)
    for name in names:
        if not safe_name(name):
            raise FileError(f"its character: {name[:60]!r} is not the name of a file in its folder.", REMEDY)


def safe_name(name: Any) -> bool:
    """Return whether a relative file name stays in its folder and is valid on every system."""
    if not is_text(name) or not 0 < len(name.encode()) <= MAX_NAME_BYTES:
        return False
    parts = PurePosixPath(name).parts  # "." and ".." end in a dot
    plain = all(part == part.strip() and not part.endswith(".") for part in parts)
    return bool(parts) and plain and not name.startswith("/") and not _UNSAFE.search(name.replace("/", "-"))
