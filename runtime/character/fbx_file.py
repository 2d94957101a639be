"""An FBX character as the bytes of a GLB, by the library ufbx in a process of its own."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

from runtime.errors import FileError

HEADS = (b"Kaydara FBX Binary", b"; FBX")
TIMEOUT_S = 120.0
_SCRIPT = Path(__file__).with_name("fbx_to_glb.py")


def fbx_as_glb(path: Path) -> bytes:
    """The GLB of an FBX; FileError says how to get the library, or what is wrong with the file."""
    if importlib.util.find_spec("ufbx") is None:
        raise FileError(
            f"{path}: FBX is read by the library ufbx, which is not installed.",
            "Run pip install ufbx (or '.[characters]'), or export the character as .glb.",
        )
    known = path.stat()
    return _converted(path.resolve(), known.st_mtime_ns, known.st_size)


@lru_cache(2)  # a character is opened several times: to look at its joints, to show and to write it
def _converted(path: Path, modified: int, size: int) -> bytes:
    remedy = "Export it again as binary FBX, or as .glb."
    with tempfile.TemporaryDirectory(prefix="sport-fbx-") as folder:
        target = Path(folder) / "character.glb"
        command = [sys.executable, "-P", str(_SCRIPT), str(path), str(target)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise FileError(f"{path}: the FBX was not read ({error}).", remedy) from error
        if done.returncode or not target.is_file():
            said = done.stderr.strip().splitlines() or [f"its reader ended with {done.returncode}"]
            raise FileError(f"{path}: damaged FBX ({said[-1][:200]}).", remedy)
        return target.read_bytes()
