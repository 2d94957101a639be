"""The renderer through EGL: golden pictures, and what each pass must and must not change.

After a wanted change of the look: SPORT_UPDATE_GOLDEN=1 pytest tests/viewer/render/test_render.py, and look at tests/golden.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import FileError
from runtime.pose import Pose
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from tests.helpers.golden_images import check_golden
from tests.helpers.render_scene import CapsuleBody, capsule_body, hills, stairs, walking_pose
from viewer.render.camera import OrbitCamera
from viewer.render.character_pass import coarse_triangles
from viewer.render.offscreen import OffscreenTarget, save_png
from viewer.render.overlays import Overlays, TrajectoryOverlay
from viewer.render.quality import HIGH, SOFTWARE, Quality
from viewer.render.renderer import Renderer
from viewer.render.targets import scene_size

WIDTH, HEIGHT = 160, 120
SMALL_HIGH = replace(HIGH, shadow_map_size=512)

Picture = np.ndarray
Render = Callable[..., Picture]


@pytest.fixture(scope="module")
def target() -> Iterator[OffscreenTarget]:
    offscreen = OffscreenTarget(WIDTH, HEIGHT)
    yield offscreen
    offscreen.release()


@pytest.fixture(scope="module")
def body() -> CapsuleBody:
    return capsule_body()


@pytest.fixture
def renderer(target: OffscreenTarget, body: CapsuleBody) -> Iterator[Callable[..., Renderer]]:
    """Renderers of that body, released at the end."""
    made: list[Renderer] = []

    def make(quality: Quality = SOFTWARE, terrain: Terrain | None = None) -> Renderer:
        made.append(Renderer(target.ctx, quality))
        made[-1].set_terrain(terrain or Terrain.flat())
        made[-1].set_character(body)
        return made[-1]

    yield make
    for each in made:
        each.release()


@pytest.fixture
def render(target: OffscreenTarget, renderer: Callable[..., Renderer]) -> Render:
    """Draw one picture of a terrain and a pose, by default a step on level ground."""

    def draw(
        terrain: Terrain | None = None,
        overlays: Overlays | None = None,
        quality: Quality = SOFTWARE,
        pose: Pose | bool | None = True,
        yaw: float = 3.8,
        pitch: float = 0.3,
        distance: float = 3.6,
    ) -> Picture:
        ground = terrain or Terrain.flat()
        shown = walking_pose(ground) if pose is True else pose or None
        camera = OrbitCamera((0.0, float(ground.height(0, 0)) + 0.85, 0.0), yaw, pitch, distance)
        renderer(quality, ground).render(target.framebuffer, camera, shown, overlays or Overlays())
        assert target.ctx.error == "GL_NO_ERROR"
        return target.read()

    return draw


def trajectory(terrain: Terrain) -> TrajectoryOverlay:
    z = 0.25 * (np.arange(12) - 6.0)
    x = 0.02 * z**2
    positions = np.stack([x, terrain.height(x, z), z], -1)
    return TrajectoryOverlay(positions, np.tile([0.0, 1.0], (12, 1)), np.arange(12) < 6)


def everything(terrain: Terrain) -> Overlays:
    return Overlays(trajectory(terrain), show_skeleton=True, show_contacts=True)


def test_golden_stairs_with_overlays(render: Render) -> None:
    check_golden("stairs_overlays_software", render(stairs(), everything(stairs()), yaw=0.5))


def test_golden_hills_high_with_others(render: Render) -> None:
    terrain = hills()
    ghost, extra = walking_pose(terrain, 0.7, 0.3, -0.5), walking_pose(terrain, -0.8, -0.2)
    overlays = Overlays(ghosts=[ghost], extra_poses=[extra])
    check_golden("hills_others_high", render(terrain, overlays, SMALL_HIGH))


@pytest.mark.parametrize("terrain", [Terrain.flat(size_m=12.0), hills(size_m=12.0)], ids=["flat", "hills"])
def test_ground_melts_into_the_background(render: Render, terrain: Terrain) -> None:
    picture = render(terrain, Overlays(show_grid=False), pose=None, pitch=0.25, distance=4.0)
    column = picture[: len(picture) // 2, 10].astype(int)  # nearer, the ground has a grain
    most = 16 if terrain.steepest == 0.0 else 32  # a near hill stands before a far one
    assert np.abs(np.diff(column, axis=0)).max() < most, "a hard edge"
    assert column[-1].mean() < column.mean() - 5, "ground is darker than sky"


def test_grid_can_be_hidden(render: Render) -> None:
    shown, hidden = render(pose=None), render(pose=None, overlays=Overlays(show_grid=False))
    assert shown[80:].std() > 2 * hidden[80:].std()


def brightness(picture: Picture) -> np.ndarray:
    return picture.astype(float).mean(-1)


@pytest.mark.parametrize("quality", [SOFTWARE, SMALL_HIGH], ids=["software", "high"])
def test_a_body_throws_a_shadow_away_from_the_sun(render: Render, quality: Quality) -> None:
    # from above, looking along -Z
    options = {"yaw": np.pi, "pitch": 1.4, "distance": 7.0, "quality": quality}
    bare, stood = (brightness(render(pose=pose, **options)) for pose in (None, True))
    darker = bare - stood > 25
    rows, columns = np.nonzero(darker)
    # the sun stands at +X, +Z; in this picture +X is right, +Z is down
    assert darker.sum() > 80
    assert columns.mean() < WIDTH / 2
    assert rows.mean() < HEIGHT / 2


def test_high_quality_ground_does_not_shade_itself(render: Render) -> None:
    far_pose = walking_pose(Terrain.flat(), 3.0, -3.0)
    options = {"overlays": Overlays(show_grid=False), "pose": far_pose, "yaw": -2.2, "pitch": 0.7}
    for terrain in (Terrain.flat(), Terrain("level", np.zeros((401, 401), np.float32), 0.05, (-10.0, -10.0))):
        picture = brightness(render(terrain, quality=SMALL_HIGH, **options))
        assert np.ptp(picture[50:90, 60:100]) < 8, "stripes"


def raised(pose: Pose, height: float) -> Pose:
    up = np.array([0.0, height, 0.0], np.float32)
    return replace(pose, positions=pose.positions + up, hips_position=pose.hips_position + up)


def test_feet_darken_the_ground_only_when_near(render: Render) -> None:
    pose = walking_pose(Terrain.flat(), stride=0.0)
    pose = raised(pose, REST_HIPS_HEIGHT - pose.hips_position[1])
    lifted = raised(pose, 0.6)
    toe = pose.positions[SPORT_SKELETON.index("LeftToeBase")]
    camera = OrbitCamera((0.0, 0.85, 0.0), 3.8, 0.8, 3.0)
    spot = np.array([toe[0] + 0.02, 0.0, toe[2] + 0.085, 1.0])  # towards the sun, before the toe
    clip = camera.projection_matrix(WIDTH / HEIGHT) @ camera.view_matrix() @ spot
    column = round((0.5 + 0.5 * clip[0] / clip[3]) * WIDTH)
    row = round((0.5 - 0.5 * clip[1] / clip[3]) * HEIGHT)
    options = {"yaw": 3.8, "pitch": 0.8, "overlays": Overlays(show_grid=False), "distance": 3.0}
    bare, stood, jumped = (brightness(render(pose=p, **options))[row, column] for p in (None, pose, lifted))
    assert bare - stood > 20
    assert bare - jumped < 0.6 * (bare - stood)


def test_ghosts_are_fainter_where_they_would_hide_the_character(render: Render) -> None:
    pose, behind = walking_pose(Terrain.flat()), walking_pose(Terrain.flat(), 0.0, 2.5)
    bare = render(pose=None, overlays=Overlays()).astype(int)
    alone = np.abs(render(pose=None, overlays=Overlays(ghosts=[pose])).astype(int) - bare).max(-1)
    solid = np.abs(render(pose=pose).astype(int) - bare).max(-1)
    assert alone.max() < 0.8 * solid.max()  # the ground shows through
    far = render(pose=behind, yaw=0.0).astype(int)
    ghosted = render(pose=behind, yaw=0.0, overlays=Overlays(ghosts=[pose]))
    assert 0 < np.abs(ghosted.astype(int) - far).max(-1).max() < 0.7 * alone.max()


def test_frames_of_a_take_hide_nothing_of_the_character(render: Render) -> None:
    flat = Terrain.flat()
    pose = walking_pose(flat)
    bare, alone = (render(pose=p).astype(int) for p in (None, pose))
    frames = [walking_pose(flat, x, z) for x, z in ((0.1, -0.1), (-0.1, 0.1), (0.0, -0.4), (0.0, 0.4))]
    among = render(pose=pose, overlays=Overlays(frames=frames)).astype(int)
    body = np.abs(alone - bare).max(-1) > 60  # its shadow is fainter
    inner = body[2:-2, 2:-2] & body[:-4, 2:-2] & body[4:, 2:-2] & body[2:-2, :-4] & body[2:-2, 4:]
    assert np.abs(among - alone).max(-1)[2:-2, 2:-2][inner].mean() < 3.0
    assert (np.abs(among - alone).max(-1) > 20).sum() > 0.5 * body.sum(), "they are seen around it"


@pytest.mark.parametrize("name", ["trajectory", "show_skeleton", "show_contacts"])
def test_each_overlay_is_drawn(render: Render, name: str) -> None:
    terrain = hills()
    shown = {"trajectory": trajectory(terrain)}.get(name, True)
    with_overlay = render(terrain, Overlays(**{name: shown})).astype(int)
    assert (np.abs(with_overlay - render(terrain, Overlays())).max(-1) > 40).sum() > 30


def test_overlays_leave_the_next_frame_alone(
    target: OffscreenTarget, renderer: Callable[..., Renderer]
) -> None:
    terrain, pictures = hills(), []
    drawer, pose, camera = renderer(SOFTWARE, terrain), walking_pose(terrain), OrbitCamera()
    busy = replace(everything(terrain), ghosts=[pose], extra_poses=[pose])
    for overlays in (Overlays(), busy, Overlays()):
        drawer.render(target.framebuffer, camera, pose, overlays)
        pictures.append(target.read())
    np.testing.assert_array_equal(pictures[0], pictures[2])


def test_scale_and_samples_change_edges_only(render: Render) -> None:
    plain = replace(SOFTWARE, smooth_edges="")
    reference = render(quality=plain).astype(int)
    finer = (
        replace(plain, render_scale=0.5),
        replace(plain, msaa=4),
        replace(plain, msaa=4, render_scale=1.5),
    )
    for quality in (*finer, SOFTWARE):
        difference = np.abs(render(quality=quality).astype(int) - reference).max(-1)
        assert 0 < (difference > 3).mean() < 0.35
        assert difference.mean() < 6


def test_a_target_with_depth_and_another_size_each_frame(
    target: OffscreenTarget, renderer: Callable[..., Renderer]
) -> None:
    drawer = renderer(SMALL_HIGH)
    for size in ((64, 48), (101, 37), (1, 1)):
        color, depth = target.ctx.texture(size, 4), target.ctx.depth_renderbuffer(size)
        framebuffer = target.ctx.framebuffer([color], depth)
        drawer.render(framebuffer, OrbitCamera(), walking_pose(Terrain.flat()), Overlays())
        assert target.ctx.error == "GL_NO_ERROR"
        assert max(framebuffer.read(components=3, alignment=1)) > 100
        target.framebuffer.use()
        for part in (framebuffer, color, depth):
            part.release()


def test_without_terrain_and_character_there_is_sky(target: OffscreenTarget) -> None:
    renderer = Renderer(target.ctx)
    renderer.render(target.framebuffer, OrbitCamera(), walking_pose(Terrain.flat()), Overlays())
    assert target.read().min() > 90
    renderer.release()


def test_a_large_terrain_is_drawn_wherever_the_focus_is(
    target: OffscreenTarget, renderer: Callable[..., Renderer]
) -> None:
    terrain = Terrain("large", np.zeros((1401, 1401), np.float32), 0.05, (0.0, 0.0))
    drawer, pictures = renderer(SOFTWARE, terrain), []
    for x, z in ((20.0, 20.0), (55.0, 45.0)):  # the same place of the grid
        camera = OrbitCamera((x, 0.9, z), 0.4, 0.4, 5.0)
        drawer.render(target.framebuffer, camera, None, Overlays())
        pictures.append(target.read().astype(int))
    assert np.abs(pictures[0] - pictures[1]).mean() < 1.0


def test_too_many_joints_are_refused_with_a_remedy(
    renderer: Callable[..., Renderer], body: CapsuleBody
) -> None:
    with pytest.raises(FileError, match="300 joints, expected at most 256"):
        renderer().set_character(replace(body, joint_indices=np.full_like(body.joint_indices, 299)))


def test_large_windows_are_rendered_smaller_in_software() -> None:
    assert scene_size((1280, 720), SOFTWARE) == (1280, 720)
    width, height = scene_size((2880, 1800), SOFTWARE)
    assert width * height <= 1.01 * SOFTWARE.max_pixels
    assert width / height == pytest.approx(1.6, abs=0.01)
    assert scene_size((2880, 1800), HIGH) == (2880, 1800)


def test_a_picture_that_cannot_be_saved_names_its_path(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(FileError, match=r"file.*picture\.png"):
        save_png(np.zeros((2, 2, 3), np.uint8), tmp_path / "file" / "picture.png")


def test_a_coarse_mesh_keeps_its_colors_and_has_no_cracks_between_them() -> None:
    """Two plates of different colours that meet along a line: after coarsening, by the same points of it."""
    steps = np.linspace(0.0, 1.0, 41)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    plate = np.stack([x, y, 0.0 * x], -1).reshape(-1, 3)
    corner = (np.arange(40)[:, None] * 41 + np.arange(40)).ravel()
    faces = np.concatenate([corner[:, None] + [[0, 41, 42]], corner[:, None] + [[0, 42, 1]]])
    positions = np.concatenate([plate, plate + np.array([1.0, 0.0, 0.0])])
    colors = np.repeat([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], len(plate), axis=0)
    triangles = coarse_triangles(positions, np.concatenate([faces, faces + len(plate)]), 0.07, colors)
    assert 0 < len(triangles) < len(faces)
    ends = colors[triangles][..., 0]
    assert (ends == ends[:, :1]).all()
    used = np.unique(triangles)
    seam = used[np.isclose(positions[used, 0], 1.0)]
    dark, light = (positions[seam[colors[seam, 0] == shade], 1] for shade in (0.0, 1.0))
    np.testing.assert_array_equal(np.sort(dark), np.sort(light))
