"""Trajectory, contacts and skeleton: strokes on the ground, and strokes over everything."""

from __future__ import annotations

import moderngl

from viewer.render.gl import bind_blocks
from viewer.render.marks import STROKE, Strokes
from viewer.render.shaders import load_program


class OverlayPass:
    """Draws strokes and dots with soft edges."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._strokes = ctx.buffer(reserve=STROKE.itemsize, dynamic=True)
        layout = (self._strokes, "3f4 3f4 3f4 2f4 4f4 /i", *(f"in_{name}" for name in STROKE.names or ()))
        screen_layout = (
            self._strokes,
            "3f4 3f4 12x 2f4 4f4 /i",
            "in_start",
            "in_end",
            "in_radius",
            "in_color",
        )
        self._on_ground = bind_blocks(load_program(ctx, "stroke.vert", "stroke.frag", {"ON_GROUND": 1}))
        self._on_top = bind_blocks(load_program(ctx, "stroke.vert", "stroke.frag", {"ON_GROUND": 0}))
        self._ground_array = ctx.vertex_array(self._on_ground, [layout])
        self._top_array = ctx.vertex_array(self._on_top, [screen_layout])

    def draw_on_ground(self, strokes: Strokes) -> None:
        """Draw strokes whose radii are metres, hidden by what stands before them."""
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        self._ctx.depth_func = "<="
        self._draw(self._ground_array, strokes)

    def draw_on_top(self, strokes: Strokes) -> None:
        """Draw strokes whose radii are pixels, over everything."""
        self._ctx.enable_only(moderngl.BLEND)
        self._draw(self._top_array, strokes)

    def _draw(self, array: moderngl.VertexArray, strokes: Strokes) -> None:
        if len(strokes):
            self._ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
            self._strokes.orphan(strokes.nbytes)
            self._strokes.write(strokes.tobytes())
            array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(strokes))

    def release(self) -> None:
        """Free the GPU objects."""
        parts = (self._ground_array, self._top_array, self._on_ground, self._on_top, self._strokes)
        for part in parts:
            part.release()
