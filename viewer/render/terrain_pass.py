"""The ground: keeps the window of the height map on the GPU and draws the triangles in view."""

import moderngl
import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.terrain.height_map import Terrain
from viewer.render.frame import SHADOW_REACH_M, SUN_DIRECTION, RenderFrame
from viewer.render.gl import load_program, release, scissored, set_uniforms, upload
from viewer.render.quality import Quality
from viewer.render.terrain_mesh import APRON_M, Levels, TerrainMesh, cut_window

RECENTRE_FRACTION = 0.12  # of the window's size
# flatter ground casts no shadow on itself
SUN_SLOPE_RATIO = SUN_DIRECTION[1] / np.hypot(*SUN_DIRECTION[::2])
MIN_RELIEF_M, MAX_RELIEF_M = 0.25, 3.0  # height above the start at which the tint is full
# rise over run; between them a ground is drawn as a meadow, else as a studio floor
LEVEL_SLOPE_RATIO, MEADOW_SLOPE_RATIO = 0.02, 1.5
NOISE_TEXELS, NOISE_SEED = 256, 7
PATCH_TEXELS, GRAIN_TEXELS = (2.0, 4.0, 9.0, 20.0), (0.6, 1.2, 2.5)  # sizes of the noise's features
LAYOUTS = {  # vertex attributes that each program reads
    "surface": ("1f4 2f2 1f2 2x", "in_height", "in_slope", "in_relief"),
    "depth": ("1f4 8x", "in_height"),
    "shadow": ("1f4 2f2 4x", "in_height", "in_slope"),
    "contact": ("1f4 8x", "in_height"),
}


class TerrainPass:
    """Draws the ground, its part of the shadow map, and the shadows on it."""

    def __init__(self, ctx: moderngl.Context, quality: Quality) -> None:
        self._ctx = ctx
        self._casts = quality.terrain_casts_shadow
        self.shadow_reach_m = 0.0  # extent of the ground's shadows around the characters
        self._max_triangles = 2 * quality.grid_resolution**2
        taps = {"SHADOW_TAPS": quality.shadow_taps}
        self._programs = {
            "surface": load_program(ctx, "terrain.vert", "terrain.frag"),
            "depth": load_program(ctx, "shadow_terrain.vert", "depth_only.frag"),
            "shadow": load_program(ctx, "terrain.vert", "ground_shadow.frag", taps),
            "contact": load_program(ctx, "terrain.vert", "ground_contact.frag"),
        }
        self._noise = _noise_texture(ctx)
        self._indices = ctx.buffer(reserve=4, dynamic=True)
        self._vertices: moderngl.Buffer | None = None
        self._arrays: dict[str, moderngl.VertexArray] = {}
        self._terrain: Terrain | None = None
        self._level = 0.0, 1.0  # see terrain.frag
        self._mesh: TerrainMesh | None = None
        self._levels: Levels
        self._visible: NDArray[np.bool_]

    def set_terrain(self, terrain: Terrain) -> None:
        """Use another height map from the next frame on."""
        self._terrain = terrain
        self.shadow_reach_m = SHADOW_REACH_M if self._casts and terrain.steepest > SUN_SLOPE_RATIO else 0.0
        self._mesh = None
        start = float(terrain.height(0.0, 0.0))
        highest = float(np.max(np.abs(terrain.heights - start), initial=MIN_RELIEF_M))
        self._level = start, 1.0 / min(highest, MAX_RELIEF_M)

    def prepare(self, frame: RenderFrame, focus: Array) -> None:
        """Re-centre the window on `focus` (x, z) for large terrains, and choose levels of detail."""
        if self._terrain is None:
            return
        mesh = self._mesh
        if mesh is None or self._far_off(mesh, focus):
            mesh = self._mesh = TerrainMesh(cut_window(self._terrain, focus))
            self._upload(mesh)
        self._visible = mesh.visible(frame.view_projection)
        self._levels = mesh.levels(frame.eye, frame.radians_per_pixel, self._visible, self._max_triangles)

    @staticmethod
    def _far_off(mesh: TerrainMesh, focus: Array) -> bool:
        window = mesh.window
        span = window.cell_m * min(window.heights.shape)
        return not window.whole and float(np.max(np.abs(focus - window.centre))) > RECENTRE_FRACTION * span

    def _upload(self, mesh: TerrainMesh) -> None:
        window = mesh.window
        packed = np.zeros(
            window.heights.size, np.dtype([("height", "<f4"), ("slope", "<f2", 2), ("relief", "<f2", 2)])
        )
        packed["height"] = window.heights.ravel()
        packed["slope"] = window.slopes.reshape(-1, 2)
        packed["relief"][:, 0] = window.relief.ravel()
        for old in (*self._arrays.values(), self._vertices):  # not their programs
            if old is not None:
                old.release()
        self._vertices = self._ctx.buffer(packed.tobytes())
        uniforms = {
            "grid_origin": window.origin,
            "grid_cell": window.cell_m,
            "grid_size": window.heights.shape,
            "apron": APRON_M,
            "level": self._level,
        }
        for name, program in self._programs.items():
            set_uniforms(program, uniforms)
            self._arrays[name] = self._ctx.vertex_array(
                program, [(self._vertices, *LAYOUTS[name])], self._indices, index_element_size=4
            )

    def _draw(self, name: str, indices: NDArray[np.uint32]) -> None:
        if len(indices):
            upload(self._indices, indices.tobytes())
            self._arrays[name].render(moderngl.TRIANGLES, vertices=len(indices))

    def draw(self, frame: RenderFrame, show_grid: bool) -> None:
        mesh, terrain = self._mesh, self._terrain
        if mesh is None or terrain is None:
            return
        self._ctx.enable_only(moderngl.DEPTH_TEST)
        self._ctx.depth_func = "<"
        self._noise.use(0)
        meadow = float(LEVEL_SLOPE_RATIO < terrain.steepest < MEADOW_SLOPE_RATIO)
        values = {"grid_strength": float(show_grid), "metres": terrain.unit_m, "noise": 0, "meadow": meadow}
        set_uniforms(self._programs["surface"], values)
        tiles = mesh.indices(self._levels, self._visible)
        self._draw("surface", np.concatenate([tiles, mesh.apron_indices(self._levels)]))

    def draw_depth(self, frame: RenderFrame) -> None:
        """Draw the ground near the characters into the bound shadow map."""
        if self._mesh is not None:
            near = self._mesh.touching(*frame.ground_box(self.shadow_reach_m))
            self._draw("depth", self._mesh.indices(self._levels, near))

    def draw_shadows(
        self,
        frame: RenderFrame,
        target: moderngl.Framebuffer,
        shadow_map: moderngl.Texture,
        marks: list[Array],
    ) -> None:
        """Darken the ground by the sun's shadow and the contact shadows `marks` (see `marks_of`)."""
        shadow_map.use(0)
        self._ctx.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        self._ctx.depth_func = "<="
        self._ctx.blend_func = moderngl.ZERO, moderngl.SRC_COLOR
        if marks:
            self._darken("shadow", frame, target, *frame.ground_box(self.shadow_reach_m))
        for heels, toes in marks:
            set_uniforms(self._programs["contact"], {"heel": heels.tobytes(), "toe": toes.tobytes()})
            ends = np.concatenate([heels, toes])
            radii = np.tile(heels[:, 3:], (2, 1))
            low, high = (ends[:, :3] - radii).min(0), (ends[:, :3] + radii).max(0)
            self._darken("contact", frame, target, low[::2], high[::2])

    def _darken(
        self, name: str, frame: RenderFrame, target: moderngl.Framebuffer, low: Array, high: Array
    ) -> None:
        """Redraw the ground between two corners (x, z) with a program whose colours are multiplied onto it."""
        mesh = self._mesh
        chosen = None if mesh is None else mesh.touching(low, high) & self._visible
        if mesh is not None and chosen is not None and chosen.any():
            with scissored(target, frame.screen_box(mesh.corners(low, high, chosen), 0.0)):
                self._draw(name, mesh.indices(self._levels, chosen))

    def release(self) -> None:
        release(*self._arrays.values(), *self._programs.values(), self._indices, self._vertices, self._noise)


def _noise_texture(ctx: moderngl.Context) -> moderngl.Texture:
    """Return smooth noise that repeats, in two channels: patches, and grain of a few texels."""
    rng, side = np.random.default_rng(NOISE_SEED), NOISE_TEXELS
    wave = np.fft.fftfreq(side)[:, None] ** 2 + np.fft.fftfreq(side) ** 2
    channels = []
    for sizes in (PATCH_TEXELS, GRAIN_TEXELS):
        total = np.zeros((side, side))
        for size in sizes:
            rough = np.fft.fft2(rng.standard_normal((side, side)))
            smooth = np.fft.ifft2(rough * np.exp(-wave * (2.2 * size) ** 2)).real
            total += smooth / smooth.std() * size**0.35
        channels.append(np.clip(0.5 + 0.19 * total / total.std(), 0.0, 1.0))
    texture = ctx.texture((side, side), 2, np.uint8(255 * np.stack(channels, -1)).tobytes(), alignment=1)
    texture.build_mipmaps()
    texture.filter = moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR
    return texture
