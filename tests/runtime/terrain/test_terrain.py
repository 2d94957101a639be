"""Height maps: interpolation, the ready terrains, and files of others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from runtime.assets import asset_path
from runtime.errors import FileError, TerrainError
from runtime.terrain.height_map import PointHeights, Terrain
from runtime.terrain.library import STEP_RISE_M, TERRAIN_NAMES, load_terrain, make_terrain
from runtime.terrain.mesh import rasterise
from tests.helpers.height_maps import write_height_png

places = st.floats(-6.0, 6.0)


def bumpy():
    heights = np.random.default_rng(0).normal(size=(21, 31)).astype(np.float32)
    return Terrain("bumpy", heights, 0.25, (-2.0, -3.0))


@given(places, places)
def test_heights_are_bilinear_and_go_on_at_the_edges(x, z):
    t = bumpy()
    i, j = np.clip((x + 2.0) / 0.25, 0, 20), np.clip((z + 3.0) / 0.25, 0, 30)
    corners = t.heights[int(i) : int(i) + 2, int(j) : int(j) + 2]
    assert corners.min() - 1e-4 <= t.height(x, z) <= corners.max() + 1e-4
    assert PointHeights(t).height(x, z) == pytest.approx(float(t.height(x, z)), abs=1e-5)


def test_heights_at_the_samples_and_normals_of_a_plane():
    t = bumpy()
    np.testing.assert_allclose(t.height(-2.0 + 0.25 * 3, -3.0 + 0.25 * 7), t.heights[3, 7], atol=1e-5)
    axis = np.arange(11) * 0.5
    plane = Terrain("plane", (0.3 * axis[:, None] - 0.1 * axis).astype(np.float32), 0.5, (0.0, 0.0))
    expected = np.array([-0.3, 1.0, 0.1]) / np.linalg.norm([-0.3, 1.0, 0.1])
    np.testing.assert_allclose(plane.normal(2.2, 3.3), expected, atol=1e-4)


@pytest.mark.parametrize("name", TERRAIN_NAMES)
def test_ready_terrains_are_finite_large_and_level_where_one_starts(name):
    t = make_terrain(name, seed=3)
    assert t.name == name
    assert t.heights.dtype == np.float32
    assert np.isfinite(t.heights).all()
    assert np.abs(t.heights).max() < 5.0
    low_x, low_z, high_x, high_z = t.extent
    assert high_x - low_x == pytest.approx(40.0, abs=0.1)
    assert high_z - low_z == pytest.approx(40.0, abs=0.1)
    around = np.random.default_rng(0).uniform(-1.2, 1.2, (2, 500))
    np.testing.assert_allclose(t.height(*around), t.height(0.0, 0.0), atol=0.01)
    np.testing.assert_array_equal(make_terrain(name, 3).heights, t.heights)


def test_hills_are_walkable_slopes():
    t = make_terrain("hills")
    degrees = np.degrees(np.arctan(np.hypot(*np.gradient(t.heights.astype(float), t.cell_m))))
    assert 14 < np.percentile(degrees, 99) < 20
    assert degrees.max() < 26
    assert np.ptp(t.heights) > 0.8


def test_stairs_have_treads_and_crisp_risers():
    t = make_terrain("stairs")
    z = np.arange(2.5, 5.8, 0.005)
    heights = t.height(np.zeros_like(z), z)
    steps = heights / STEP_RISE_M
    on_tread = np.abs(steps - np.round(steps)) < 1e-3
    assert on_tread.mean() > 0.85
    treads = np.round(steps[on_tread]).astype(int)
    assert list(np.unique(treads)) == list(range(0, 9))
    assert np.all(np.diff(treads) >= 0)
    # rings: the same in every direction
    np.testing.assert_allclose(t.height(z, np.zeros_like(z)), heights, atol=1e-5)


def test_an_unknown_name_lists_the_names():
    with pytest.raises(TerrainError, match="lava") as error:
        load_terrain("lava")
    assert all(name in str(error.value) for name in TERRAIN_NAMES)


# --- files
def test_the_shipped_height_map_loads():
    t = load_terrain(asset_path("terrains/bowl.png"))
    assert t.name == "bowl"
    assert t.heights.shape == (401, 401)
    assert 0.0 <= t.heights.min() < 0.05
    assert 1.5 < t.heights.max() <= 2.0


def test_png_height_maps_keep_16_bits_and_their_orientation(tmp_path):
    heights = np.random.default_rng(1).uniform(size=(5, 9))
    write_height_png(tmp_path / "map.png", heights)
    t = load_terrain(tmp_path / "map.png", cell_m=0.5, height_m=3.0)
    np.testing.assert_allclose(t.heights, heights * 3.0, atol=3.0 / 65535)
    assert t.origin == (-1.0, -2.0)
    assert float(t.height(-1.0 + 0.5 * 4, -2.0 + 0.5 * 8)) == pytest.approx(heights[4, 8] * 3.0, abs=1e-3)
    Image.fromarray(np.array([[0, 255], [51, 102]], np.uint8)).save(tmp_path / "grey.png")
    heights = load_terrain(tmp_path / "grey.png", height_m=1.0).heights
    np.testing.assert_allclose(heights, [[0, 0.2], [1, 0.4]], atol=1e-6)


def test_npy_floats_are_metres_and_unsigned_integers_are_scaled(tmp_path):
    np.save(tmp_path / "m.npy", np.array([[0.0, 1.5], [-2.0, 3.0]]))
    np.testing.assert_allclose(load_terrain(tmp_path / "m.npy").heights, [[0, 1.5], [-2, 3]])
    np.save(tmp_path / "u.npy", np.array([[0, 65535], [0, 0]], np.uint16))
    assert load_terrain(tmp_path / "u.npy", height_m=4.0).heights.max() == pytest.approx(4.0)


def test_a_mesh_is_sampled_at_its_highest_surface(tmp_path):
    (tmp_path / "ramp.obj").write_text(
        "v 0 0 0\nv 4 2 0\nv 4 2 4\nv 0 0 4\nv 1 5 1\nv 3 5 1\nv 3 5 3\nv 1 5 3\n"
        "f 1 2 3\nf 1 3 4\nf 5 6 7\nf 5 7 8\n"
    )
    t = load_terrain(tmp_path / "ramp.obj", cell_m=0.25)
    assert t.heights.shape == (17, 17)
    assert t.origin == (-2.0, -2.0)
    assert float(t.height(-1.5, 1.75)) == pytest.approx(0.25, abs=1e-5)  # ramp
    assert float(t.height(0.0, 0.0)) == pytest.approx(5.0, abs=1e-5)  # roof


def test_rasterising_leaves_gaps_at_the_lowest_height():
    heights = rasterise(np.array([[[0.0, 1.0, 0.0], [2.0, 1.0, 0.0], [0.0, 3.0, 2.0]]]), (4, 3))
    np.testing.assert_allclose(heights, [[1, 2, 3], [1, 2, 1], [1, 1, 1], [1, 1, 1]])


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "P", "LA"])
def test_colours_are_read_as_grey_with_a_note(mode, tmp_path):
    grey = Image.fromarray(np.tile(np.linspace(0, 255, 16).astype(np.uint8), (8, 1)))
    (grey.convert("RGB").convert("P") if mode == "P" else grey.convert(mode)).save(tmp_path / "map.png")
    grey.save(tmp_path / "grey.png")
    read, wanted = load_terrain(tmp_path / "map.png"), load_terrain(tmp_path / "grey.png")
    assert np.allclose(read.heights, wanted.heights, atol=0.45 if mode == "P" else 1e-5)
    assert "map.png" in read.note
    assert "grey" in read.note
    assert wanted.note == ""


def write_bad(kind, path):
    if kind == "cut.png":
        write_height_png(path, np.random.default_rng(0).uniform(size=(64, 64)))
        path.write_bytes(path.read_bytes()[:600])
    elif kind == "wide.png":
        Image.new("L", (5000, 2)).save(path)
    elif kind == "text.png":
        path.write_text("not a picture")
    elif kind == "nan.npy":
        np.save(path, np.array([[0.0, np.nan], [0.0, 0.0]]))
    elif kind == "pickle.npy":
        np.save(path, np.array([[{}, 1], [2, 3]], object), allow_pickle=True)
    elif kind == "deep.npy":
        np.save(path, np.zeros((2, 2, 2)))
    elif kind == "wide.npy":
        np.save(path, np.zeros((2, 5000)))
    elif kind == "high.npy":
        np.save(path, np.full((3, 3), 1e9))
    elif kind == "text.npy":
        path.write_text("not an array")
    elif kind == "empty.obj":
        path.write_text("v 0 0 0\n")
    elif kind == "huge.obj":
        path.write_text("v 0 0 0\nv 9000 0 0\nv 0 0 9000\nf 1 2 3\n")
    elif kind == "text.glb":
        path.write_text("not a mesh")


@pytest.mark.parametrize(
    "kind",
    ["missing.png", "cut.png", "wide.png", "text.png", "nan.npy", "pickle.npy", "deep.npy", "wide.npy",
     "high.npy", "text.npy", "empty.obj", "huge.obj", "text.glb"],
)  # fmt: skip
def test_bad_files_are_named_with_a_remedy(kind, tmp_path):
    path = tmp_path / kind
    write_bad(kind, path)
    with pytest.raises(FileError, match=kind) as error:
        load_terrain(path)
    assert error.value.remedy


@pytest.mark.parametrize(
    ("cell", "height"), [(0.0, 1.0), (-1.0, 1.0), (50.0, 1.0), (0.1, 0.0), (0.1, float("nan"))]
)
def test_senseless_scales_are_refused(cell, height, tmp_path):
    write_height_png(tmp_path / "map.png", np.zeros((4, 4)))
    with pytest.raises(TerrainError):
        load_terrain(tmp_path / "map.png", cell, height)
