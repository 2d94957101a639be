"""The pictures that passes draw into: the scene (scaled, multisampled) and the shadow map."""

from __future__ import annotations

import moderngl

from viewer.render.gl import scissored, set_uniforms
from viewer.render.quality import Quality
from viewer.render.shaders import load_program


class ShadowMap:
    """A depth texture seen from the sun, compared when it is read."""

    def __init__(self, ctx: moderngl.Context, size: int) -> None:
        self.texture = ctx.depth_texture((size, size))
        self.texture.compare_func = "<="
        self.texture.filter = moderngl.LINEAR, moderngl.LINEAR
        self.texture.repeat_x = self.texture.repeat_y = False
        self.framebuffer = ctx.framebuffer(depth_attachment=self.texture)

    def release(self) -> None:
        """Free the GPU objects."""
        self.framebuffer.release()
        self.texture.release()


class SceneTarget:
    """The scene's own picture with depth, and its way into the framebuffer that is shown."""

    def __init__(self, ctx: moderngl.Context, quality: Quality) -> None:
        self._ctx = ctx
        self._samples = min(quality.msaa, ctx.max_samples)
        self._scale = quality.render_scale
        self._shown_size = (0, 0)
        self._color: moderngl.Texture | moderngl.Renderbuffer | None = None
        self._depth: moderngl.Renderbuffer | None = None
        self._framebuffer: moderngl.Framebuffer | None = None
        self._color_only: moderngl.Framebuffer | None = (
            None  # a blit would copy depth too, which may not match
        )
        self._smooth = quality.smooth_edges and not self._samples
        self._programs = [
            load_program(ctx, "sky.vert", name) for name in ("stretch.frag", "smooth_edges.frag")
        ]
        self._stretch, self._soften = (ctx.vertex_array(program, []) for program in self._programs)

    def begin(self, shown_size: tuple[int, int]) -> moderngl.Framebuffer:
        """The scene's framebuffer for a picture of `shown_size` pixels, made anew when the size has changed."""
        if self._framebuffer is None or shown_size != self._shown_size:
            self._free()
            self._shown_size = shown_size
            size = (max(round(shown_size[0] * self._scale), 1), max(round(shown_size[1] * self._scale), 1))
            if self._samples:
                self._color = self._ctx.renderbuffer(size, 4, samples=self._samples)
            else:
                self._color = self._ctx.texture(size, 4)
            self._depth = self._ctx.depth_renderbuffer(size, samples=self._samples)
            self._framebuffer = self._ctx.framebuffer([self._color], self._depth)
            self._color_only = self._ctx.framebuffer([self._color])
        return self._framebuffer

    def present(self, target: moderngl.Framebuffer, edges: tuple[int, int, int, int]) -> None:
        """Copy, resolve or stretch the scene into `target`; soften edges in the scene's pixels `edges` (x, y, w, h)."""
        assert self._framebuffer is not None
        assert self._color_only is not None
        same_size = self._framebuffer.size == target.size
        if same_size:
            self._ctx.copy_framebuffer(target, self._color_only)
        target.use()
        self._ctx.enable_only(moderngl.NOTHING)
        if isinstance(self._color, moderngl.Texture):
            self._color.use(0)
            if not same_size:
                self._stretch.render(moderngl.TRIANGLES, vertices=3)
            elif self._smooth and edges[2] * edges[3] > 0:
                set_uniforms(self._programs[1], {"texel": (1 / target.width, 1 / target.height)})
                with scissored(target, edges):
                    self._soften.render(moderngl.TRIANGLES, vertices=3)

    def _free(self) -> None:
        for item in (self._color_only, self._framebuffer, self._depth, self._color):
            if item is not None:
                item.release()

    def release(self) -> None:
        """Free the GPU objects."""
        self._free()
        for array in (self._stretch, self._soften):
            array.release()
        for program in self._programs:
            program.release()
