"""Paths of shipped files: one root for all assets and shaders, and the trained models by name."""

import os
from functools import lru_cache
from pathlib import Path

from runtime.errors import FileError
from runtime.safe_read import parse_json, read_bounded

_PACKAGES = Path(__file__).resolve().parent.parent
# in a checkout beside the packages, in an installed wheel inside `sport`
PROJECT_ROOT = _PACKAGES if (_PACKAGES / "assets").is_dir() else _PACKAGES / "sport"
DEFAULT_MODEL = "compact"
MAX_METADATA_BYTES = 16 << 20


def asset_path(relative: str) -> Path:
    """Return the path of a shipped asset, e.g. `asset_path("character/mannequin.glb")`; FileError if it is missing."""
    path = PROJECT_ROOT / "assets" / relative
    if not path.exists():
        raise FileError(f"{path}: this shipped file is missing.", "Install the program again.")
    return path


@lru_cache(1)
def shipped_models() -> dict[str, Path]:
    """Return the folder of each shipped model by name, the default first; FileError if the package contains none."""
    folders = [path.parent for path in asset_path("models").glob("*/metadata.json")]
    return {path.name: path for path in sorted(folders, key=lambda p: (p.name != DEFAULT_MODEL, p.name))}


def model_folder(model: Path | str | None = None) -> Path:
    """Return the folder of a shipped model (`compact`), of a path (`./mine`), or of the default model for None.

    Raises FileError if a named model is missing, with the names that are shipped.
    """
    if model is None:
        return asset_path(f"models/{DEFAULT_MODEL}")
    named = shipped_models() if Path(model).parent == Path() and not str(model).startswith(".") else {}
    if named and str(model) not in named and not os.path.exists(model):
        raise FileError(
            f"--model {model}: no model of this name is shipped, and there is no such folder.",
            f"Shipped: {', '.join(named)}. Or name the folder of an exported model.",
        )
    return named.get(str(model), Path(model))


def character_file(name: str | Path) -> Path:
    """Return the file of a shipped character (`walker`), or the path itself if no such character is shipped."""
    shipped = PROJECT_ROOT / "assets" / "character" / f"{name}.glb"
    return shipped if Path(name).parent == Path() and os.path.isfile(shipped) else Path(name)


def model_name(folder: Path | None) -> str:
    """Return the name of a shipped model by its folder (None: the default model), or "" for any other folder."""
    if folder is None:
        return DEFAULT_MODEL
    return next((name for name, path in shipped_models().items() if path == folder), "")


def model_hashes(folder: Path) -> set[str]:
    """Return the SHA-256 hashes of a model's networks as listed in its metadata; empty if there is no model."""
    try:
        hashes = parse_json(read_bounded(folder / "metadata.json", MAX_METADATA_BYTES)).get("sha256", {})
    except (FileError, ValueError, AttributeError):
        return set()
    return (
        {value for value in hashes.values() if isinstance(value, str)} if isinstance(hashes, dict) else set()
    )


def state_directory(environment: dict[str, str] | None = None) -> Path:
    """Return the folder of takes not yet exported: $SPORT_CONFIG_DIR, else $XDG_STATE_HOME/sport-viewer, else ~/.local/state/…."""
    env = os.environ if environment is None else environment
    if env.get("SPORT_CONFIG_DIR"):
        return Path(env["SPORT_CONFIG_DIR"])
    return Path(os.path.expanduser(env.get("XDG_STATE_HOME") or "~/.local/state")) / "sport-viewer"
