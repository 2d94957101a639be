"""A BVH of another skeleton plays as reference on ours, and an opened take lies on its own ground."""

from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.character.joint_map import save_joint_map
from runtime.errors import FileError
from runtime.formats.bvh import format_bvh
from runtime.formats.bvh_clip import load_clip_bvh, save_bvh
from runtime.formats.prepare import ExportOptions, prepare
from runtime.formats.reference import open_take
from runtime.skeleton import SPORT_SKELETON, Skeleton
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.library import load_terrain
from sport import cli
from tests.helpers.app_driver import Start, do, message, run
from tests.helpers.height_maps import write_height_png
from tests.helpers.walker import walk
from viewer.app import App

TURNS = {  # of the axes of a file
    "as ours": rotations.identity(),
    "facing +X": rotations.from_yaw(np.pi / 2),
    "Z up": rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(np.pi / 2)),
}
NAMES = tuple(f"mixamorig:{name}" for name in SPORT_SKELETON.names)


def foreign(path: Path, turn: np.ndarray, names: tuple[str, ...] = NAMES, stand: bool = True) -> Path:
    """A walk on our skeleton, 1.5 times as large and with other axes, from somewhere else; centimetres.

    Without `stand` its rest pose is a heap, and its first frame stands.
    """
    hips, local, _ = walk(90)
    still = rotations.identity((1, 31))
    hips, local = np.concatenate([hips[:1], hips]), np.concatenate([still, local])
    local = rotations.multiply(rotations.multiply(turn, local), rotations.inverse(turn))
    offsets = rotations.rotate(turn, SPORT_SKELETON.offsets.astype(float)) * 1.5
    if not stand:
        # of bones against the rest pose
        heap = rotations.normalize(np.random.default_rng(2).normal(size=(31, 4)))
        above = np.concatenate([rotations.identity((1,)), heap[list(SPORT_SKELETON.parents[1:])]])
        offsets = rotations.rotate(rotations.inverse(above), offsets)
        local = rotations.multiply(rotations.multiply(rotations.inverse(above), local), heap)
    skeleton = Skeleton(names, SPORT_SKELETON.parents, offsets.astype(np.float32))
    places = rotations.rotate(turn, hips * 1.5) + np.array([3.0, 0.5, -2.0])
    path.write_text(format_bvh(skeleton, {0: places}, local, 60.0), encoding="utf-8")
    return path


@pytest.mark.parametrize(("axes", "stand"), [*((axes, True) for axes in TURNS), ("as ours", False)])
def test_another_skeleton_moves_ours_as_it_moved(tmp_path: Path, axes: str, stand: bool) -> None:
    reference = open_take(foreign(tmp_path / "other.bvh", TURNS[axes], stand=stand)).reference
    assert reference.scale == pytest.approx(0.01 / 1.5, rel=1e-3)
    hips, local, _ = walk(90)
    wanted, _ = SPORT_SKELETON.forward_kinematics(hips - hips[0] * (1, 0, 1), local)
    if axes == "facing +X":  # it goes on as it went in its file
        wanted = rotations.rotate(TURNS[axes], wanted)
    gap = reference.clip.world()[0][1:] - wanted
    assert np.abs(gap[..., [0, 2]]).max() < 2e-3
    assert np.ptp(gap[..., 1]) < 2e-3
    assert abs(gap[..., 1]).max() < 0.05  # its soles are put on the ground


def test_joints_are_named_beside_the_file(tmp_path: Path) -> None:
    path = foreign(tmp_path / "other.bvh", TURNS["as ours"], tuple(f"n{k}" for k in range(31)))
    told = open_take(path).reference
    assert told.origin == "hierarchy and rest pose"
    save_joint_map(path, {"LeftHand": "n21"})
    assert open_take(path).reference.joints == told.joints
    save_joint_map(path, {"Head": ""})
    with pytest.raises(FileError, match=r"no joints found for Head.*other\.bvh\.joints\.json"):
        open_take(path)


def test_a_foreign_file_is_dropped_and_plays_on_flat_ground(start: Start, tmp_path: Path) -> None:
    app = start(terrain="hills")
    app.open_files([foreign(tmp_path / "other.bvh", TURNS["facing +X"])])
    run(app, 2)
    assert app.takes.playback is not None
    assert "another skeleton" in message(app)
    assert app.takes.ground_to_show().terrain.name == "flat"
    names = tuple("tail" if "Leg" in name else f"m{k}" for k, name in enumerate(SPORT_SKELETON.names))
    path = tmp_path / "worm.bvh"
    skeleton = Skeleton(names, (-1, *range(30)), np.tile(np.float32([0, 0, 0.1]), (31, 1)))
    text = format_bvh(skeleton, {0: np.zeros((2, 3))}, rotations.identity((2, 31)), 60.0)
    path.write_text(text, encoding="utf-8")
    app.open_files([path])
    run(app, 2)
    assert "cannot be retargeted" in message(app)
    assert len(app.editor.session.takes) == 1


def take(path: Path, terrain: str, moved: bool = False) -> Path:
    prompts = (PromptEvent(0.0, "a proud king", 0.0),)
    clip = Clip("up", 60.0, *walk(60), prompts=prompts, terrain=terrain)
    if moved:
        clip = prepare(clip, ExportOptions(at_origin=True), load_terrain("flat")).clip
    return save_bvh(clip, path)


def test_an_opened_take_lies_on_its_ground(app: App, tmp_path: Path) -> None:
    for moved in (False, True):
        app.scene.load_terrain("flat")
        app.open_files([take(tmp_path / f"up{moved}.bvh", "hills", moved)])
        run(app, 2)
        assert "on the ground hills" in message(app)
        playback = app.takes.playback
        assert playback.terrain.name == "hills"
        assert app.scene.renderer.terrain is playback.terrain
        do(app, "close; run 1")
        assert app.scene.renderer.terrain is app.scene.terrain  # the live one is back
        assert app.scene.terrain_spec == "flat"
        assert np.allclose(playback.clip.hips_positions, walk(60)[0], atol=1e-3)
    assert app.settings.terrain == "flat"  # the next start


def test_a_ground_from_a_file_is_looked_for_beside_the_take(start: Start, tmp_path: Path) -> None:
    path = take(tmp_path / "up.bvh", "bowl.png")
    app = start()
    app.open_files([path])
    run(app, 2)
    assert "made on the ground bowl.png" in message(app)
    assert app.scene.terrain_spec == "flat"
    assert app.takes.playback is not None
    (tmp_path / "bowl.png").write_bytes(b"no picture")
    app.open_files([path])
    run(app, 2)
    assert "bowl.png" in message(app)
    assert len(app.editor.session.takes) == 2, "it plays all the same"
    write_height_png(tmp_path / "bowl.png", np.zeros((32, 32), np.float32))
    app.open_files([path])
    run(app, 2)
    assert app.takes.playback.terrain.name == "bowl"


def test_the_command_shows_a_clip_on_its_ground_or_the_one_asked_for(start: Start, tmp_path: Path) -> None:
    path = take(tmp_path / "up.bvh", "hills")
    app = start(clip=path, terrain=None)
    assert app.takes.ground_to_show().terrain.name == "hills"
    app.close()
    app = start(clip=path, terrain="stairs")
    assert app.takes.ground_to_show().terrain.name == app.scene.terrain.name
    assert app.scene.terrain_spec == "stairs"
    assert load_clip_bvh(path).terrain == "hills"


def test_convert_puts_another_skeleton_onto_ours(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    source = foreign(tmp_path / "other.bvh", TURNS["Z up"])
    made = tmp_path / "ours.bvh"
    assert cli.main(["convert", str(source), str(made), str(tmp_path / "ours.glb")]) == 0
    assert "other.bvh, another skeleton: 31 of 31 joints" in capsys.readouterr().err
    assert (tmp_path / "ours.glb").read_bytes()[:4] == b"glTF"
    ours, wanted = load_clip_bvh(made).world()[0], open_take(source).reference.clip.world()[0]
    assert ours == pytest.approx(wanted, abs=1e-3)
