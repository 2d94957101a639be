"""The real application without a display: joints of a character named by hand, and files that open."""

import json
from pathlib import Path

import pytest

from runtime.assets import character_file
from runtime.character.character import load_character
from runtime.character.guess import JointsUnknown
from runtime.character.joint_map import joint_map_path
from runtime.character.writer import write_character
from tests.helpers.app_driver import Start, click_on, do, drawn, message, press, run
from tests.helpers.gltf_characters import user_character
from tests.helpers.odd_rigs import PLAIN, write_odd
from viewer.app import App
from viewer.services import Services

REAL = {"load_character": Services().load_character}
# a tree that tells nothing
LAME = {name: ("a" if parent else "", place) for name, (parent, place) in PLAIN.items()}
BY_HAND = {"Hips": "a", "Spine1": "c", "Neck1": "d", "Head": "e"} | {
    f"{side}{bone}": f"{side[0]} {letter}"
    for side in ("Left", "Right")
    for bone, letter in zip(("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot"), "fghijk", strict=True)
}


def open_lame(start: Start, tmp_path: Path) -> tuple[App, Path]:
    path = write_odd(tmp_path / "lame.glb", LAME)
    app = start(services=REAL)
    app.open_files([path])
    run(app, 3)
    return app, path


def test_a_character_that_no_guess_maps_opens_the_joints_window(start: Start, tmp_path: Path) -> None:
    app, path = open_lame(start, tmp_path)
    state = app.scene.joints
    assert state.open
    assert "LeftUpLeg" in state.missing
    assert "window Joints" in message(app)
    assert "--joint-map" in message(app)
    labels = [label for label, _ in drawn(app)]
    assert "##joint LeftArm" in labels
    click_on(app, "##apply joints")  # not yet
    assert app.scene.character_path == character_file("walker")  # the one before
    assert not joint_map_path(path).exists()


def test_joints_chosen_from_the_lists_are_kept_and_used_again(start: Start, tmp_path: Path) -> None:
    app, path = open_lame(start, tmp_path)
    click_on(app, "##joint Hips")
    click_on(app, f"##{list(LAME).index('a')}")
    assert app.scene.joints.plays("Hips") == "a"
    for joint, name in BY_HAND.items():
        app.scene.joints.choose(joint, name)
    do(app, "run 2; click ##apply joints")
    assert not app.scene.joints.open
    assert app.scene.character_path == path
    kept = json.loads(joint_map_path(path).read_text(encoding="utf-8"))
    assert kept == {joint: name for joint, name in BY_HAND.items() if joint in kept}
    character = load_character(path)
    assert character.joint_names[list(character.sport_joints).index(18)] == "L f"
    app.close()
    again = start(services=REAL, character=path)  # the command takes it without a word
    assert again.scene.character_path == path


def test_a_joint_plays_one_part_and_guesses_come_back(start: Start, tmp_path: Path) -> None:
    write_character(tmp_path / "user.glb", user_character())
    app = start(services=REAL, character=tmp_path / "user.glb")
    app.scene.joints.begin(tmp_path / "user.glb")
    run(app, 3)
    joints = app.scene.joints
    neck = joints.plays("Neck1")
    assert neck
    assert not joints.missing
    joints.choose("Head", neck)
    assert joints.plays("Neck1") == ""
    joints.choose("Head", "")
    assert joints.missing == ["Head"]
    do(app, "run 2; click ##guess all")
    assert joints.plays("Neck1") == neck
    assert not joints.missing
    press(app, "escape")
    assert not joints.open


def test_a_joint_map_from_elsewhere_is_given_to_the_command(start: Start, tmp_path: Path) -> None:
    path, elsewhere = write_odd(tmp_path / "lame.glb", LAME), tmp_path / "mine.json"
    elsewhere.write_text(json.dumps(BY_HAND), encoding="utf-8")
    app = start(services=REAL, character=path, joint_map=elsewhere)
    assert app.scene.character_path == path
    assert not app.scene.joints.open
    assert not joint_map_path(path).exists()


def test_a_vrm_is_dropped_chosen_in_the_dialog_and_given_to_the_command(start: Start, tmp_path: Path) -> None:
    path = tmp_path / "avatar.vrm"
    write_character(path, user_character())
    app = start(services=REAL)
    app.open_files([path])
    assert app.scene.character_path == path
    app.scene.open_character(None)
    do(app, "run 2; click Files, body, links; click ##browse file")
    question = app.sessions.dialogs.question
    assert "*.vrm" in question.filters[1].split()
    question.done(path)
    assert app.scene.character_path == path
    app.close()
    assert start(services=REAL, character=path).scene.character_path == path


def test_without_a_window_the_command_says_what_to_do(start: Start, tmp_path: Path) -> None:
    with pytest.raises(JointsUnknown, match=r"lame\.glb\.joints\.json"):
        start(services=REAL, character=write_odd(tmp_path / "lame.glb", LAME))


def test_the_joints_window_goes_to_the_character_that_is_chosen(start: Start, tmp_path: Path) -> None:
    app, paths = start(services={"load_character": Services().load_character}), []
    for name in ("one.glb", "two.glb"):
        paths.append(tmp_path / name)
        write_character(paths[-1], user_character())
    app.scene.open_character(paths[0])
    app.scene.joints.begin(paths[0])
    run(app, 2)
    assert app.scene.joints.shown == paths[0]
    app.scene.open_character(paths[1])
    run(app, 2)
    assert app.scene.joints.shown == paths[1]
    app.scene.open_character(None)
    run(app, 2)
    assert app.scene.joints.shown is None
