"""GLSL sources: `#include "file"`, defines, and compiler errors that name file and line.

GLSL knows files only by number. Each included text is numbered with a `#line` directive, and the compiler's
messages are translated back.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import moderngl

from runtime.assets import PROJECT_ROOT
from runtime.errors import DisplayError, FileError

SHADER_ROOT = PROJECT_ROOT / "shaders"
REMEDY = "Install the program again; if you edited this shader, correct that line."

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
_VERSION = re.compile(r"^\s*#version\b.*$", re.MULTILINE)
# Mesa "2:14(9): error: ...", NVIDIA "2(14) : error ...", AMD and Apple "ERROR: 2:14: ..."
_LOCATION = re.compile(r"(?:ERROR:\s*)?\b(\d+)(?::(\d+)(?:\(\d+\))?|\((\d+)\))\s*:")


@dataclass
class ShaderSource:
    """One preprocessed stage: its text and the files it came from, by source number."""

    text: str
    files: list[str] = field(default_factory=list)

    def translate(self, log: str) -> str:
        """Replace the compiler's source numbers in `log` by `file:line`."""

        def located(match: re.Match[str]) -> str:
            number, line = int(match[1]), match[2] or match[3]
            return f"{self.files[number]}:{line}:" if number < len(self.files) else match[0]

        return _LOCATION.sub(located, log)


def preprocess(name: str, root: Path = SHADER_ROOT, defines: Mapping[str, int] | None = None) -> ShaderSource:
    """Resolve includes (each file once) of `root / name`; FileError for a missing file, naming who asked for it."""
    source = ShaderSource("")
    body = _expand(name, root, source, asked_by=name)
    if not _VERSION.match(body):
        raise FileError(f"{root / name}:1: expected #version in the first line.", REMEDY)
    version, _, rest = body.partition("\n")
    lines = [version, *(f"#define {key} {value}" for key, value in (defines or {}).items()), "#line 2 0", rest]
    source.text = "\n".join(lines)
    return source


def _expand(name: str, root: Path, source: ShaderSource, asked_by: str) -> str:
    try:
        text = (root / name).read_text(encoding="utf-8")
    except OSError as error:
        raise FileError(f"{asked_by}: the shader file {root / name} cannot be read ({error}).", REMEDY) from error
    number = len(source.files)
    source.files.append(name)
    lines: list[str] = []
    for line_number, line in enumerate(text.splitlines(), start=1):
        include = _INCLUDE.match(line)
        if include is None:
            lines.append(line)
        elif include[1] in source.files:
            lines.append("")  # already there
        else:
            inner = len(source.files)
            lines.append(f"#line 1 {inner}")
            lines.append(_expand(include[1], root, source, f"{name}:{line_number}"))
            lines.append(f"#line {line_number + 1} {number}")
    return "\n".join(lines)


def load_program(
    ctx: moderngl.Context,
    vertex: str,
    fragment: str,
    defines: Mapping[str, int] | None = None,
    root: Path = SHADER_ROOT,
) -> moderngl.Program:
    """Compile and link two files of `root`; DisplayError with file, line and the compiler's words."""
    stages = [preprocess(vertex, root, defines), preprocess(fragment, root, defines)]
    try:
        program = ctx.program(vertex_shader=stages[0].text, fragment_shader=stages[1].text)
    except moderngl.Error as error:
        log = str(error)
        failed = stages[1] if "fragment_shader" in log else stages[0]
        raise DisplayError(f"Shader {failed.files[0]}: {failed.translate(log).strip()}", REMEDY) from error
    return program
