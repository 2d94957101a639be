"""The Blender add-on as a module, and commands that run in Blender itself."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from runtime.assets import PROJECT_ROOT

BLENDER_VARIABLE = "SPORT_BLENDER"  # names a Blender, or a Python with bpy
ADDON = PROJECT_ROOT / "integrations" / "blender" / "sport_viewer.py"


def load_addon() -> ModuleType:
    """Import the add-on from its file."""
    spec = importlib.util.spec_from_file_location("sport_viewer_addon", ADDON)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _find_blender() -> list[str]:
    """Return the command that runs a script in Blender; empty if there is none."""
    named = os.environ.get(BLENDER_VARIABLE) or shutil.which("blender")
    if named and "python" not in Path(named).name.lower():
        options = "--background --factory-startup --python-use-system-env --python-exit-code 1 --python"
        return [named, *options.split()]
    return [named or sys.executable] if named or importlib.util.find_spec("bpy") else []


needs_blender = pytest.mark.skipif(not _find_blender(), reason="neither bpy nor a command blender")


def blender_command(script: Path, *arguments: object) -> list[str]:
    """Return the command that runs a script in Blender with arguments."""
    command = _find_blender()
    separator = ["--"] if len(command) > 1 else []
    return [*command, str(script), *separator, *map(str, arguments)]


def run_in_blender(script: str, folder: Path, *arguments: object) -> str:
    """Run a script in Blender; returns what it writes into the file that is its last argument."""
    file, target = folder / "in_blender.py", folder / "read.json"
    file.write_text(script)
    command = blender_command(file, *arguments, target)
    subprocess.run(command, check=True, capture_output=True, timeout=600)
    return target.read_text()
