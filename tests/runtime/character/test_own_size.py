"""Characters keep their own size: the motion is made for it, soles stand on the ground, and files have metres."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import rotations
from runtime.character.character import Character, load_character
from runtime.character.shape import BodyShape, shaped
from runtime.character.skinned_mesh import skin_vertices
from runtime.character.writer import write_character
from runtime.errors import UsageError
from runtime.formats.bvh import read_bvh
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.glb import save_glb
from runtime.formats.ground import save_ground
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.table import FORMATS
from runtime.skeleton import SPORT_SKELETON
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import load_terrain
from tests.helpers import shipped
from tests.helpers.app_driver import run
from tests.helpers.foreign_rigs import RIGS
from tests.helpers.glb_playback import play
from tests.helpers.walker import walk
from viewer.services import Services

BODIES = {
    "child": BodyShape(0.62, 0.85, 0.85, 0.9, 1.35),
    "dwarf": BodyShape(0.8, 0.5, 1.25, 0.8, 1.25),
    "giant": BodyShape(2.4, 1.1, 1.3, 1.1, 0.85),
}
REAL = {"load_character": Services().load_character}


@pytest.fixture(scope="module")
def mannequin() -> Character:
    return shipped.mannequin()


@pytest.fixture(scope="module", params=BODIES)
def body(
    request: pytest.FixtureRequest, mannequin: Character, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("bodies") / f"{request.param}.glb"
    write_character(path, shaped(mannequin, BODIES[request.param]))
    return path


def stepping(frames: int = 60) -> Clip:
    """A walk on flat ground."""
    hips, local, contacts = walk(frames)
    return Clip("walk", 60.0, hips, local, contacts)


def soles(character: Character, side: str) -> Character:
    """The vertices of one foot alone."""
    lead = character.joint_indices[np.arange(len(character.positions)), character.joint_weights.argmax(1)]
    own = np.isin(np.array(character.joint_names)[lead], [side + "Foot", side + "ToeBase"])
    arrays = ("positions", "joint_indices", "joint_weights")
    return replace(character, **{name: getattr(character, name)[own] for name in arrays})


def rolled(pitch: float, toe_contact: float) -> Any:
    """Standing with one foot pitched about its ball (heel up, negative) or heel, which stay on the ground."""
    local = rotations.identity((31,)).astype(np.float64)
    clip_hips = np.array([0.0, 1.0025, 0.0])
    leg, foot = (SPORT_SKELETON.index(f"Left{bone}") for bone in ("Leg", "Foot"))
    axis = np.array([1.0, 0.0, 0.0])
    local[foot] = rotations.from_axis_angle(axis, np.array(-pitch))
    pivot = np.array([0.0, -0.066, 0.1294 if pitch < 0 else -0.05])
    rise = float((rotations.rotate(local[foot], pivot) - pivot)[1])
    upper = SPORT_SKELETON.index("LeftUpLeg")
    # raise the ankle by bending the leg
    bend = 2.0 * np.arccos(np.clip(1.0 - max(-rise, 0.0) / 0.835, -1.0, 1.0))
    local[upper] = rotations.from_axis_angle(axis, np.array(-0.5 * bend))
    local[leg] = rotations.from_axis_angle(axis, np.array(bend))
    local[foot] = rotations.from_axis_angle(axis, np.array(-pitch - 0.5 * bend))
    toe = rotations.from_axis_angle(axis, np.array(min(pitch, 0.0) * 0.3))
    local[SPORT_SKELETON.index("LeftToeBase")] = toe
    contacts = np.array([[1.0 - toe_contact, toe_contact, 1.0, 1.0]])
    frames = [values.astype(np.float32) for values in (clip_hips[None], local[None], contacts)]
    return Clip("roll", 60.0, *frames).pose(0)


@pytest.mark.parametrize("pitch", [0.0, -0.3, -0.7, -1.0, 0.2, 0.35])
def test_soles_stand_on_the_ground(body: Path, pitch: float) -> None:
    character = load_character(body)
    matrices = character.skin_matrices(rolled(pitch, 0.0 if pitch > 0 else 1.0))
    for side in ("Left", "Right"):
        low = float(skin_vertices(soles(character, side), matrices)[:, 1].min()) * character.size
        assert -0.01 < low < 0.03 * max(character.size, 1.0)


def test_a_body_has_its_own_size(body: Path) -> None:
    character = load_character(body)
    raw = load_character(body).positions  # metres of the file
    assert character.height * character.size == pytest.approx(np.ptp(raw[:, 1]), rel=0.06)
    assert character.size != pytest.approx(1.0, abs=0.1)


def test_the_mannequin_is_as_large_as_the_motion(mannequin: Character) -> None:
    assert mannequin.size == 1.0
    assert shaped(mannequin, BodyShape()) is mannequin
    with pytest.raises(UsageError, match="legs"):
        shaped(mannequin, BodyShape(legs=9.0))


def test_files_hold_metres_of_the_character(body: Path, tmp_path: Path) -> None:
    character = load_character(body)
    clip = replace(stepping(), size=character.size)
    options = ExportOptions(character=body, with_ground=True)
    take = prepare(clip, options, Terrain.flat())
    save_glb(take, tmp_path / "own.glb", options, Terrain.flat())
    own = play(tmp_path / "own.glb").joints()
    thigh = np.linalg.norm(own["LeftLeg"][0, :3, 3] - own["LeftUpLeg"][0, :3, 3])
    rest = dict(zip(character.joint_names, character.rest_world, strict=True))
    assert thigh == pytest.approx(np.linalg.norm(rest["LeftLeg"][:3, 3] - rest["LeftUpLeg"][:3, 3]), rel=1e-3)
    walked = np.linalg.norm(own["Hips"][-1, [0, 2], 3] - own["Hips"][0, [0, 2], 3])
    ours = np.linalg.norm(clip.hips_positions[-1, [0, 2]] - clip.hips_positions[0, [0, 2]])
    assert walked == pytest.approx(ours * character.size, rel=0.02)
    fitted = replace(options, fit_to_motion=True)
    save_glb(prepare(replace(clip, size=1.0), fitted, None), tmp_path / "fit.glb", fitted, None)
    shown = play(tmp_path / "fit.glb").joints()
    found = np.linalg.norm(shown["LeftLeg"][0, :3, 3] - shown["LeftUpLeg"][0, :3, 3])
    assert found == pytest.approx(thigh / character.size, rel=1e-3)


def test_a_bvh_keeps_the_size(tmp_path: Path) -> None:
    clip = replace(stepping(), size=0.5)
    save_bvh(clip, tmp_path / "small.bvh")
    motion = read_bvh(tmp_path / "small.bvh")
    knee = motion.skeleton.index("LeftLeg")
    assert np.linalg.norm(motion.skeleton.offsets[knee]) == pytest.approx(50 * 0.4118, rel=1e-3)
    again = load_clip_bvh(tmp_path / "small.bvh")
    assert again.size == 0.5
    assert np.allclose(again.hips_positions, clip.hips_positions, atol=1e-3)


def test_the_ground_stays_as_it_is(tmp_path: Path) -> None:
    fine = load_terrain("hills")
    hills = Terrain("hills", fine.heights[::4, ::4], 4.0 * fine.cell_m, fine.origin)
    seen = hills.seen_by(0.5)
    assert seen.seen_by(0.5) is seen
    assert hills.seen_by(1.0) is hills
    x, z = np.meshgrid(np.linspace(-9, 9, 7), np.linspace(-9, 9, 7))
    assert np.allclose(seen.height(x / 0.5, z / 0.5) * 0.5, hills.height(x, z), atol=1e-5)
    assert np.allclose(seen.normal(x / 0.5, z / 0.5, 0.1), hills.normal(x, z, 0.05), atol=1e-4)
    take = prepare(replace(stepping(), size=0.5), ExportOptions(), hills)
    metres = ExportOptions(unit="m")
    save_ground(take, tmp_path / "small.obj", metres, hills)
    save_ground(prepare(stepping(), ExportOptions(), hills), tmp_path / "plain.obj", metres, hills)
    tops = [np.loadtxt([line[2:] for line in path.read_text().splitlines() if line.startswith("v ")])
            for path in (tmp_path / "small.obj", tmp_path / "plain.obj")]  # fmt: skip
    assert np.allclose(tops[0].min(0), tops[1].min(0), atol=1e-3)
    assert np.allclose(tops[0].max(0), tops[1].max(0), atol=1e-3)


def test_the_window_walks_a_body_in_its_own_size(start: Callable[..., Any], body: Path) -> None:
    app = start(services=REAL, character=body)
    run(app, 3)
    size = load_character(body).size
    assert app.scene.terrain.unit_m == pytest.approx(size)
    app.scene.put_character(2.0, 1.0, 0.0)
    run(app, 2)
    before = app.scene.simulation.current.root_position[[0, 2]] * size
    app.settings.fit_to_motion = True
    run(app, 2)
    assert app.scene.terrain.unit_m == 1.0
    assert np.allclose(app.scene.simulation.current.root_position[[0, 2]], before, atol=0.1)


def test_every_form_with_a_character_can_fit_it_to_the_motion() -> None:
    for form in FORMATS.values():
        assert ("character" in form.options) == ("fit_to_motion" in form.options), form.suffix


@pytest.mark.parametrize("pitch", [0.05, 0.12, 0.2])
def test_a_heel_that_comes_down_stays_over_the_ground(body: Path, pitch: float) -> None:
    """Our ankle is held at its height whatever the pitch: the heel behind it lies deeper, and a giant's by more."""
    character, pose = load_character(body), rolled(pitch, 0.3)
    local = pose.local_rotations.copy()
    hips = pose.hips_position.copy()
    hips[1] += 0.066 - pose.positions[SPORT_SKELETON.index("LeftFoot"), 1]  # as the foot lock leaves it
    contacts = np.array([0.4, 0.3, 0.0, 0.0], np.float32)
    clip = Clip("strike", 60.0, hips[None].astype(np.float32), local[None].astype(np.float32), contacts[None])
    low = skin_vertices(soles(character, "Left"), character.skin_matrices(clip.pose(0)))[:, 1].min()
    assert low * character.size > -0.01


@pytest.mark.parametrize(("unit", "high_m"), [(None, 1.8), ("m", 18.0), ("cm", 0.18), ("mm", 0.083)])
def test_a_guessed_unit_is_said_and_can_be_overruled(unit: str | None, high_m: float, tmp_path: Path) -> None:
    """A body of 18 units is taken for decimetres; one of 18 mm is as small as a body may be."""
    import pygltflib

    path = RIGS["mixamo"](tmp_path / "large.glb")
    before = load_character(path)
    gltf = pygltflib.GLTF2().load(str(path))
    high = before.height * before.size
    for node in (gltf.nodes[k] for k in gltf.scenes[gltf.scene or 0].nodes):
        node.scale = [v * 18.0 / high for v in (node.scale or [1.0] * 3)]
    gltf.save(str(path))
    character = load_character(path, unit=unit)
    assert character.height * character.size == pytest.approx(high_m, rel=0.1)
    said = {None: "taken as 1.", "mm": "taken as 0.08"}.get(unit)
    assert bool(character.note) == (said is not None)
    assert (said or "") in character.note
