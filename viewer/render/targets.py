"""The pictures that passes draw into: the scene (scaled, multisampled) and the shadow map."""

from __future__ import annotations

import moderngl

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
        self._color_only: moderngl.Framebuffer | None = None  # a blit would copy depth too, which may not match
        self._program = load_program(ctx, "sky.vert", "stretch.frag")
        self._triangle = ctx.vertex_array(self._program, [])

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

    def present(self, target: moderngl.Framebuffer) -> None:
        """Copy, resolve or stretch the scene into `target`."""
        assert self._framebuffer is not None and self._color_only is not None
        if self._framebuffer.size == target.size:
            self._ctx.copy_framebuffer(target, self._color_only)
            target.use()
        else:
            target.use()
            assert isinstance(self._color, moderngl.Texture)
            self._ctx.disable(moderngl.DEPTH_TEST | moderngl.BLEND | moderngl.CULL_FACE)
            self._color.use(0)
            self._program["scene"].value = 0
            self._triangle.render(moderngl.TRIANGLES, vertices=3)

    def _free(self) -> None:
        for item in (self._color_only, self._framebuffer, self._depth, self._color):
            if item is not None:
                item.release()

    def release(self) -> None:
        """Free the GPU objects."""
        self._free()
        self._triangle.release()
        self._program.release()
