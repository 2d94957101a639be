"""Markdown: tables, and generated sections of a document; what lies outside a section's two marker lines is left alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any

from runtime.atomic import write_atomic
from runtime.errors import FileError


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table, an empty one after it."""
    return [
        "| " + " | ".join(head) + " |",
        "|" + " --- |" * len(head),
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
    ]


def columns(of: Mapping[str, Callable[[Any], str]], rows: Iterable[Any]) -> list[str]:
    """Lines of a table whose columns, by title, say what each shows of a row."""
    return table(list(of), [[cell(row) for cell in of.values()] for row in rows])


def number(value: float | None, digits: int = 1) -> str:
    """A figure, or a dash where there is none."""
    return "–" if value is None or isnan(value) else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """A share in percent, or a dash where there is none."""
    return "–" if value is None or isnan(value) else f"{100.0 * value:.0f} %"


def check_section(path: Path, section: str) -> None:
    """FileError when `path` has no markers of a section, for use before the figures are measured."""
    _around(path, section)


def write_section(path: Path, section: str, text: str) -> None:
    """Put `text` between the markers of a section; FileError when `path` does not have both."""
    before, after = _around(path, section)
    write_atomic(path, before + "\n" + text.strip("\n") + "\n" + after)


def _around(path: Path, section: str) -> tuple[str, str]:
    """A document up to and from a section's text, markers included."""
    begin, end = (f"<!-- {section}: {word} -->" for word in ("begin", "end"))
    try:
        old = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(
            f"{path}: cannot be read as text ({error}).", "Choose a document in UTF-8."
        ) from error
    before, found, rest = old.partition(begin)
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise FileError(f"{path}: has no lines {begin} and {end}.", "Add them where the section belongs.")
    return before + begin, end + after
