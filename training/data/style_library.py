"""The written six-part descriptions of every captured style: those of the shipped file, and those of the data sets' records."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from runtime.errors import FileError
from training.data.sets import DATA_SETS


def style_library(path: Path) -> dict[str, Any]:
    """By style: `descriptions`, one mapping of body parts each, of which the last `measured` were measured.

    A style of `path` (assets/prompts/styles.json) comes before one of the same name in a record. FileError where `path` is damaged.
    """
    try:
        written = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(
            f"{path}: not a readable JSON file.", "Restore assets/prompts/styles.json."
        ) from error
    own = {
        style: {"descriptions": list(d)} for record in DATA_SETS for style, d in record.descriptions.items()
    }
    return own | dict(written)
