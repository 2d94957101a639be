"""Contents of the documents: fenced blocks, commands and links; and checks that commands would be accepted."""

import importlib
import importlib.util
import re
import runpy
import shlex
import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from runtime.assets import PROJECT_ROOT
from sport import parser
from sport.commands import training

ROOT = PROJECT_ROOT
GUIDE = sorted((ROOT / "docs" / "guide").glob("*.md"))
DOCUMENTS = sorted(ROOT.glob("*.md")) + sorted((ROOT / "docs").rglob("*.md"))
DOCUMENTS += [*sorted((ROOT / "examples").glob("*.md")), ROOT / "assets" / "NOTICE.md"]
WITH_SUBCOMMANDS = ("training.evaluation", "benchmarks.study")
TRAINING = re.compile(rf"\btraining\.|^(?:python -m )?sport (?:{'|'.join(training.COMMANDS)})\b")
SETTING = re.compile(r"[A-Z_]+=\S*")  # a variable in front of a command


class Command(NamedTuple):
    """One command line of a document."""

    where: str
    line: str


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def blocks(path: Path, language: str) -> list[str]:
    """Return the fenced blocks of one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text_of(path), re.S | re.M)


def commands(path: Path) -> list[Command]:
    """Return all commands of the sh blocks, with continuation lines joined, without comments."""
    lines = "".join(blocks(path, "sh")).replace("\\\n", " ").splitlines()
    stripped = (shlex.join(shlex.split(line, comments=True)) for line in lines)
    return [Command(path.relative_to(ROOT).as_posix(), line) for line in stripped if line]


def cases(found: Iterable[Command]) -> list[Any]:
    """Return a test parameter per command; training commands are marked as needing torch."""
    marks = {True: [pytest.mark.needs_torch], False: []}
    return [pytest.param(*one, marks=marks[bool(TRAINING.search(one.line))]) for one in found]


def check_command(line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Check that program and options exist: `sport` by its parser, modules by the options in their help."""
    words = shlex.split(line)
    while words and SETTING.fullmatch(words[0]):
        words = words[1:]
    if words[0] == "torchrun":
        words = ["python", *words[words.index("-m") :]]
    if words[:3] == ["python", "-m", "sport"]:
        words = words[2:]
    if words[0] == "sport" and words[1:2] and words[1] in training.COMMANDS:
        module, flags = training.COMMANDS[words[1]][0], words[2:]
        flags = ["--text", *(f for f in flags if f != "--text")] if "--text" in flags else flags
        check_help(module, flags, monkeypatch, capsys)
    elif words[0] == "sport":
        parser.build_parser().parse_args(words[1:] or ["view"])
    elif words[:2] == ["python", "-m"]:
        check_help(words[2], words[3:], monkeypatch, capsys)
    else:
        known = "pip sudo git npm node .ci/run pytest ruff mypy python"
        assert words[0] in known.split(" "), line


def check_help(
    module: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Check that `python -m module` exists, and that its help contains all options of `arguments`."""
    assert importlib.util.find_spec(module) is not None, module
    options = [word.split("=")[0] for word in arguments if word.startswith("--")]
    if not options or importlib.util.find_spec(module.split(".")[0]) is None:
        return
    imported = importlib.import_module(module)
    program = importlib.import_module(f"{module}.__main__") if hasattr(imported, "__path__") else imported
    own = {"--text", "--courses"}  # of `sport evaluate`: each has its own help
    subcommand = options[:1] if options[0] in own else []
    if module in WITH_SUBCOMMANDS:
        subcommand = arguments[:1]
    monkeypatch.setattr(sys, "argv", [module, *subcommand, "--help"])
    # an experiment that is a program has no `main`
    run = getattr(program, "main", None) or partial(runpy.run_module, module, run_name="__main__")
    with pytest.raises(SystemExit):
        run()
    shown = set(re.findall(r"--[\w-]+", capsys.readouterr().out))
    assert set(options) <= shown | own, f"{module}: {set(options) - shown}"


def links(path: Path) -> list[str]:
    """Return targets of links and images to files of the repository, with their anchors."""
    text = re.sub(r"^```.*?^```", "", text_of(path), flags=re.S | re.M)
    return [target for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]


def anchors(path: Path) -> set[str]:
    """Return the anchors of a document's headings, as made by GitHub."""
    headings = re.findall(r"^#+ (.*)$", text_of(path), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}
