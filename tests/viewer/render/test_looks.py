"""Looks of the character: parts have colours of their own, and the rest of the mesh stays."""

import pytest

from runtime.assets import asset_path, character_file
from runtime.character.character import load_character
from runtime.formats.glb import MANNEQUIN
from runtime.skeleton import PART_NAMES
from tests.helpers.app_driver import Start, click_on, do
from tests.helpers.gltf_characters import user_character
from viewer.render.looks import dressed, part_of_vertices
from viewer.services import load_character as load_character_file


def test_parts_are_where_the_body_has_them() -> None:
    mannequin = load_character(asset_path(MANNEQUIN))
    part = part_of_vertices(mannequin)
    middle = {name: mannequin.positions[part == k].mean(0) for k, name in enumerate(PART_NAMES)}
    assert middle["head"][1] > middle["torso"][1] > middle["left_leg"][1]
    assert middle["left_arm"][0] > 0.2 > -0.2 > middle["right_arm"][0]
    assert middle["left_leg"][0] > 0.0 > middle["right_leg"][0]


def test_a_character_is_chosen_in_the_window_and_taken_back(start: Start) -> None:
    app = start(services={"load_character": load_character_file})
    click_on(app, "Files, body, links")
    assert (app.scene.character_name, app.scene.character_path) == ("walker", character_file("walker"))
    click_on(app, "##mannequin")
    assert app.scene.character_name == "mannequin"
    do(app, "undo; run 3")
    assert app.scene.character_name == "walker"
    assert app.scene.character_path.read_bytes() == character_file("walker").read_bytes()


def test_looks_change_nothing_but_colours() -> None:
    character = user_character()
    assert dressed(character, "own") is character
    for look in ("contrast", "parts"):
        made = dressed(character, look)
        assert made.positions is character.positions
        assert made.colors.shape == character.colors.shape
        assert made.colors.min() >= 0.0
        assert made.colors.max() <= 1.0


def test_a_look_is_chosen_and_kept(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []
    monkeypatch.setattr("viewer.scene.scene.dressed", lambda character, look: shown.append(look) or character)
    app = start()
    do(app, "click Files, body, links; click ##parts")
    assert app.settings.look == shown[-1] == "parts"
