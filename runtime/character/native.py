"""Runs native decoders (meshopt, Draco, KTX2, ufbx) in a separate process with limits on memory and time.

A damaged file may crash that process or exhaust its limits: the caller gets a FileError.
"""

import importlib.util
import json
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

from runtime.atomic import temporary_folder
from runtime.errors import FileError
from runtime.interrupts import run_child

HEADS = (b"Kaydara FBX Binary", b"; FBX")  # start of an FBX file
PACKAGES = {  # per kind: the module, its package, the files that need it
    "fbx": ("ufbx", "ufbx", "an FBX"),
    "meshopt": ("meshoptimizer", "meshoptimizer", "compressed by meshopt"),
    "draco": ("DracoPy", "DracoPy", "compressed by Draco"),
    "ktx2": ("opengl_basisu", "opengl-basisu", "a texture in KTX2"),
}
WORKING_BYTES = 256 << 20  # memory beyond that of the libraries
BYTES_FOR_ONE = 16  # added per byte of the file, or of its output
TIMEOUT_S = 120.0  # wall time; also the limit of processor time
CPU_S = 60
_ROOT = Path(__file__).parents[2]
_START = "import sys; sys.path.insert(0, sys.argv[1]); from runtime.character import native_worker as w; w.main(*sys.argv[2:])"


def decode(kind: str, path: Path, facts: Any, data: bytes, remedy: str) -> bytes:
    """Decode `data` in a worker process of the given kind (`native_worker`); FileError names `path`."""
    module, package, what = PACKAGES[kind]
    if importlib.util.find_spec(module) is None:
        raise FileError(
            f"{path}: {what}, which needs the library {package}.",
            f"Run pip install {package} (or '.[characters]'), or export the character without it.",
        )
    try:
        return _decoded(kind, json.dumps(facts), data)
    except ValueError as error:
        raise FileError(f"{path}: damaged ({what}: {error}).", remedy) from error


def fbx_as_glb(path: Path, motion: bool = False) -> bytes:
    """Convert an FBX to GLB, with its animations if `motion`; FileError says what is wrong, or how to install the library."""
    known = path.stat()
    facts = {"path": str(path.resolve()), "modified": known.st_mtime_ns, "size": known.st_size}
    return decode("fbx", path, facts | {"motion": motion}, b"", "Export it again as binary FBX, or as .glb.")


@lru_cache(2)  # a character is opened several times: to guess its joints, to show and to write it
def _decoded(kind: str, facts: str, data: bytes) -> bytes:
    """Run the worker and return its output; ValueError says what went wrong."""
    limit = WORKING_BYTES + BYTES_FOR_ONE * json.loads(facts).get("size", len(data))
    with temporary_folder() as folder:
        source, target = folder / "in", folder / "out"
        source.write_bytes(data)
        source.with_name("facts.json").write_text(facts, encoding="utf-8")
        command = [sys.executable, "-P", "-c", _START, str(_ROOT), kind, str(folder), str(limit), str(CPU_S)]
        try:
            done = run_child(command, timeout=TIMEOUT_S)
        except subprocess.TimeoutExpired as error:
            raise ValueError(f"not read in {TIMEOUT_S:g} s") from error
        except OSError as error:
            raise ValueError(f"its reader did not start: {error}"[:200]) from error
        if done.returncode or not target.is_file():
            lines = done.stderr.strip().splitlines() or [f"its reader ended with {done.returncode}"]
            raise ValueError(lines[-1][:200])
        return target.read_bytes()
