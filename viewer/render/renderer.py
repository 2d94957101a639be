"""The renderer: `Renderer.render` lists the passes; each pass is a module of its own."""

import moderngl
import numpy as np

from runtime.pose import Pose
from runtime.terrain.height_map import Terrain
from viewer.render import marks
from viewer.render.camera import Camera
from viewer.render.character_pass import CharacterDraw, CharacterPass, SkinnedMesh, character_draws
from viewer.render.frame import SHADOW_MARGIN_M, UNIFORM_BYTES, RenderFrame, make_frame
from viewer.render.gl import FRAME_BINDING, release, screen_triangle, shown_size
from viewer.render.overlays import Figure, Overlays
from viewer.render.quality import Quality, choose_quality
from viewer.render.targets import SceneTarget, ShadowMap
from viewer.render.terrain_pass import TerrainPass

LEVEL_SLOPE_RATIO = 0.02  # rise over run: flatter ground has no edges to smooth
FIGURE_OPACITY = 0.75  # of one in the same place as the character


class Renderer:
    """Draws terrain, characters and overlays into a framebuffer.

    After a frame the target stays bound, with depth test, blending and face culling off.
    """

    def __init__(self, ctx: moderngl.Context, quality: Quality | None = None) -> None:
        self.ctx = ctx
        self.quality = quality or choose_quality(ctx)
        self._uniforms = ctx.buffer(reserve=UNIFORM_BYTES, dynamic=True)  # of the frame, for all passes
        self._scene = SceneTarget(ctx, self.quality)
        self._shadow_map = ShadowMap(ctx)
        self._sky = screen_triangle(ctx, "sky.frag")
        self._terrain = TerrainPass(ctx, self.quality)
        self._characters = CharacterPass(ctx, self.quality)
        self._figure: CharacterPass | None = None  # of another mesh, if any
        self._figure_mesh: SkinnedMesh | None = None
        self._overlays = marks.OverlayPass(ctx)
        self._ground = Terrain.flat()

    def set_terrain(self, terrain: Terrain) -> None:
        """Use another height map from the next frame on."""
        self._ground = terrain
        self._terrain.set_terrain(terrain)

    def set_character(self, character: SkinnedMesh) -> None:
        """Use another skinned mesh; FileError if it has too many joints."""
        self._characters.set_character(character)

    def render(
        self, target: moderngl.Framebuffer, camera: Camera, pose: Pose | None, overlays: Overlays
    ) -> None:
        """Draw one frame into `target`; without a pose, only the ground."""
        figure = overlays.figure
        solid = overlays.extra_poses if pose is None else [pose, *overlays.extra_poses]
        standing = [*solid, figure.pose] if figure is not None and figure.casts else solid
        scene = self._scene.begin(shown_size(target))
        reach = self._terrain.shadow_reach_m
        frame = make_frame(camera, scene.size, standing, reach, self.quality.shadow_map_size)
        self._uniforms.write(frame.uniforms)
        self._uniforms.bind_to_uniform_block(FRAME_BINDING)
        self._terrain.prepare(frame, np.array([camera.target[0], camera.target[2]]))
        draws = character_draws(solid, overlays.ghosts, overlays.frames, camera.position)
        self._characters.prepare(draws)
        among, on_top = self._prepare_figure(figure)
        passes = [self._characters, *among]

        self._draw_shadow_map(frame, passes)
        scene.use()
        scene.clear(depth=1.0)
        for characters in passes:
            characters.draw(self._shadow_map.texture)
        self._terrain.draw(frame, overlays.show_grid)
        self._terrain.draw_shadows(
            frame, scene, self._shadow_map.texture, [marks.marks_of(p) for p in standing]
        )
        self._draw_sky()
        self._draw_ground_overlays(scene, pose, overlays)
        for characters in reversed(passes):  # the character's own last: nothing is drawn over it afterwards
            characters.draw_ghosts(scene)
        for characters in on_top:
            characters.draw(self._shadow_map.texture, on_top=True)
        self._draw_top_overlays(frame, pose, overlays)
        around = frame.screen_box(frame.cast[: len(frame.cast) // 2], SHADOW_MARGIN_M)
        level = self._ground.steepest < LEVEL_SLOPE_RATIO or self.quality.smooth_edges != "all"
        self._scene.present(target, around if level else (0, 0, *scene.size))
        self.ctx.enable_only(moderngl.NOTHING)

    def _prepare_figure(self, figure: Figure | None) -> tuple[list[CharacterPass], list[CharacterPass]]:
        """Draw a figure of another mesh, among the characters or on top of everything."""
        if figure is None:
            return [], []
        if self._figure is None:
            self._figure = CharacterPass(self.ctx, self.quality)
        if self._figure_mesh is not figure.mesh:
            self._figure.set_character(figure.mesh)
            self._figure_mesh = figure.mesh
        opacity = FIGURE_OPACITY if figure.ghost else 1.0
        self._figure.prepare([CharacterDraw(figure.pose, opacity, figure.matrices)])
        return ([], [self._figure]) if figure.on_top else ([self._figure], [])

    def _draw_shadow_map(self, frame: RenderFrame, passes: list[CharacterPass]) -> None:
        self._shadow_map.begin(frame.shadow_texels)
        self.ctx.enable_only(moderngl.DEPTH_TEST)
        self.ctx.depth_func = "<"
        for characters in passes:
            characters.draw_depth()
        if self._terrain.shadow_reach_m:
            self.ctx.polygon_offset = 1.0, 2.0  # the ground must not shade itself
            self._terrain.draw_depth(frame)
            self.ctx.polygon_offset = 0.0, 0.0

    def _draw_sky(self) -> None:
        """Draw the sky where nothing else is: from the horizon, which is also the colour of the fog, to the zenith."""
        self.ctx.enable_only(moderngl.DEPTH_TEST)
        self.ctx.depth_func = "<="
        self._sky.render(moderngl.TRIANGLES, vertices=3)

    def _draw_ground_overlays(
        self, scene: moderngl.Framebuffer, pose: Pose | None, overlays: Overlays
    ) -> None:
        scene.depth_mask = False
        scene.use()  # a mask takes effect when its framebuffer is bound
        if overlays.trajectory is not None:
            self._overlays.draw_on_ground(marks.trajectory_strokes(overlays.trajectory, self._ground))
        if overlays.path is not None:
            self._overlays.draw_on_ground(marks.path_strokes(overlays.path, self._ground))
        if overlays.show_contacts and pose is not None:
            self._overlays.draw_on_ground(marks.contact_strokes(pose, self._ground))
        scene.depth_mask = True
        scene.use()

    def _draw_top_overlays(self, frame: RenderFrame, pose: Pose | None, overlays: Overlays) -> None:
        pixel_scale = max(frame.size[1] / marks.REFERENCE_HEIGHT_PX, 0.5)
        if overlays.trails is not None:
            self._overlays.draw_on_top(marks.trail_strokes(overlays.trails, pixel_scale))
        if overlays.show_skeleton and pose is not None:
            self._overlays.draw_on_top(marks.skeleton_strokes(pose, pixel_scale))
        if overlays.show_contacts and pose is not None:
            self._overlays.draw_on_top(marks.contact_dots(pose, pixel_scale))
        if overlays.pins is not None:
            self._overlays.draw_on_top(marks.pin_strokes(overlays.pins, pixel_scale))

    def release(self) -> None:
        release(self._uniforms, self._sky, self._scene, self._shadow_map)
        release(self._terrain, self._characters, self._figure, self._overlays)
