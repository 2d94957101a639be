"""The Blender add-on as a module, and commands that run in Blender itself."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from runtime.assets import PROJECT_ROOT

ADDON = PROJECT_ROOT / "integrations" / "blender" / "sport_viewer.py"


def load_addon() -> ModuleType:
    """The add-on's file imported from where it lies."""
    spec = importlib.util.spec_from_file_location("sport_viewer_addon", ADDON)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def blender_command(script: Path, *arguments: object) -> list[str]:
    """The command that runs a script in Blender with arguments."""
    from runtime.formats.fbx import find_blender

    command = find_blender()
    assert command is not None
    separator = ["--"] if len(command) > 1 else []
    return [*command, str(script), *separator, *map(str, arguments)]
