"""The real application without a display: grounds, characters, dropped files, and models that fail."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from runtime.assets import asset_path, character_file
from runtime.character.writer import write_character
from runtime.controls import Controls
from runtime.errors import SportError
from tests.helpers.app_driver import InjectedPads, Start, controller, do, message, record, run
from tests.helpers.gltf_characters import user_character
from tests.helpers.height_maps import write_height_png
from tests.helpers.viewer_fakes import FakeRenderer, fake_services
from viewer.app import App
from viewer.messages import Level
from viewer.options import ViewOptions
from viewer.scene.simulation import MAX_FAILURES
from viewer.services import Services


def test_a_missing_terrain_shows_a_message_and_keeps_the_old_one(app: App) -> None:
    before = app.scene.terrain
    for spec in ("moon", "/nowhere/map.png"):
        app.scene.load_terrain(spec)
        run(app)
        assert Path(spec).name in message(app)
        assert app.messages.current.level is Level.ERROR  # type: ignore[union-attr]
        assert app.scene.terrain is before
        assert app.scene.loading == ""


@pytest.mark.parametrize(("option", "said"), [({"terrain": "moon"}, "moon"), ({"prompt": " "}, "empty")])
def test_offscreen_a_wrong_option_is_an_error(option: dict[str, str], said: str, tmp_path: Path) -> None:
    options = ViewOptions(**{"offscreen": True, "terrain": "flat", **option})
    with pytest.raises(SportError, match=said):
        App(options, fake_services(), InjectedPads(), tmp_path)


def test_terrain_reaches_model_and_renderer(app: App) -> None:
    do(app, "ground stairs; run 1")
    renderer = app.scene.renderer
    assert isinstance(renderer, FakeRenderer)
    assert controller(app).terrain is app.scene.terrain is renderer.terrain
    assert app.scene.terrain.name == "stairs"


def test_strength_reaches_the_model_and_stays_in_the_settings(app: App) -> None:
    app.settings.strength = 1.2
    run(app)
    assert controller(app).strength == 1.2
    app.load_model(None, 0)
    run(app)
    assert controller(app).strength == 1.2


def test_response_reaches_the_model_from_the_command_and_the_scene(start: Start) -> None:
    app = start(response=0.5)
    run(app)
    assert controller(app).response == 0.5
    app.settings.response = 1.0
    run(app)
    assert controller(app).response == 1.0


def test_dropped_files_go_where_they_belong(app: App, tmp_path: Path) -> None:
    shutil.copy(asset_path("character/mannequin.glb"), tmp_path / "hero.glb")
    app.open_files([tmp_path / "hero.glb", tmp_path / "notes.txt"])
    run(app)
    assert app.scene.renderer.character.path == tmp_path / "hero.glb"
    assert app.scene.terrain_spec == "flat"
    assert ".txt" in message(app)
    damaged = tmp_path / "walk.bvh"
    damaged.write_text("HIERARCHY\n", encoding="utf-8")
    app.open_files([damaged])
    run(app)
    assert "walk.bvh" in message(app)
    assert app.editor.session.takes == ()


def test_a_glb_of_a_take_that_was_exported_here_is_a_take_alone(app: App, tmp_path: Path) -> None:
    app.settings.export_folder = str(tmp_path)
    record(app, 40)
    app.exporting.open()
    app.exporting.export()
    run(app, 3)
    before = app.editor.session
    assert app.exporting.saved is not None
    app.open_files([app.exporting.saved])
    run(app, 3)
    assert len(app.editor.session.takes) == len(before.takes) + 1
    assert app.editor.session.character == before.character


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".off", ".obj"])
def test_a_dropped_mesh_without_a_skin_is_a_ground(start: Start, tmp_path: Path, suffix: str) -> None:
    import trimesh

    ground = tmp_path / f"block{suffix}"
    trimesh.creation.box((6.0, 0.5, 4.0)).export(str(ground))
    app = start()
    run(app)
    character = app.scene.renderer.character
    app.open_files([ground])
    run(app)
    assert app.scene.terrain_spec == str(ground)
    assert app.scene.terrain.height(0.0, 0.0) == pytest.approx(0.25)
    assert app.scene.renderer.character is character


def test_a_fault_that_the_character_recovers_from_is_told_once_and_halts_if_it_comes_in_every_step(
    app: App,
) -> None:
    fake = controller(app)
    fake.message = "The network gave rubbish."
    run(app, 1)
    fake.message = ""
    app.messages.note("Something else.")
    run(app, MAX_FAILURES + 2)
    assert "Something else." in message(app)
    assert not app.scene.simulation.halted
    fake.message = "The network gave rubbish."
    run(app, MAX_FAILURES + 2)
    assert app.scene.simulation.halted
    assert "until you reset it" in message(app)


@pytest.mark.parametrize("broken", ["nan", "exception"])
def test_a_failing_model_leaves_the_last_good_pose(app: App, broken: str) -> None:
    good = app.scene.simulation.current
    fake = controller(app)
    if broken == "nan":
        fake.answer_nan = True
    else:
        fake.fail_with = RuntimeError("bad weights")
    run(app, MAX_FAILURES + 2)
    assert app.scene.simulation.current is good
    assert app.scene.simulation.halted
    assert "model failed" in message(app)
    fake.answer_nan, fake.fail_with = False, None
    app.scene.reset_character()
    app.window.inject_key("w", True)
    run(app, 3)
    assert fake.z > 0.0


@pytest.mark.parametrize("panels", [True, False])
def test_without_panels_saved_frames_hold_the_scene_alone(start: Start, tmp_path: Path, panels: bool) -> None:
    frames = tmp_path / "frames"
    app = start(real_renderer=True, width=640, height=360, panels=panels, frames_directory=frames)
    run(app, 3)
    frame = np.asarray(Image.open(tmp_path / "frames" / "frame_00002.png")).astype(int)
    status, above = frame[-26:], frame[-80:-40]
    dark = above[:, 330:].mean() - status.mean()
    assert (dark > 60) if panels else (abs(dark) < 25), dark


def test_a_slow_machine_goes_to_the_fast_preset_where_nobody_chose_one(app: App) -> None:
    for _ in range(7):
        app.scene.lower_quality(12.0, 1.0)
    assert (app.scene.renderer.quality.name, app.settings.quality) == ("fast", "")
    assert "Fast" in message(app)
    app.scene.set_quality("software")
    for _ in range(7):
        app.scene.lower_quality(12.0, 1.0)
    assert app.scene.renderer.quality.name == "software"


def test_the_motion_keeps_its_own_time_at_five_frames_a_second(app: App) -> None:
    simulation, steps = app.scene.simulation, controller(app).steps
    for _ in range(10):
        simulation.model_ms = 2.0
        app.scene.advance(0.2, Controls())
    assert controller(app).steps - steps == pytest.approx(120, abs=1)
    simulation.model_ms = 100.0  # a model that is slow itself must not hold the display up for ever
    assert len(app.scene.advance(0.2, Controls())) == 6


def test_grounds_of_files_are_in_the_list_and_undo_takes_a_choice_from_the_next_start(
    start: Start, tmp_path: Path
) -> None:
    app, own = start(), tmp_path / "dunes.png"
    write_height_png(own, [[0.0, 0.5], [0.5, 1.0]])
    app.scene.load_terrain("hills")
    assert app.settings.terrain == "hills"
    app.scene.load_terrain(own)
    app.scene.load_terrain("stairs")
    assert app.scene.grounds == [*app.scene.terrain_names, str(own)]
    assert app.settings.terrain == "stairs"
    for remembered in ("hills", "hills", "flat"):  # a file's is shown, but not remembered
        app.editor.undo()
        assert app.settings.terrain == remembered


def test_another_ground_ends_the_take_that_plays(app: App) -> None:
    do(app, "record 30; play 1; run 2; ground hills; run 2")
    assert app.takes.playback is None
    assert app.takes.ground_to_show().terrain is app.scene.terrain


@pytest.mark.parametrize("kept", ["walker", "mannequin", "own"])
def test_the_chosen_character_is_that_of_the_next_start(start: Start, tmp_path: Path, kept: str) -> None:
    own = tmp_path / "own.glb"
    write_character(own, user_character())
    paths = {"walker": character_file("walker"), "mannequin": None, "own": own}
    app = start(services={"load_character": Services().load_character})
    assert app.scene.character_name == "walker", "the one to begin with"
    app.scene.open_character(paths["mannequin" if kept == "walker" else kept])
    if kept == "walker":
        app.editor.undo()
    assert app.settings.character == (str(own) if kept == "own" else kept)
    assert app.remembered_character() == paths[kept]
    own.unlink()
    if kept == "own":
        assert app.remembered_character() == paths["walker"]
        assert "is missing" in message(app)
