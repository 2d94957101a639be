"""The ground as triangles: where the take stands on it, in the take's unit, and read back as the same ground."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from runtime.errors import FileError, UsageError
from runtime.feet.skating import joint_heights
from runtime.formats import ground as ground_module
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.ground import ground_mesh, ground_of, ground_spec
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.table import save_motion
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import load_terrain
from tests.helpers.height_maps import write_height_png
from tests.helpers.walker import walk

HILLS = load_terrain("hills")


@pytest.fixture(scope="module")
def clip() -> Clip:
    return Clip("up", 60.0, *walk(400, terrain=HILLS), terrain="hills").trim(150, 399)


def heights_under(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Height of the mesh under points, by its nearest vertices (0.1 m apart)."""
    vertices = np.asarray(mesh.vertices)
    away = np.linalg.norm(vertices[None, :, [0, 2]] - points[:, None, [0, 2]], axis=-1)
    return vertices[np.argmin(away, axis=1), 1]


@pytest.mark.parametrize(
    ("suffix", "unit", "scale", "at_origin"),
    [(".obj", "cm", 100.0, True), (".glb", "m", 1.0, True), (".glb", "cm", 100.0, False)],
)
def test_feet_stand_on_the_ground_beside_the_take(
    clip: Clip, tmp_path: Path, suffix: str, unit: str, scale: float, at_origin: bool
) -> None:
    target = tmp_path / f"ground{suffix}"
    options = ExportOptions(unit=unit, at_origin=at_origin, ground_out=target)
    _, ground = save_motion(clip, tmp_path / "take.bvh", options, HILLS)
    assert ground == f"{target}: ground hills in {unit}"
    mesh = trimesh.load(str(target), force="mesh", process=False)
    hips = load_clip_bvh(tmp_path / "take.bvh").hips_positions[::40].astype(float) * scale
    wanted = HILLS.height(clip.hips_positions[::40, 0], clip.hips_positions[::40, 2])
    over = clip.hips_positions[::40, 1] - wanted
    assert np.allclose(hips[:, 1] - heights_under(mesh, hips), over * scale, atol=0.04 * scale)
    corners = np.asarray(mesh.triangles)
    up = np.cross(*(corners[:, k] - corners[:, 0] for k in (1, 2)))[:, 1]
    assert (up > 0).all(), "counter-clockwise from above"


def test_every_sample_is_a_vertex(clip: Clip) -> None:
    vertices, triangles = ground_mesh(HILLS, prepare(clip, ExportOptions(), HILLS))
    assert len(vertices) == HILLS.heights.size
    assert np.allclose(vertices[:, 1], HILLS.heights.ravel())
    assert len(triangles) == 2 * np.prod(np.array(HILLS.heights.shape) - 1)


def test_a_level_ground_is_two_triangles_and_a_large_one_is_cut(
    clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    take = prepare(clip, ExportOptions(at_origin=True), HILLS)
    flat = Terrain.flat()
    vertices, triangles = ground_mesh(flat, prepare(clip, ExportOptions(), flat))
    assert (len(vertices), len(triangles)) == (4, 2)
    monkeypatch.setattr(ground_module, "MAX_VERTICES", 30_000)
    vertices, _ = ground_mesh(HILLS, take)
    assert 5_000 < len(vertices) <= 30_500
    path = take.root.positions
    for axis in (0, 2):
        assert vertices[:, axis].min() < path[:, axis].min() - 1.0
        assert vertices[:, axis].max() > path[:, axis].max() + 1.0


def test_no_ground_beside_a_take_that_does_not_go_over_it(clip: Clip, tmp_path: Path) -> None:
    options = ExportOptions(in_place=True, ground_out=tmp_path / "g.obj")
    with pytest.raises(UsageError, match="in_place"):
        save_motion(clip, tmp_path / "t.bvh", options, HILLS)
    with pytest.raises(UsageError, match=r"ground_out .*expected \.obj or \.glb"):
        save_motion(clip, tmp_path / "t.bvh", ExportOptions(ground_out=tmp_path / "g.stl"), HILLS)
    with pytest.raises(UsageError, match=r"\.glb, \.fbx, \.usdz, \.usd have it"):
        save_motion(clip, tmp_path / "t.bvh", ExportOptions(with_ground=True), HILLS)


def test_a_clip_is_put_on_the_ground_of_its_metadata(clip: Clip, tmp_path: Path) -> None:
    heights = np.random.default_rng(1).uniform(size=(20, 20))
    write_height_png(tmp_path / "mine.png", heights)
    path = save_bvh(replace(clip, terrain=str(tmp_path / "mine.png")), tmp_path / "take.bvh")
    back = load_clip_bvh(path)
    assert back.terrain == "mine.png"
    assert np.allclose(ground_of(back, path).heights, 2.0 * heights, atol=1e-3)
    assert ground_spec(back, path, "stairs") == "stairs"
    assert ground_spec(clip) == "hills"
    assert ground_spec(replace(clip, placed=None)) == "flat"
    (tmp_path / "mine.png").unlink()
    with pytest.raises(FileError, match=r"mine\.png, which is not next to it"):
        ground_of(back, path)


def test_the_lowest_sole_is_the_ground_where_none_is_known(clip: Clip) -> None:
    take = prepare(clip, ExportOptions(at_origin=True))
    assert -0.02 < joint_heights(take.clip.world()[0], Terrain.flat()).min() < 0.1
