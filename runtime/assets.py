"""Where the shipped files lie: one root for every asset and shader, and the trained models by name."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from runtime.errors import FileError
from runtime.safe_read import parse_json, read_bounded

_PACKAGES = Path(__file__).resolve().parent.parent
# in a checkout assets and shaders lie next to the packages, in an installed wheel inside `sport`
PROJECT_ROOT = _PACKAGES if (_PACKAGES / "assets").is_dir() else _PACKAGES / "sport"
DEFAULT_MODEL = "compact"
MAX_METADATA_BYTES = 16 << 20


def asset_path(relative: str) -> Path:
    """Path of a shipped asset, e.g. `asset_path("character/mannequin.glb")`; FileError when it is missing."""
    path = PROJECT_ROOT / "assets" / relative
    if not path.exists():
        raise FileError(f"{path}: this shipped file is missing.", "Install the program again.")
    return path


@lru_cache(1)
def shipped_models() -> dict[str, Path]:
    """Folder of every shipped model by its name, the default first; FileError where the package has none."""
    folders = [path.parent for path in asset_path("models").glob("*/metadata.json")]
    return {path.name: path for path in sorted(folders, key=lambda p: (p.name != DEFAULT_MODEL, p.name))}


def model_folder(model: Path | str | None = None) -> Path:
    """Folder of a model that is shipped under a name (`compact`), lies somewhere (`./mine`) or, for None, is the default.

    FileError where that is missing; of a name it lists those that are shipped.
    """
    if model is None:
        return asset_path(f"models/{DEFAULT_MODEL}")
    named = shipped_models() if Path(model).parent == Path() and not str(model).startswith(".") else {}
    if named and str(model) not in named and not Path(model).exists():
        raise FileError(
            f"--model {model}: no model of this name is shipped, and there is no such folder.",
            f"Shipped: {', '.join(named)}. Or name the folder of an exported model.",
        )
    return named.get(str(model), Path(model))


def character_file(name: str | Path) -> Path:
    """The file of a character that is shipped under a name (`walker`), or the path itself."""
    shipped = PROJECT_ROOT / "assets" / "character" / f"{name}.glb"
    return shipped if Path(name).parent == Path() and shipped.is_file() else Path(name)


def model_name(folder: Path | None) -> str:
    """Name of a shipped model's folder (None: the default); "" for any other folder."""
    if folder is None:
        return DEFAULT_MODEL
    return next((name for name, path in shipped_models().items() if path == folder), "")


def model_hashes(folder: Path) -> set[str]:
    """SHA-256 of the networks of a model, as its metadata says; none where there is no model."""
    try:
        hashes = parse_json(read_bounded(folder / "metadata.json", MAX_METADATA_BYTES)).get("sha256", {})
    except (FileError, ValueError, AttributeError):
        return set()
    return (
        {value for value in hashes.values() if isinstance(value, str)} if isinstance(hashes, dict) else set()
    )


def state_directory(environment: dict[str, str] | None = None) -> Path:
    """Where takes lie that are not exported: $SPORT_CONFIG_DIR, else $XDG_STATE_HOME/sport-viewer, else ~/.local/state/…."""
    env = os.environ if environment is None else environment
    if env.get("SPORT_CONFIG_DIR"):
        return Path(env["SPORT_CONFIG_DIR"])
    return Path(os.path.expanduser(env.get("XDG_STATE_HOME") or "~/.local/state")) / "sport-viewer"
