"""The images that passes draw into: the scene (scaled, multisampled) and the shadow map."""

from __future__ import annotations

import math

import moderngl

from viewer.render.gl import release, scissored, screen_triangle, shown_size
from viewer.render.quality import Quality


class ShadowMap:
    """Holds depths seen from the sun, in a texture that compares them as it is read."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._make(1)

    def begin(self, size: int) -> None:
        """Bind a cleared map of `size` texels a side, made anew when the size has changed."""
        if self.texture.size != (size, size):
            self.release()
            self._make(size)
        self.framebuffer.use()
        self.framebuffer.clear(depth=1.0)

    def _make(self, size: int) -> None:
        ctx = self._ctx
        self.texture = ctx.depth_texture((size, size))
        self.texture.compare_func = "<="
        self.texture.filter = moderngl.LINEAR, moderngl.LINEAR
        self.texture.repeat_x = self.texture.repeat_y = False
        self.framebuffer = ctx.framebuffer(depth_attachment=self.texture)

    def release(self) -> None:
        release(self.framebuffer, self.texture)


class SceneTarget:
    """Holds the scene's own image with depth, and copies it into the framebuffer that is shown."""

    def __init__(self, ctx: moderngl.Context, quality: Quality) -> None:
        self._ctx = ctx
        self._quality = quality
        self._samples = min(quality.msaa, ctx.max_samples)
        self._softens = bool(quality.smooth_edges) and not self._samples
        self._stretch = screen_triangle(ctx, "stretch.frag")
        self._smooth_edges = screen_triangle(ctx, "smooth_edges.frag")
        self._shown_size = (0, 0)
        self._make_images((1, 1))

    def _make_images(self, shown_size: tuple[int, int]) -> None:
        self._shown_size = shown_size
        size = scene_size(shown_size, self._quality)
        self._picture = self._ctx.texture(size, 4)  # the scene's colour, one sample a pixel
        self._resolved = self._ctx.framebuffer([self._picture])
        # the same with softened edges, to be stretched
        self._softened_picture = self._ctx.texture(size if self._softens else (1, 1), 4)
        self._softened = self._ctx.framebuffer([self._softened_picture])
        self._depth = self._ctx.depth_renderbuffer(size, samples=self._samples)
        self._color = self._ctx.renderbuffer(size, 4, samples=self._samples) if self._samples else None
        self._scene = self._ctx.framebuffer([self._color or self._picture], self._depth)

    def begin(self, shown_size: tuple[int, int]) -> moderngl.Framebuffer:
        """Return the scene's framebuffer for a frame of `shown_size` pixels, made anew when the size has changed."""
        if shown_size != self._shown_size:
            self._free_images()
            self._make_images(shown_size)
        return self._scene

    def present(self, target: moderngl.Framebuffer, edges: tuple[int, int, int, int]) -> None:
        """Copy or stretch the scene into `target`; soften edges in the scene's pixels `edges` (x, y, w, h)."""
        if self._samples:
            self._ctx.copy_framebuffer(self._resolved, self._scene)
        softens = self._softens and edges[2] * edges[3] > 0
        fits = self._scene.size == shown_size(target)
        flat = target if fits else self._softened  # before it is stretched, or every step would be larger
        if fits or softens:  # not from the scene itself: its depth might not fit the target's
            self._ctx.copy_framebuffer(flat, self._resolved)
        if softens:
            self._soften_into(flat, edges)
        target.use()
        if not fits:
            self._ctx.enable_only(moderngl.NOTHING)
            (self._softened_picture if softens else self._picture).use(0)
            self._stretch.render(moderngl.TRIANGLES, vertices=3)

    def _soften_into(self, target: moderngl.Framebuffer, edges: tuple[int, int, int, int]) -> None:
        """Draw the picture with softened edges into the pixels `edges` of a target of its size."""
        target.use()
        self._ctx.enable_only(moderngl.NOTHING)
        self._picture.use(0)
        with scissored(target, edges):
            self._smooth_edges.render(moderngl.TRIANGLES, vertices=3)

    def _free_images(self) -> None:
        release(self._scene, self._resolved, self._softened)
        release(self._picture, self._softened_picture, self._depth, self._color)

    def release(self) -> None:
        self._free_images()
        release(self._stretch, self._smooth_edges)


def scene_size(shown_size: tuple[int, int], quality: Quality) -> tuple[int, int]:
    """Return how many pixels to render, in x and y, for a frame of `shown_size` pixels."""
    width, height = (side * quality.render_scale for side in shown_size)
    if quality.max_pixels and width * height > quality.max_pixels:
        shrink = math.sqrt(quality.max_pixels / (width * height))
        width, height = width * shrink, height * shrink
    return max(round(width), 1), max(round(height), 1)
