"""`sport convert` and the exports of `sport generate`, as they are typed."""

import json
import math
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.table import FORMATS
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.library import load_terrain
from sport import cli
from tests.helpers.foreign_rigs import centimetre_rig
from tests.helpers.glb_playback import play
from tests.helpers.walker import walk
from viewer.scene.simulation import rest_pose
from viewer.tools.contact_sheet import BACK_VIEW_RAD, FRONT_VIEW_RAD, cell_camera
from viewer.tools.contact_sheet import main as contact_sheet

SMALL = ["--size", "96x64", "--quality", "software"]


pytestmark = pytest.mark.usefixtures("walker")


@pytest.fixture
def take(tmp_path: Path) -> Path:
    """A take over hills as BVH, with its metadata."""
    clip = Clip("up", 60.0, *walk(240, terrain=load_terrain("hills")), terrain="hills",
                prompts=(PromptEvent(0.0, "proud"),), gaits=np.ones(240, np.int8))  # fmt: skip
    return save_bvh(clip, tmp_path / "up.bvh")


def test_generate_writes_a_users_character_with_its_ground(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    rig, out = centimetre_rig(tmp_path / "me.glb"), tmp_path / "new" / "take.glb"
    assert cli.main(["generate", "--character", str(rig), "--seconds", "1", "--terrain", "stairs", "--with-ground",
                       "--fps", "30", "--out", str(out)]) == 0  # fmt: skip
    said = capsys.readouterr()
    assert f"{out}: 30 frames at 30 fps, 1.0 s" in said.out
    assert f"{out.parent}: this folder is new" in said.err
    played = play(out)
    assert {"pelvis", "root", "thigh_l"} <= set(played.joints())
    assert len(played.times) == 30
    assert played.node("Ground") > 0
    marks = played.gltf.animations[0].extras["sport"]["markers"]
    assert {"prompt", "gait"} == {mark["kind"] for mark in marks}


def test_convert_writes_what_each_ending_says(take: Path, capsys: pytest.CaptureFixture) -> None:
    glb, mp4, obj, bvh = (take.with_name("out" + suffix) for suffix in (".glb", ".mp4", ".obj", ".bvh"))
    files = [str(path) for path in (take, glb, mp4, obj, bvh)]
    assert cli.main(["convert", *files, *SMALL, "--range", "1:2"]) == 0
    said = capsys.readouterr()
    assert f"{glb}: 61 frames at 60 fps" in said.out
    assert f"{mp4}: 30 frames at 30 fps, 1.0 s" in said.out
    assert f"{obj}: ground hills in cm" in said.out
    assert "a film of 1.0 s, 30 frames" in said.err
    assert "out.mp4: 30 of 30 frames" in said.err
    assert play(glb).gltf.scenes[0].extras["sport"]["ground"] == "hills"
    with av.open(str(mp4)) as film:
        assert sum(1 for _ in film.decode(video=0)) == 30
    assert obj.read_text().count("\nv ") == load_terrain("hills").heights.size
    assert len(load_clip_bvh(bvh)) == 61


def test_options_of_form_reach_the_file(take: Path, capsys: pytest.CaptureFixture) -> None:
    out, ground = take.with_name("loop.glb"), take.with_name("ground.obj")
    assert cli.main(["convert", str(take), str(out), "--loop", "--at-origin", "--ground-root", "--rest-frame",
                       "--ground-out", str(ground)]) == 0  # fmt: skip
    said = capsys.readouterr().out
    assert "loop of" in said
    assert f"{ground}: ground hills in m" in said
    played = play(out)
    assert np.allclose(played.joints()["Root"][0, :3, 3], 0.0, atol=1e-4)
    extras = played.gltf.animations[0].extras["sport"]
    assert extras["rest_frame"]
    assert extras["loop"]["seam_cm"] <= 1.0
    assert extras["loop"]["seam_degrees"] <= 2.0


def test_numbered_frames_and_variants(take: Path, capsys: pytest.CaptureFixture) -> None:
    frames = take.parent / "frames" / "f.png"
    assert cli.main(["convert", str(take), str(frames), *SMALL, "--fps", "5", "--no-captions"]) == 0
    assert [p.name for p in sorted(frames.parent.iterdir())][:2] == ["f_00000.png", "f_00001.png"]
    assert len(list(frames.parent.iterdir())) == 20
    assert Image.open(frames.with_name("f_00000.png")).size == (96, 64)
    out = take.with_name("v.bvh")
    start = ["generate", "--seconds", "0.5"]
    assert cli.main([*start, "--seed", "4", "--variants", "2", "--out", str(out)]) == 0
    assert cli.main([*start, "--seed", "5", "--out", str(take.with_name("five.bvh"))]) == 0
    assert not out.exists()
    assert take.with_name("v-2.bvh").read_bytes() == take.with_name("five.bvh").read_bytes()
    assert take.with_name("v-1.bvh").read_bytes() != take.with_name("v-2.bvh").read_bytes()
    assert json.loads(take.with_name("v-2.bvh.json").read_text())["seed"] == 5


@pytest.mark.parametrize("command", ["generate", "convert"])
@pytest.mark.parametrize("name", ["x.abc", "x", "x.GLTF", "take.bvh.txt"])
def test_an_ending_that_nothing_writes_is_refused_with_those_that_are(
    command: str, name: str, take: Path, capsys: pytest.CaptureFixture
) -> None:
    out = take.with_name(name)
    arguments = ["generate", "--out", str(out)] if command == "generate" else ["convert", str(take), str(out)]
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for suffix in FORMATS:
        assert suffix in error
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["x.mp4", "--in-place"], "--in-place: nothing that a .mp4 file has"),
        (["x.mp4", "--size", "97x64"], "even numbers"),
        (["x.mp4", "--camera", "moon"], "--camera moon"),
        (["x.glb", "--range", "5"], "--range 5"),
        (["x.glb", "--range", "9:"], "--range 9: the clip lasts"),
        (["x.glb", "--character", "gone.glb"], "gone.glb"),
        (["x.glb", "--in-place", "--with-ground"], "--in-place"),
        (
            ["x.bvh", "--with-ground"],
            "--with-ground: nothing that a .bvh file has; .glb, .fbx, .usdz, .usd have it",
        ),
        (["x.glb", "y.glb", "--ground-out", "g.obj"], "--ground-out"),
        (["up.bvh"], "overwrite itself"),
    ],
)
def test_mistakes_are_one_sentence_and_leave_no_file(
    take: Path, arguments: list[str], expected: str, capsys: pytest.CaptureFixture
) -> None:
    before = sorted(take.parent.iterdir())
    made = [str(take.with_name(a)) if a.endswith((".mp4", ".glb", ".bvh", ".obj")) else a for a in arguments]
    assert cli.main(["convert", str(take), *made]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("sport: ")
    assert expected in error
    assert sorted(take.parent.iterdir()) == before


def test_a_colour_height_map_is_noted(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    Image.new("RGBA", (64, 64), (9, 9, 9, 255)).save(tmp_path / "map.png")
    arguments = ["--seconds", "0.2", "--terrain", str(tmp_path / "map.png"), "--out", str(tmp_path / "x.bvh")]
    assert cli.main(["generate", *arguments]) == 0
    assert "map.png: colours (RGBA, 8 bits) were read as grey" in capsys.readouterr().err


def test_a_contact_sheet_shows_each_clip_on_its_own_ground(take: Path) -> None:
    sheets = {}
    for name, options in (("own", []), ("flat", ["--terrain", "flat"]), ("hills", ["--terrain", "hills"])):
        out = take.with_name(f"{name}.png")
        words = [str(take), "--out", str(out), "--columns", "1", "--start", "3", "--labels", "x", *options]
        assert contact_sheet(words) == 0
        sheets[name] = np.asarray(Image.open(out)).astype(int)
    assert np.array_equal(sheets["own"], sheets["hills"])
    assert np.abs(sheets["own"] - sheets["flat"]).max() > 30


@pytest.mark.parametrize("view_rad", [FRONT_VIEW_RAD, BACK_VIEW_RAD])
def test_cells_of_a_contact_sheet_are_seen_from_above_the_ground(view_rad: tuple[float, float]) -> None:
    ground = load_terrain("stairs")
    for z in np.arange(0.0, 12.0, 0.4):
        for yaw in (0.0, math.pi):
            camera = cell_camera(rest_pose(ground, 0.0, float(z), yaw), ground, view_rad)
            line = camera.target + np.linspace(0.2, 1.0, 40)[:, None] * (camera.position - camera.target)
            assert (line[:, 1] > ground.height(line[:, 0], line[:, 2]) + 0.05).all()
