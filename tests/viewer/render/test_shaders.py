"""The include mechanism, and compiler errors that name file and line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import moderngl
import pytest

from runtime.errors import DisplayError, FileError
from viewer.render.gl import ShaderSource, load_program, preprocess
from viewer.render.offscreen import create_offscreen_context


@pytest.fixture(scope="module")
def ctx() -> Iterator[moderngl.Context]:
    context = create_offscreen_context()
    yield context
    context.release()


def write(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        (folder / f"{name}.glsl").write_text(text)
    return folder


def test_each_file_is_included_once_and_defines_follow_the_version(tmp_path: Path) -> None:
    root = write(
        tmp_path,
        main='#version 330\n#include "a.glsl"\n#include "b.glsl"\nvoid main() {}\n',
        a='#include "b.glsl"\nfloat a;\n',
        b="float b;\n",
    )
    source = preprocess("main.glsl", root, {"TAPS": 3})
    assert source.lines == ["#version 330", "#define TAPS 3", "float b;", "float a;", "void main() {}"]
    assert source.origins[2:] == [("b.glsl", 1), ("a.glsl", 2), ("main.glsl", 4)]


def test_a_missing_include_names_who_asked(tmp_path: Path) -> None:
    root = write(tmp_path, main='#version 330\n\n#include "gone.glsl"\n')
    with pytest.raises(FileError, match=r"main\.glsl:3.*gone\.glsl"):
        preprocess("main.glsl", root)


def test_an_error_in_an_included_file_names_that_file_and_line(tmp_path: Path, ctx: moderngl.Context) -> None:
    root = write(
        tmp_path,
        vertex="#version 330\nvoid main() { gl_Position = vec4(0.0); }\n",
        fragment='#version 330\n\n#include "paint.glsl"\nout vec4 c;\nvoid main() { c = paint(); }\n',
        paint="// paint\n\nvec4 paint() { return unknown_name; }\n",
    )
    with pytest.raises(DisplayError, match=r"paint\.glsl:3:.*unknown_name"):
        load_program(ctx, "vertex.glsl", "fragment.glsl", root=root)


def test_an_error_after_an_include_has_the_right_line(tmp_path: Path, ctx: moderngl.Context) -> None:
    root = write(
        tmp_path,
        vertex='#version 330\n#include "a.glsl"\n\nvoid main() { gl_Position = wrong_here; }\n',
        fragment="#version 330\nvoid main() {}\n",
        a="float a;\nfloat b;\nfloat c;\n",
    )
    with pytest.raises(DisplayError, match=r"vertex\.glsl:4:"):
        load_program(ctx, "vertex.glsl", "fragment.glsl", root=root, defines={"SOME": 1})


@pytest.mark.parametrize(
    ("log", "expected"),
    [
        ("0:2(3): error: x", "b.glsl:7: error: x"),
        ("0(2) : error C1503: x", "b.glsl:7: error C1503: x"),
        ("ERROR: 0:1: 'x' : undeclared", "a.vert:1: 'x' : undeclared"),
        ("0:99(1): error: x", "0:99(1): error: x"),
    ],
)
def test_messages_of_three_drivers_are_translated(log: str, expected: str) -> None:
    assert ShaderSource(["", ""], [("a.vert", 1), ("b.glsl", 7)]).translate(log) == expected
