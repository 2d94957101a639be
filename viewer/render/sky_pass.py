"""The background: a gradient from the horizon, which is also the colour of the fog, to the zenith."""

from __future__ import annotations

import moderngl

from viewer.render.gl import bind_blocks
from viewer.render.shaders import load_program


class SkyPass:
    """Fills what nothing else has covered."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._program = bind_blocks(load_program(ctx, "sky.vert", "sky.frag"))
        self._vertices = ctx.vertex_array(self._program, [])

    def draw(self) -> None:
        """Draw at the far plane; call it after the opaque passes."""
        self._ctx.enable_only(moderngl.DEPTH_TEST)
        self._ctx.depth_func = "<="
        self._vertices.render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Free the GPU objects."""
        self._vertices.release()
        self._program.release()
