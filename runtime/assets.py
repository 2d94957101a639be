"""Where the shipped files lie: one root for every asset and shader."""

from __future__ import annotations

from pathlib import Path

from sport.runtime.errors import FileError

PROJECT_ROOT = Path(__file__).resolve().parent.parent


def asset_path(relative: str) -> Path:
    """Path of a shipped asset, e.g. `asset_path("character/mannequin.glb")`; FileError when it is missing."""
    path = PROJECT_ROOT / "assets" / relative
    if not path.exists():
        raise FileError(f"{path}: this shipped file is missing.", "Install the program again.")
    return path
