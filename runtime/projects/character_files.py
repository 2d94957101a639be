"""A character's files as they are kept in a project: the glTF, and what it refers to in its own folder."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

from runtime.atomic import write_atomic
from runtime.character.read import MAX_FILE_BYTES, SUFFIXES, open_gltf
from runtime.errors import FileError
from runtime.safe_read import is_text, read_bounded

MAX_FILES = 1000
MAX_NAME = 200
REMEDY = "Choose another project."
Files = dict[str, bytes]


def read_character_files(path: Path) -> Files:
    """The glTF file first, then buffers and images beside it and settings of the same name; FileError."""
    files = {path.name: read_bounded(path, MAX_FILE_BYTES)}
    gltf = open_gltf(path).gltf
    for entry in (*(gltf.buffers or []), *(gltf.images or [])):
        uri: Any = entry.uri
        if isinstance(uri, str) and not uri.startswith("data:") and safe_name(unquote(uri)):
            beside = path.parent / unquote(uri)
            if beside.is_file():  # an image that is missing costs its texture only
                files[unquote(uri)] = read_bounded(beside, MAX_FILE_BYTES)
    for beside in sorted(path.parent.glob("*.json")):
        if beside.name.startswith((f"{path.name}.", f"{path.stem}.")) and beside.name not in files:
            files[beside.name] = read_bounded(beside, MAX_FILE_BYTES)
    return files


def write_character_files(files: Files, folder: Path) -> Path:
    """Put the files into a folder of their own below `folder`; the path of the glTF. Nothing is written outside."""
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
    """FileError unless the names are those of files in one folder, the first one of a glTF."""
    names = list(files)
    if not names or len(names) > MAX_FILES or Path(names[0]).suffix.lower() not in SUFFIXES:
        raise FileError("its character: no glTF file.", REMEDY)
    for name in names:
        if not safe_name(name):
            raise FileError(f"its character: {name[:60]!r} is no name of a file in its folder.", REMEDY)


def safe_name(name: Any) -> bool:
    """Whether a relative name stays in its folder on every system."""
    if not is_text(name) or not 0 < len(name) <= MAX_NAME or any(sign in name for sign in '\0\\:*?"<>|'):
        return False
    parts = PurePosixPath(name).parts
    return bool(parts) and not name.startswith("/") and ".." not in parts and os.path.normpath(name) != "."
