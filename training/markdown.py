"""Markdown tables, and generated sections of a document, between two marker lines; the rest is not changed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any

from runtime.atomic import write_atomic
from runtime.errors import FileError


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table and an empty line."""
    return [
        "| " + " | ".join(head) + " |",
        "|" + " --- |" * len(head),
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
    ]


def columns(of: Mapping[str, Callable[[Any], str]], rows: Iterable[Any]) -> list[str]:
    """Return the lines of a table; `of` maps the title of each column to the function that gives its cells."""
    return table(list(of), [[cell(row) for cell in of.values()] for row in rows])


def number(value: float | None, digits: int = 1) -> str:
    """Format a figure; a dash if there is none."""
    return "–" if value is None or isnan(value) else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """Format a fraction as a percentage; a dash if there is none."""
    return "–" if value is None or isnan(value) else f"{100.0 * value:.0f} %"


def check_section(path: Path, section: str) -> None:
    """Raise FileError if `path` lacks the markers of a section; call it before measuring."""
    _around(path, section)


def write_section(path: Path, section: str, text: str) -> None:
    """Write `text` between the markers of a section; FileError if `path` lacks one."""
    before, after = _around(path, section)
    write_atomic(path, before + "\n" + text.strip("\n") + "\n" + after)


def _around(path: Path, section: str) -> tuple[str, str]:
    """Return the document before and after a section's text, with the markers."""
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
