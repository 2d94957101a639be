"""GLSL sources with includes, defines and errors that name file and line; small helpers over moderngl."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import moderngl

from runtime.assets import PROJECT_ROOT
from runtime.errors import DisplayError, FileError

SHADER_ROOT = PROJECT_ROOT / "shaders"
FRAME_BINDING, JOINTS_BINDING = 0, 1  # of the uniform blocks in common.glsl and skinning.glsl
REMEDY = "Install the program again; if you edited this shader, correct that line."

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
_VERSION = re.compile(r"^\s*#version\b")
# Mesa "0:14(9): error: ...", NVIDIA "0(14) : error ...", AMD and Apple "ERROR: 0:14: ..."
_LOCATION = re.compile(r"(?:ERROR:\s*)?\b\d+(?::(\d+)(?:\(\d+\))?|\((\d+)\))\s*:")


@dataclass
class ShaderSource:
    """One preprocessed stage: its lines, and file and line number that each came from."""

    lines: list[str] = field(default_factory=list)
    origins: list[tuple[str, int]] = field(default_factory=list)

    @property
    def text(self) -> str:
        return "\n".join(self.lines) + "\n"

    def add(self, line: str, file: str, number: int) -> None:
        """Append a line that stands at `file:number`."""
        self.lines.append(line)
        self.origins.append((file, number))

    def translate(self, log: str) -> str:
        """Replace the compiler's line numbers in `log` by `file:line`."""

        def located(match: re.Match[str]) -> str:
            line = int(match[1] or match[2])
            if not 1 <= line <= len(self.origins):
                return match[0]
            file, number = self.origins[line - 1]
            return f"{file}:{number}:"

        return _LOCATION.sub(located, log)


def preprocess(name: str, root: Path = SHADER_ROOT, defines: Mapping[str, int] | None = None) -> ShaderSource:
    """Resolve includes (each file once) of `root / name`; FileError for a missing file, naming what includes it."""
    source = ShaderSource()
    _expand(name, root, source, {name}, included_by=name)
    if not source.lines or not _VERSION.match(source.lines[0]):
        raise FileError(f"{root / name}:1: expected #version in the first line.", REMEDY)
    for key, value in (defines or {}).items():
        source.lines.insert(1, f"#define {key} {value}")
        source.origins.insert(1, (name, 1))
    return source


def _expand(name: str, root: Path, source: ShaderSource, seen: set[str], included_by: str) -> None:
    try:
        text = (root / name).read_text(encoding="utf-8")
    except OSError as error:
        raise FileError(
            f"{included_by}: the shader file {root / name} cannot be read ({error}).", REMEDY
        ) from error
    for number, line in enumerate(text.splitlines(), start=1):
        include = _INCLUDE.match(line)
        if include is None:
            source.add(line, name, number)
        elif include[1] not in seen:
            seen.add(include[1])
            _expand(include[1], root, source, seen, f"{name}:{number}")


def load_program(
    ctx: moderngl.Context,
    vertex: str,
    fragment: str,
    defines: Mapping[str, int] | None = None,
    root: Path = SHADER_ROOT,
) -> moderngl.Program:
    """Compile and link two files of `root`, and bind their uniform blocks; DisplayError with file, line and the compiler's words."""
    stages = [preprocess(vertex, root, defines), preprocess(fragment, root, defines)]
    try:
        program = ctx.program(vertex_shader=stages[0].text, fragment_shader=stages[1].text)
    except moderngl.Error as error:
        log = str(error)
        failed = stages[1] if "fragment_shader" in log else stages[0]
        raise DisplayError(
            f"Shader {failed.origins[0][0]}: {failed.translate(log).strip()}", REMEDY
        ) from error
    for name, binding in (("Frame", FRAME_BINDING), ("Joints", JOINTS_BINDING)):
        block = program.get(name, None)
        if isinstance(block, moderngl.UniformBlock):
            block.binding = binding
    return program


def screen_triangle(ctx: moderngl.Context, fragment: str) -> moderngl.VertexArray:
    """One triangle over the whole frame, at the far plane, with a fragment shader; render 3 vertices."""
    return ctx.vertex_array(load_program(ctx, "sky.vert", fragment), [])


def set_uniforms(program: moderngl.Program, values: Mapping[str, object]) -> None:
    """Set uniforms by value, arrays by their bytes; names that the compiler has removed are passed over."""
    for name, value in values.items():
        uniform = program.get(name, None)
        if not isinstance(uniform, moderngl.Uniform):
            continue
        if isinstance(value, bytes):
            uniform.write(value)
        else:
            uniform.value = value


@contextmanager
def scissored(framebuffer: moderngl.Framebuffer, box: tuple[int, int, int, int]) -> Iterator[None]:
    """Draw only into the pixels `box` (x, y, width, height; y up)."""
    framebuffer.scissor = box
    try:
        yield
    finally:
        framebuffer.scissor = None  # type: ignore[assignment]  # the stub omits that None ends it


def shown_size(framebuffer: moderngl.Framebuffer) -> tuple[int, int]:
    """Pixels that are drawn into: of a window's own framebuffer `size` stays what it was when the window opened."""
    _, _, width, height = framebuffer.viewport
    return width, height


def release(*objects: Any) -> None:
    """Free GPU objects, and the programs of vertex arrays; None is passed over."""
    for item in objects:
        if isinstance(item, moderngl.VertexArray):
            item.program.release()
        if item is not None:
            item.release()
