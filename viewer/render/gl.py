"""Small helpers over moderngl that several passes need."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import moderngl

from viewer.render.shaders import load_program


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
