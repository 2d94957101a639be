"""Trajectory, contacts and skeleton: strokes on the ground, and strokes over everything."""

from __future__ import annotations

import moderngl

from viewer.render.gl import release
from viewer.render.marks import STROKE, Strokes
from viewer.render.shaders import load_program


class OverlayPass:
    """Draws strokes and dots with soft edges."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._strokes = ctx.buffer(reserve=STROKE.itemsize, dynamic=True)
        layout = (self._strokes, "3f4 3f4 3f4 2f4 4f4 /i", *(f"in_{name}" for name in STROKE.names or ()))
        top_layout = (self._strokes, "3f4 3f4 12x 2f4 4f4 /i", "in_start", "in_end", "in_radius", "in_color")
        on_ground, on_top = (
            load_program(ctx, "stroke.vert", "stroke.frag", {"ON_GROUND": flag}) for flag in (1, 0)
        )
        self._on_ground = ctx.vertex_array(on_ground, [layout])
        self._on_top = ctx.vertex_array(on_top, [top_layout])

    def draw_on_ground(self, strokes: Strokes) -> None:
        """Draw strokes whose radii are metres, hidden by what stands before them."""
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        self._ctx.depth_func = "<="
        self._draw(self._on_ground, strokes)

    def draw_on_top(self, strokes: Strokes) -> None:
        """Draw strokes whose radii are pixels, over everything."""
        self._ctx.enable_only(moderngl.BLEND)
        self._draw(self._on_top, strokes)

    def _draw(self, array: moderngl.VertexArray, strokes: Strokes) -> None:
        if len(strokes):
            self._ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
            self._strokes.orphan(strokes.nbytes)
            self._strokes.write(strokes.tobytes())
            array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(strokes))

    def release(self) -> None:
        """Free the GPU objects."""
        release(self._on_ground, self._on_top, self._strokes)
