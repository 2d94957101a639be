"""Render targets: the scene (scaled, multisampled) and the shadow map."""

import math

import moderngl

from viewer.render.gl import release, scissored, screen_triangle, shown_size
from viewer.render.quality import Quality

Box = tuple[int, int, int, int]  # pixels: x, y (up), width, height


class ShadowMap:
    """The depth texture as seen from the sun; shaders read it with a comparison."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._make(1)

    def begin(self, size: int) -> None:
        """Bind and clear the map with `size` texels a side, recreated if the size changed."""
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
    """The scene's framebuffer with depth, copied to the shown framebuffer at the end."""

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
        self._picture = self._ctx.texture(size, 4)  # the scene's colour, one sample per pixel
        self._picture.repeat_x = self._picture.repeat_y = False
        self._resolved = self._ctx.framebuffer([self._picture])
        # the same with smoothed edges, to be upscaled
        self._softened_picture = self._ctx.texture(size if self._softens else (1, 1), 4)
        self._softened_picture.repeat_x = self._softened_picture.repeat_y = False
        self._softened = self._ctx.framebuffer([self._softened_picture])
        self._depth = self._ctx.depth_renderbuffer(size, samples=self._samples)
        self._color = self._ctx.renderbuffer(size, 4, samples=self._samples) if self._samples else None
        self._scene = self._ctx.framebuffer([self._color or self._picture], self._depth)

    def begin(self, shown_size: tuple[int, int]) -> moderngl.Framebuffer:
        """Return the scene's framebuffer for a frame of `shown_size` pixels, recreated if the size changed."""
        if shown_size != self._shown_size:
            self._free_images()
            self._make_images(shown_size)
        return self._scene

    def present(self, target: moderngl.Framebuffer, edges: Box) -> None:
        """Copy the scene into the target, scaled if it is smaller, smoothing edges within the scene's pixel box `edges`."""
        if self._samples:
            self._ctx.copy_framebuffer(self._resolved, self._scene)
        self._ctx.enable_only(moderngl.NOTHING)
        width, height = shown_size(target)
        fits, softens = self._scene.size == (width, height), self._softens and edges[2] * edges[3] > 0
        if softens and not fits:  # before upscaling, which would enlarge the steps
            self._draw(self._smooth_edges, self._softened, edges)
        # no blit, since that waits for Mesa's drawing thread
        self._draw(self._stretch, target)
        if not softens:
            return
        if fits:
            self._draw(self._smooth_edges, target, edges)
            return
        self._softened_picture.use(0)
        target.use()
        x, y, right, top = edges[0] + 1, edges[1] + 1, edges[0] + edges[2] - 1, edges[1] + edges[3] - 1
        across, up = width / self._scene.size[0], height / self._scene.size[1]
        left, low = round(x * across), round(y * up)
        inside = left, low, max(round(right * across) - left, 0), max(round(top * up) - low, 0)
        with scissored(target, inside):
            self._stretch.render(moderngl.TRIANGLES, vertices=3)

    def _draw(self, how: moderngl.VertexArray, target: moderngl.Framebuffer, box: Box | None = None) -> None:
        """Draw the scene's picture by a program into a target, or into the pixels `box` of it."""
        self._picture.use(0)
        target.use()
        with scissored(target, box or (0, 0, *shown_size(target))):
            how.render(moderngl.TRIANGLES, vertices=3)

    def _free_images(self) -> None:
        release(self._scene, self._resolved, self._softened)
        release(self._picture, self._softened_picture, self._depth, self._color)

    def release(self) -> None:
        self._free_images()
        release(self._stretch, self._smooth_edges)


def scene_size(shown_size: tuple[int, int], quality: Quality) -> tuple[int, int]:
    """Return the render size in pixels (x, y) for a frame of `shown_size` pixels."""
    width, height = (side * quality.render_scale for side in shown_size)
    if quality.max_pixels and width * height > quality.max_pixels:
        shrink = math.sqrt(quality.max_pixels / (width * height))
        width, height = width * shrink, height * shrink
    return max(round(width), 1), max(round(height), 1)
