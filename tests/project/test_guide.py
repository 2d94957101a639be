"""Every command and every Python block of the guide and of the documents beside it runs as it stands there."""

import ast
import re
from pathlib import Path

import pytest

from runtime.motion.control_scripts import GAITS, PATH_NAMES
from runtime.motion.controller import TEMPERATURE
from runtime.motion.model import PERIODS_S
from runtime.terrain.library import TERRAIN_NAMES
from tests.helpers.documents import DOCUMENTS, GUIDE, ROOT, blocks, cases, check_command, commands, text_of
from training.presets import ABLATIONS, preset
from viewer.input.bindings import BUTTONS, HELP, KEYS, help_text

PAGES = [path for path in DOCUMENTS if path.name != "README.md"]


@pytest.mark.parametrize(("where", "line"), cases(one for page in PAGES for one in commands(page)))
def test_commands_exist_with_these_options(
    where: str, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    check_command(line, monkeypatch, capsys)


@pytest.mark.parametrize(
    "source",
    [pytest.param(b, id=f"{page.stem}-{n}") for page in GUIDE for n, b in enumerate(blocks(page, "python"))],
)
@pytest.mark.usefixtures("quick_clips")
def test_python_blocks_run_by_themselves(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(source, "block", "exec"), {})


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
            needed = words(help_text(keys, KEYS, "")) | words(help_text(pad, BUTTONS, ""))
            assert any(needed <= words(row) for row in rows), what


def test_the_guide_names_every_choice() -> None:
    """Grounds, paths and gaits are listed in full."""
    grounds, lines = (text_of(ROOT / "docs" / "guide" / f"{name}.md") for name in ("grounds", "command-line"))
    for name in TERRAIN_NAMES:
        assert f"`{name}`" in grounds, name
    for name in (*PATH_NAMES, *GAITS):
        assert f"`{name}`" in lines, name


def test_the_page_on_the_model_has_todays_numbers() -> None:
    """Noise, temperature, sizes and the names of all ablations are those of the code."""
    page = text_of(ROOT / "docs" / "model.md")
    *first, last = (f"{period:g}" for period in PERIODS_S)
    assert f"periods of {', '.join(first)} and {last} s" in page
    assert f"scaled by {TEMPERATURE:g} " in page
    for name in set(ABLATIONS) - {"full"}:
        assert f"`{name}`" in page, name
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines()]
    rows = {row[0]: row[1:] for row in cells if len(row) == 4}
    hidden, dropout = "hidden width of the motion experts", "dropout of the motion experts"
    for title, field in (("W, E", "embedding"), (hidden, "hidden"), (dropout, "dropout")):
        values = [str(getattr(preset(name), field)) for name in ("paper", "compact")]
        assert rows[title][1:] == values, title


def test_every_table_of_results_has_its_command() -> None:
    for page in (ROOT / "docs" / "results").glob("*.md"):
        assert "```sh\n" in text_of(page) or "Written by `python -m" in text_of(page), page


def test_documents_say_what_is() -> None:
    """History is in the commits: no earlier models, no plans, no notes of a day."""
    diary = re.compile(r"models? (?:ago|before)|scratch script|disturbed|try next|was tried|today we", re.I)
    for page in DOCUMENTS:
        found = diary.search(text_of(page))
        assert found is None or page.name == "CHANGELOG.md", f"{page}: {found and found.group()}"
