"""A take as FBX: written as GLB first, then by Blender, which runs as a process of its own."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from runtime.atomic import atomic_path
from runtime.errors import FileError, UsageError
from runtime.formats.engines import engine_of
from runtime.formats.glb import save_glb
from runtime.formats.options import ExportOptions
from runtime.formats.prepare import Check, PreparedTake, go_on
from runtime.terrain.height_map import Terrain

BLENDER_VARIABLE = "SPORT_BLENDER"
TIMEOUT_S, POLL_S = 600.0, 0.05
_HEADLESS = [
    "--background",
    "--factory-startup",
    "--python-use-system-env",
    "--python-exit-code",
    "1",
    "--python",
]
_SCRIPT = Path(__file__).with_name("blender_fbx.py")


def find_blender() -> list[str] | None:
    """The command that runs a script in Blender, as far as the script; None where there is no Blender.

    The variable SPORT_BLENDER (a Blender, or a Python that has `bpy`) comes first, then `bpy` in this Python, then the
    command `blender`.
    """
    named = os.environ.get(BLENDER_VARIABLE)
    if named:
        return [named] if "python" in Path(named).name.lower() else [named, *_HEADLESS]
    if importlib.util.find_spec("bpy") is not None:
        return [sys.executable]
    found = shutil.which("blender")
    return None if found is None else [found, *_HEADLESS]


def check_fbx(path: Path) -> list[str]:
    """The command of `find_blender`; UsageError says how to get FBX where there is none."""
    command = find_blender()
    if command is None:
        raise UsageError(
            f"{path}: FBX is written by Blender, and neither the Python module bpy nor a command blender is here.",
            "Run pip install -e '.[fbx]' with Python 3.11, install Blender 4.4 or later, name one in"
            f" {BLENDER_VARIABLE}, or write a .glb.",
        )
    return command


def save_fbx(
    take: PreparedTake, path: Path, options: ExportOptions, terrain: Terrain | None, check: Check = go_on
) -> None:
    """Write a prepared take as FBX; UsageError without Blender, FileError when it fails."""
    command = check_fbx(path)
    with tempfile.TemporaryDirectory(prefix="sport-fbx-") as folder, atomic_path(path) as target:
        glb, fbx = Path(folder) / "take.glb", Path(folder) / "take.fbx"
        save_glb(take, glb, replace(options, plain=True), terrain, check)
        unit = engine_of(options.engine).fbx_unit if options.engine else "m"
        separator = ["--"] if len(command) > 1 else []
        facts = [str(glb), str(fbx), repr(take.clip.fps), unit, take.clip.name]
        said = _run([*command, str(_SCRIPT), *separator, *facts], Path(folder) / "said.txt", path, check)
        if not fbx.is_file():  # some versions crash at their end, after the file is there
            raise FileError(f"{path}: Blender wrote no FBX ({said[-1][:200]}).", "Write a .glb instead.")
        target.write_bytes(fbx.read_bytes())


def _run(command: list[str], log: Path, path: Path, check: Check) -> list[str]:
    """The lines that a command said; it is killed where `check` ends the export. FileError."""
    end = time.monotonic() + TIMEOUT_S
    same_ids = {**os.environ, "PYTHONHASHSEED": "0"}  # Blender makes those of an FBX from hashes
    try:
        with (
            log.open("wb") as file,
            subprocess.Popen(command, stdout=file, stderr=file, env=same_ids) as process,
        ):
            try:
                while process.poll() is None:
                    if time.monotonic() > end:
                        raise subprocess.TimeoutExpired(command[0], TIMEOUT_S)
                    check()
                    time.sleep(POLL_S)
            finally:
                process.kill()
    except (OSError, subprocess.TimeoutExpired) as error:
        raise FileError(f"{path}: {command[0]} did not run ({error}).", "Write a .glb instead.") from error
    said = log.read_text(errors="replace").strip().splitlines()
    return said or ["it said nothing"]
