"""Compiles the GLSL shader files with defines; small helpers for moderngl."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import moderngl

from runtime.assets import PROJECT_ROOT
from runtime.errors import DisplayError
from runtime.safe_read import read_bounded

SHADER_ROOT = PROJECT_ROOT / "shaders"
FRAME_BINDING, JOINTS_BINDING = 0, 1  # of the uniform blocks in common.glsl and skinning.glsl
UPLOAD_BYTES = 4096  # per upload; a command of Mesa's thread holds 8192
MAX_BYTES = 1 << 20  # of a file
REMEDY = "Install the program again; if you edited this shader, correct that line."


def load_program(
    ctx: moderngl.Context, vertex: str, fragment: str, defines: Mapping[str, int] | None = None
) -> moderngl.Program:
    """Compile and link two shaders and bind their uniform blocks; FileError, or DisplayError with the compiler's message."""
    if not ctx.includes:
        ctx.includes.update({path.name: _read(path.name) for path in SHADER_ROOT.glob("*.glsl")})
    added = "".join(f"#define {name} {value}\n" for name, value in (defines or {}).items())
    # the version must be in the first line
    texts = [_read(name).replace("\n", f"\n{added}", 1) for name in (vertex, fragment)]
    try:
        program = ctx.program(vertex_shader=texts[0], fragment_shader=texts[1])
    except moderngl.Error as error:
        raise DisplayError(f"Shaders {vertex}, {fragment}: {error}", REMEDY) from error
    for name, binding in (("Frame", FRAME_BINDING), ("Joints", JOINTS_BINDING)):
        block = program.get(name, None)
        if isinstance(block, moderngl.UniformBlock):
            block.binding = binding
    return program


def _read(name: str) -> str:
    return read_bounded(SHADER_ROOT / name, MAX_BYTES, REMEDY).decode("utf-8")


def screen_triangle(ctx: moderngl.Context, fragment: str) -> moderngl.VertexArray:
    """Return a triangle that covers the frame at the far plane, for a fragment shader; render 3 vertices."""
    return ctx.vertex_array(load_program(ctx, "sky.vert", fragment), [])


def set_uniforms(program: moderngl.Program, values: Mapping[str, object]) -> None:
    """Set uniforms by value, arrays by their bytes; names that the compiler removed are ignored."""
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
    """Restrict drawing in the block to the pixels `box` (x, y, width, height; y up)."""
    framebuffer.scissor = box
    try:
        yield
    finally:
        framebuffer.scissor = None  # type: ignore[assignment]  # the stub omits that None ends it


def upload(buffer: moderngl.Buffer, data: bytes) -> None:
    """Replace a buffer's content in parts; larger parts would wait for Mesa's drawing thread."""
    buffer.orphan(len(data))
    for at in range(0, len(data), UPLOAD_BYTES):
        buffer.write(data[at : at + UPLOAD_BYTES], offset=at)


def shown_size(framebuffer: moderngl.Framebuffer) -> tuple[int, int]:
    """Return the size of a framebuffer in pixels; moderngl's `size` of a window's framebuffer never changes."""
    _, _, width, height = framebuffer.viewport
    return width, height


def release(*objects: Any) -> None:
    """Release GPU objects, including the programs of vertex arrays; None is ignored."""
    for item in objects:
        if isinstance(item, moderngl.VertexArray):
            item.program.release()
        if item is not None:
            item.release()
