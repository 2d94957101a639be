"""What the README shows runs as it stands there, and every document leads to files and headings that exist."""

import re
import tomllib
from itertools import chain
from pathlib import Path

import pytest

from runtime.formats.bvh_clip import load_clip_bvh
from tests.helpers.documents import (
    DOCUMENTS,
    ROOT,
    Command,
    anchors,
    blocks,
    cases,
    check_command,
    commands,
    links,
    text_of,
)

README = ROOT / "README.md"
MAX_README_LINES = 120
MAX_WORDS = 12800  # of docs/ without the generated tables of docs/results/


def image_script() -> list[Command]:
    """Command lines of `sport` in the script that makes the README's images, without shell variables."""
    script = text_of(ROOT / "docs" / "make_pictures.sh").replace("\\\n", " ")
    lines = [line.strip() for line in script.splitlines()]
    return [Command("docs/make_pictures.sh", x) for x in lines if x.startswith("sport ") and "$" not in x]


def test_the_readme_fits_on_a_few_screens() -> None:
    assert len(text_of(README).splitlines()) <= MAX_README_LINES


def test_the_documents_stay_short() -> None:
    results = ROOT / "docs" / "results"
    written = [p for p in (ROOT / "docs").rglob("*.md") if results not in p.parents]
    assert sum(len(text_of(path).split()) for path in written) < MAX_WORDS


@pytest.mark.usefixtures("quick_clips")
def test_the_library_example_writes_its_clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (example,) = blocks(README, "python")
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "example", "exec"), {})
    assert len(load_clip_bvh(tmp_path / "soldier.bvh")) == 120
    assert len([x for x in example.splitlines() if x and not x.startswith(("from", "import"))]) <= 10


def test_one_line_starts_the_program_and_one_passes_the_tests() -> None:
    first, *_, last = blocks(README, "sh")
    start, tests = (block.strip().split(" && ") for block in (first, last))
    assert start[:2] == tests[:2]
    assert start[-1] == ".venv/bin/sport"
    assert tests[-1].startswith(".venv/bin/pytest")
    assert all("pip install -c constraints.txt" in steps[2] for steps in (start, tests))


def test_constraints_are_names_and_versions_and_cover_what_is_needed() -> None:
    pinned = dict(line.split("==") for line in text_of(ROOT / "constraints.txt").splitlines())
    assert all(re.fullmatch(r"[\w.-]+", name) for name in pinned)
    assert all(re.fullmatch(r"[\w.+]+", version) for version in pinned.values())
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    needed = [*project["dependencies"], *chain(*project["optional-dependencies"].values())]
    assert {re.split(r"[<>=; \[]", line)[0] for line in needed} - {"sport-viewer"} <= pinned.keys()


@pytest.mark.parametrize(("where", "line"), cases([*commands(README), *image_script()]))
def test_commands_exist_with_these_options(
    where: str, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    check_command(line, monkeypatch, capsys)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_and_images_lead_somewhere(document: Path) -> None:
    for link in links(document):
        name, _, anchor = link.partition("#")
        target = (document.parent / name).resolve() if name else document
        assert target.exists(), f"{document}: {link}"
        assert target.is_relative_to(ROOT), f"{document}: {link}"
        if anchor:
            assert anchor in anchors(target), f"{document}: {link}"


def test_every_page_of_the_guide_is_linked_from_the_readme() -> None:
    shown = {link.partition("#")[0] for link in links(README)}
    for page in (ROOT / "docs" / "guide").glob("*.md"):
        assert page.relative_to(ROOT).as_posix() in shown, page


def test_files_and_modules_that_are_named_exist() -> None:
    """Paths in backticks that begin with a folder of the repository, and modules after `python -m`."""
    folders = ("runtime", "viewer", "training", "benchmarks", "assets", "tests", "docs", "examples")
    for document in DOCUMENTS:
        text = text_of(document)
        for name in re.findall(rf"`((?:{'|'.join(folders)})/[\w./-]+?)(?:::\w+)?`", text):
            assert (ROOT / name).exists(), f"{document}: {name}"
        for module in re.findall(r"python -m ((?:runtime|viewer|training|benchmarks)\.[\w.]+)", text):
            path = ROOT / module.replace(".", "/")
            assert path.with_suffix(".py").exists() or path.is_dir(), f"{document}: {module}"
