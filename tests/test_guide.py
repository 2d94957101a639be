"""Every command and every Python block of the guide and of the documents beside it runs as it stands there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from documents import DOCUMENTS, GUIDE, ROOT, blocks, check_command, commands, run_python, text_of
from sport.runtime.motion.paths import GAITS, PATH_NAMES
from sport.runtime.terrain.library import TERRAIN_NAMES
from sport.viewer.input.bindings import HELP

PAGES = [path for path in DOCUMENTS if path.name != "README.md"]


@pytest.mark.parametrize(("where", "line"), [one for page in PAGES for one in commands(page)])
def test_commands_exist_with_these_options(
    where: str, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    check_command(line, monkeypatch, capsys)


@pytest.mark.parametrize(
    "source",
    [pytest.param(b, id=f"{page.stem}-{n}") for page in GUIDE for n, b in enumerate(blocks(page, "python"))],
)
def test_python_blocks_run_by_themselves(source: str, tmp_path: Path) -> None:
    done = run_python(source, tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", GUIDE, ids=lambda page: page.stem)
def test_blocks_that_need_another_program_are_python_at_least(page: Path) -> None:
    for source in blocks(page, "py"):
        ast.parse(source)


def test_the_table_of_controls_says_what_the_help_overlay_says() -> None:
    def words(text: str) -> set[str]:
        return set(re.findall(r"[\w-]+", text.lower()))

    page = text_of(ROOT / "docs" / "guide" / "driving.md")
    rows = [line for line in page.splitlines() if line.startswith("| ") and line.count("|") == 4]
    for _, entries in HELP:
        for what, keys, pad in entries:
            needed = words(keys) | words(pad)
            assert any(needed <= words(row) for row in rows), what


def test_the_guide_names_every_choice() -> None:
    """Grounds, paths and gaits are listed in full."""
    grounds, lines = (text_of(ROOT / "docs" / "guide" / f"{name}.md") for name in ("grounds", "command-line"))
    for name in TERRAIN_NAMES:
        assert f"`{name}`" in grounds, name
    for name in (*PATH_NAMES, *GAITS):
        assert f"`{name}`" in lines, name
