"""Test cases as data: tables of a test file, in the TOML file with the same name."""

import tomllib
from pathlib import Path
from typing import Any


def table(file: str, name: str) -> list[Any]:
    """Return the rows of a table for `pytest.mark.parametrize`; `file` is the `__file__` of the tests."""
    rows = tomllib.loads(Path(file).with_suffix(".toml").read_text("utf-8"))[name]
    return [tuple(row) if isinstance(row, list) else row for row in rows]
