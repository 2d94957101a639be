"""Shaders: files that are missing or wrong are named."""

from collections.abc import Iterator
from pathlib import Path

import moderngl
import pytest

from runtime.errors import DisplayError, FileError
from viewer.render import gl
from viewer.render.gl import load_program
from viewer.render.offscreen import create_offscreen_context


@pytest.fixture
def ctx() -> Iterator[moderngl.Context]:
    context = create_offscreen_context()
    yield context
    context.release()


def test_a_shader_that_is_missing_or_wrong_is_named(
    ctx: moderngl.Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gl, "SHADER_ROOT", tmp_path)
    (tmp_path / "half.glsl").write_text("float half_of(float x) { return SCALE * x; }\n")
    text = '#version 330\n#include "half.glsl"\nvoid main() { gl_Position = vec4(half_of(2.0)); }\n'
    (tmp_path / "a.vert").write_text(text)
    with pytest.raises(FileError, match=r"a\.frag"):
        load_program(ctx, "a.vert", "a.frag", {"SCALE": 1})
    (tmp_path / "a.frag").write_text("#version 330\nout vec4 color;\nvoid main() { color = vec4(SCALE); }\n")
    load_program(ctx, "a.vert", "a.frag", {"SCALE": 1}).release()
    with pytest.raises(DisplayError, match=r"(?s)a\.vert, a\.frag: .*SCALE"):
        load_program(ctx, "a.vert", "a.frag")
