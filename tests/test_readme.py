"""What the README shows runs as it stands there: the library example, every command line, every picture and link."""

from __future__ import annotations

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from sport.runtime.assets import PROJECT_ROOT
from sport.runtime.takes.clip import load_clip_bvh
from sport.viewer.input.bindings import HELP

from sport import cli

README = (PROJECT_ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, re.S)


def sport_lines() -> list[str]:
    """Command lines of `sport` in the README and in the pictures' script, without shell variables."""
    script = (PROJECT_ROOT / "docs" / "make_pictures.sh").read_text(encoding="utf-8")
    shell = "\n".join(text for language, text in BLOCKS if language == "sh")
    lines = [line.strip() for line in (shell + script.replace("\\\n", " ")).splitlines()]
    return [line for line in lines if line.startswith("sport ") and "$" not in line]


def test_the_library_example_writes_its_clip(tmp_path: Path) -> None:
    (example,) = (text for language, text in BLOCKS if language == "python")
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(PROJECT_ROOT)!r})\n{example}"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(load_clip_bvh(tmp_path / "soldier.bvh")) == 120
    steps = [line for line in example.splitlines() if line and not line.startswith(("from", "import"))]
    assert len(steps) <= 10


@pytest.mark.parametrize("line", sport_lines())
def test_commands_exist_with_these_options(line: str) -> None:
    arguments = shlex.split(line, comments=True)[1:]
    if arguments[0] in ("train", "evaluate"):
        assert arguments[0] in cli._TRAINING
    else:
        cli.build_parser().parse_args(arguments)


def test_modules_that_are_run_exist() -> None:
    modules = re.findall(r"python -m ([\w.]+)", README)
    assert len(modules) > 3
    for module in modules:
        assert importlib.util.find_spec(module) is not None, module


def test_links_and_pictures_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)#]+?)\)", README)
    assert "docs/images/viewer.png" in targets
    for target in targets:
        assert (PROJECT_ROOT / target).exists(), target


def test_the_table_of_controls_says_what_the_help_overlay_says() -> None:
    def words(text: str) -> set[str]:
        return set(re.findall(r"[\w-]+", text.lower()))

    rows = [line for line in README.splitlines() if line.startswith("| ") and line.count("|") == 4]
    for _, entries in HELP:
        for what, keys, pad in entries:
            wanted = words(keys) | words(pad)
            assert any(wanted <= words(row) for row in rows), what
