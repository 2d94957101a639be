"""The images that passes draw into: the scene (scaled, multisampled) and the shadow map."""

from __future__ import annotations

import math

import moderngl

from viewer.render.gl import scissored, set_uniforms, shown_size
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
    """The scene's own image with depth, and its way into the framebuffer that is shown."""

    def __init__(self, ctx: moderngl.Context, quality: Quality) -> None:
        self._ctx = ctx
        self._quality = quality
        self._samples = min(quality.msaa, ctx.max_samples)
        self._softens = quality.smooth_edges and not self._samples
        self._shown_size = (0, 0)
        self._scene: moderngl.Framebuffer | None = None
        self._resolved: moderngl.Framebuffer | None = None  # its colour alone, one sample a pixel
        self._picture: moderngl.Texture | None = None  # that colour, to read
        self._softened: moderngl.Framebuffer | None = None  # the same with softened edges, to be stretched
        self._soft_picture: moderngl.Texture | None = None
        self._attachments: list[moderngl.Texture | moderngl.Renderbuffer] = []
        self._programs = [
            load_program(ctx, "sky.vert", name) for name in ("stretch.frag", "smooth_edges.frag")
        ]
        self._stretch, self._soften_array = (ctx.vertex_array(program, []) for program in self._programs)

    def begin(self, shown_size: tuple[int, int]) -> moderngl.Framebuffer:
        """The scene's framebuffer for a frame of `shown_size` pixels, made anew when the size has changed."""
        if self._scene is None or shown_size != self._shown_size:
            self._free()
            self._shown_size = shown_size
            size = scene_size(shown_size, self._quality)
            self._picture = self._ctx.texture(size, 4)
            depth = self._ctx.depth_renderbuffer(size, samples=self._samples)
            color = self._ctx.renderbuffer(size, 4, samples=self._samples) if self._samples else self._picture
            self._attachments = [self._picture, depth, *([color] if self._samples else [])]
            self._scene = self._ctx.framebuffer([color], depth)
            self._resolved = self._ctx.framebuffer([self._picture])
            if self._softens and size != shown_size:
                self._soft_picture = self._ctx.texture(size, 4)
                self._attachments.append(self._soft_picture)
                self._softened = self._ctx.framebuffer([self._soft_picture])
        return self._scene

    def present(self, target: moderngl.Framebuffer, edges: tuple[int, int, int, int]) -> None:
        """Copy or stretch the scene into `target`; soften edges in the scene's pixels `edges` (x, y, w, h)."""
        assert self._scene is not None
        assert self._resolved is not None
        assert self._picture is not None
        if self._samples:
            self._ctx.copy_framebuffer(self._resolved, self._scene)
        softens = self._softens and edges[2] * edges[3] > 0
        if self._scene.size == shown_size(
            target
        ):  # not from the scene itself: its depth might not fit the target's
            self._ctx.copy_framebuffer(target, self._resolved)
            if softens:
                self._soften_into(target, edges)
            target.use()
            return
        picture = self._picture
        if softens and self._softened is not None:  # before it is stretched, or every step would be larger
            self._ctx.copy_framebuffer(self._softened, self._resolved)
            self._soften_into(self._softened, edges)
            assert self._soft_picture is not None
            picture = self._soft_picture
        target.use()
        self._ctx.enable_only(moderngl.NOTHING)
        picture.use(0)
        self._stretch.render(moderngl.TRIANGLES, vertices=3)

    def _soften_into(self, target: moderngl.Framebuffer, edges: tuple[int, int, int, int]) -> None:
        """Draw the picture with softened edges into the pixels `edges` of a target of its size."""
        assert self._picture is not None
        target.use()
        self._ctx.enable_only(moderngl.NOTHING)
        self._picture.use(0)
        width, height = shown_size(target)
        set_uniforms(self._programs[1], {"texel": (1 / width, 1 / height)})
        with scissored(target, edges):
            self._soften_array.render(moderngl.TRIANGLES, vertices=3)

    def _free(self) -> None:
        for framebuffer in (self._scene, self._resolved, self._softened):
            if framebuffer is not None:
                framebuffer.release()
        self._softened = None
        for attachment in self._attachments:
            attachment.release()

    def release(self) -> None:
        """Free the GPU objects."""
        self._free()
        for array in (self._stretch, self._soften_array):
            array.release()
        for program in self._programs:
            program.release()


def scene_size(shown_size: tuple[int, int], quality: Quality) -> tuple[int, int]:
    """Pixels to render for a frame of `shown_size` pixels."""
    width, height = (side * quality.render_scale for side in shown_size)
    if quality.max_pixels and width * height > quality.max_pixels:
        shrink = math.sqrt(quality.max_pixels / (width * height))
        width, height = width * shrink, height * shrink
    return max(round(width), 1), max(round(height), 1)
