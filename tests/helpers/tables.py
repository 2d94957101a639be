"""Cases that are data: the tables of a test file lie beside it, in the TOML file of its name."""

import tomllib
from pathlib import Path
from typing import Any


def table(file: str, name: str) -> list[Any]:
    """The rows of a table for `pytest.mark.parametrize`; `file` is the `__file__` of the tests."""
    rows = tomllib.loads(Path(file).with_suffix(".toml").read_text("utf-8"))[name]
    return [tuple(row) if isinstance(row, list) else row for row in rows]
