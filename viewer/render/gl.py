"""Small helpers over moderngl that several passes need."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import moderngl

FRAME_BINDING = 0  # uniform block `Frame` of common.glsl
JOINTS_BINDING = 1  # uniform block `Joints` of skinning.glsl


def bind_blocks(program: moderngl.Program) -> moderngl.Program:
    """Connect the uniform blocks that a program has to their shared binding points."""
    for name, binding in (("Frame", FRAME_BINDING), ("Joints", JOINTS_BINDING)):
        block = program.get(name, None)
        if isinstance(block, moderngl.UniformBlock):
            block.binding = binding
    return program


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
