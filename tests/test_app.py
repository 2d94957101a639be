"""The real application without a display: PLATFORM_NULL and EGL, a fake motion model, injected devices."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from viewer_fakes import FakeController, FakeRenderer, fake_services

from runtime.bvh import read_bvh
from runtime.errors import DisplayError, SportError, UsageError
from runtime.terrain import Terrain
from viewer import app as app_module
from viewer.app import App
from viewer.input.gamepad import GamepadState
from viewer.messages import Level, Messages
from viewer.options import ViewOptions
from viewer.panels.layout import Rect, arrange
from viewer.playback import Playback
from viewer.settings import Settings, config_directory, load_settings, save_settings
from viewer.simulation import MAX_FAILURES, MAX_STEPS, Simulation, interpolate
from viewer.takes import export_target, file_stem, free_path
from viewer.window import KEY_CODES


class InjectedPads:
    """A source whose pad the test sets."""

    def __init__(self) -> None:
        self.state: GamepadState | None = None

    def poll(self) -> GamepadState | None:
        return self.state


Start = Callable[..., App]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Opens the application offscreen on flat ground; closes what the test leaves open."""
    apps: list[App] = []

    def open_app(real_renderer: bool = False, **options: Any) -> App:
        chosen = {"offscreen": True, "terrain": "flat", **options}
        app = App(ViewOptions(**chosen), fake_services(real_renderer), InjectedPads(), tmp_path / "config")
        apps.append(app)
        return app

    yield open_app
    for app in apps:
        app.close()


def run(app: App, frames: int = 1) -> None:
    for _ in range(frames):
        app.frame()


def controller(app: App) -> FakeController:
    found = app.state.simulation.controller
    assert isinstance(found, FakeController)
    return found


def click(app: App, x: float, y: float) -> None:
    for down in (False, True, False):
        app.window.inject_mouse(x, y, 0 if down or app.frames_shown else None, down)
        run(app, 2)


def click_prompt_box(app: App) -> None:
    click(app, 160, 70)


def message(app: App) -> str:
    current = app.state.messages.current
    return "" if current is None else current.text


# --- the window


def test_first_frame_shows_scene_and_panels(start: Start) -> None:
    app = start(real_renderer=True, width=640, height=400, panels=True)
    run(app, 2)
    picture = app.window.read_pixels()
    assert picture.shape == (400, 640, 3)
    assert picture[:30].mean() > 90  # the bright sky
    assert picture[-15:, 300:].mean() < 60  # the dark status line
    assert app.state.model_name == "fake"
    assert app.state.prompt.parts["torso"] != ""


def test_two_runs_show_the_same_picture(start: Start) -> None:
    pictures = []
    for _ in range(2):
        app = start(real_renderer=True, width=320, height=240, panels=False, controls="w 1")
        run(app, 8)
        pictures.append(app.window.read_pixels()[: 240 - 32])  # without the status line: it shows times
        app.close()
    assert np.array_equal(*pictures)


@pytest.mark.parametrize("size", [(333, 217), (1921, 1081), (64, 64), (2000, 200)])
def test_resize_to_odd_sizes(start: Start, size: tuple[int, int]) -> None:
    app = start()
    run(app)
    app.window.resize(*size)
    run(app, 3)
    assert app.window.framebuffer.size == size
    assert app.window.read_pixels().shape == (size[1], size[0], 3)


def test_change_of_scale_does_not_add_up(start: Start) -> None:
    from viewer.gl_bindings import imgui

    app = start()
    run(app)
    before = imgui.get_style().window_padding.x
    for scale in (2.0, 1.0):
        app.window._wanted_scale = scale
        run(app)
    assert imgui.get_style().window_padding.x == before


def test_minimised_window_draws_nothing_and_comes_back(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    app = start()
    run(app)
    drawn = app.frames_shown
    monkeypatch.setattr(type(app.window), "pixels", property(lambda self: (0, 0)))
    run(app, 2)
    assert app.frames_shown == drawn
    monkeypatch.undo()
    run(app)
    assert app.frames_shown == drawn + 1


def test_without_a_display_the_error_names_the_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(DisplayError, match="--offscreen"):
        App(ViewOptions(), fake_services(), InjectedPads(), tmp_path)


@pytest.mark.parametrize(
    "options",
    [
        {"width": 5},
        {"frames": 0},
        {"ui_scale": 9.0},
        {"camera": "side"},
        {"controls": "jump"},
        {"frames_directory": Path("x")},
    ],
)
def test_options_are_checked_before_a_window_opens(options: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="--"):
        App(ViewOptions(**options), fake_services())


# --- driving


def test_key_w_moves_the_character_at_once(start: Start) -> None:
    app = start()
    run(app)
    app.window.inject_key("w", True)
    run(app, 1)
    assert controller(app).z > 0.0
    run(app, 29)
    app.window.inject_key("w", False)
    run(app, 1)
    distance = math.hypot(controller(app).x, controller(app).z)
    assert distance == pytest.approx(1.4 * 0.5, rel=0.05)
    run(app, 10)
    assert math.hypot(controller(app).x, controller(app).z) == pytest.approx(distance)


def test_scripted_controls_walk_then_jog(start: Start) -> None:
    app = start(controls="w 0.5; w+shift 0.5; idle 1", camera="orbit")
    run(app, 90)
    assert controller(app).z == pytest.approx(1.4 * 0.5 + 3.0 * 0.5, rel=0.05)


def test_stick_moves_relative_to_the_camera(start: Start) -> None:
    app = start(camera="orbit")
    run(app)
    app.camera.orbit.yaw = math.pi / 2  # looks along +X
    app.pads.state = GamepadState("pad", left=(0.0, 1.0))
    run(app, 10)
    assert controller(app).x > 0.1
    assert abs(controller(app).z) < 1e-6
    assert app.state.device == "pad"
    assert "pad connected" in message(app)
    app.pads.state = None
    run(app)
    assert app.state.device == "keyboard"


def test_typing_fills_the_prompt_and_never_drives(start: Start) -> None:
    app = start()
    run(app, 2)
    click_prompt_box(app)
    app.window.inject_key("w", True)
    app.window.inject_text("w")
    app.window.inject_key("w", False)
    app.window.inject_text("addling duck ")
    run(app, 3)
    assert controller(app).z == 0.0
    assert "waddling duck" in app.state.prompt.text
    app.window.inject_key("enter", True)
    app.window.inject_key("enter", False)
    run(app, 4)
    assert "waddling duck" in app.state.prompt.shown_prompt
    assert "waddling duck" in app.state.prompt.parts["head"]
    assert app.state.prompt.answered_by == "library"
    assert controller(app).styles[-1][1] == app.state.settings.blend_seconds
    app.window.inject_key("w", True)  # Enter left the field
    run(app, 2)
    assert controller(app).z > 0.0


def test_escape_leaves_the_text_field(start: Start) -> None:
    app = start()
    run(app, 2)
    click_prompt_box(app)
    app.window.inject_key("escape", True)
    app.window.inject_key("escape", False)
    run(app, 2)
    app.window.inject_key("w", True)
    run(app, 2)
    assert controller(app).z > 0.0


def test_focus_loss_releases_keys(start: Start) -> None:
    app = start()
    run(app, 2)
    app.window.inject_key("w", True)
    run(app, 2)
    app.window.inject_focus(False)
    before = controller(app).z
    run(app, 5)
    assert controller(app).z == before > 0.0


def test_function_keys_toggle_what_is_shown(start: Start) -> None:
    app = start()
    run(app)
    assert not app.state.settings.show_skeleton
    for key in ("f3", "f1", "f10"):
        app.window.inject_key(key, True)
    run(app, 2)
    assert app.state.settings.show_skeleton
    assert app.scene.renderer.overlays.show_skeleton
    assert app.state.help_open
    assert not app.state.panels_open
    app.window.inject_key("escape", True)
    run(app)
    assert not app.state.help_open


# --- prompts


def test_edited_part_is_encoded_again(start: Start) -> None:
    app = start()
    run(app)
    styles = len(controller(app).styles)
    app.state.prompt.parts["left_arm"] = "left arm raised"
    app.prompting.submit_parts()
    run(app)
    assert len(controller(app).styles) == styles + 1
    assert app.state.prompt.answered_by == "edited"
    app.state.prompt.parts["left_arm"] = "  "
    app.prompting.submit_parts()
    assert "left_arm" in message(app)
    assert len(controller(app).styles) == styles + 1


def test_a_prompt_that_cannot_be_used_keeps_the_style(start: Start) -> None:
    app = start(prompt="a proud king")
    run(app)
    app.prompting.submit_prompt("   ")
    run(app)
    assert "empty" in message(app)
    assert app.state.prompt.shown_prompt == "a proud king"


# --- scene


def test_a_missing_terrain_shows_a_message_and_keeps_the_old_one(start: Start) -> None:
    app = start()
    run(app)
    before = app.state.terrain
    for spec in ("moon", "/nowhere/map.png"):
        app.scene.load_terrain(spec)
        run(app)
        assert Path(spec).name in message(app)
        assert app.state.messages.current.level is Level.ERROR  # type: ignore[union-attr]
        assert app.state.terrain is before
        assert app.state.scene.loading == ""


def test_offscreen_a_wrong_option_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SportError, match="moon"):
        App(ViewOptions(offscreen=True, terrain="moon"), fake_services(), InjectedPads(), tmp_path)


def test_offscreen_a_prompt_that_cannot_be_used_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SportError, match="empty"):
        App(
            ViewOptions(offscreen=True, terrain="flat", prompt=" "), fake_services(), InjectedPads(), tmp_path
        )


def test_terrain_reaches_model_and_renderer(start: Start) -> None:
    app = start()
    run(app)
    app.scene.load_terrain("stairs")
    run(app)
    renderer = app.scene.renderer
    assert isinstance(renderer, FakeRenderer)
    assert controller(app).terrain is app.state.terrain is renderer.terrain
    assert app.state.terrain.name == "stairs"


def test_dropped_files_go_where_they_belong(start: Start, tmp_path: Path) -> None:
    app = start()
    run(app)
    app.window._events.drop([tmp_path / "hero.glb", tmp_path / "notes.txt"])
    run(app)
    assert app.scene.renderer.character.path == tmp_path / "hero.glb"
    assert ".txt" in message(app)
    damaged = tmp_path / "walk.bvh"
    damaged.write_text("HIERARCHY\n", encoding="utf-8")
    app.window._events.drop([damaged])
    run(app)
    assert "walk.bvh" in message(app)
    assert app.state.clips.items == []


def test_random_use_never_breaks_the_interface(start: Start) -> None:
    """A monkey presses, clicks, types and resizes; the loop must go on and the state stay drawable."""
    app = start(width=900, height=600)
    random = np.random.default_rng(1)
    keys = [name for name in KEY_CODES if name != "f11"]
    app.state.settings.export_folder = str(app.config)  # whatever it saves stays in the test's folder
    for _ in range(150):
        width, height = app.window.size
        x, y = random.uniform(0, width), random.uniform(0, height)
        app.window.inject_mouse(x, y, int(random.integers(3)), bool(random.integers(2)))
        app.window.inject_key(str(random.choice(keys)), bool(random.integers(2)))
        app.window.inject_text(str(random.choice(["a", "é", "日", "\U0001f600", " "])))
        if random.random() < 0.03:
            app.window.resize(int(random.integers(64, 1400)), int(random.integers(64, 900)))
        if random.random() < 0.05:
            app.takes.save_last()
        run(app)
    assert np.isfinite(app.state.simulation.current.positions).all()


@pytest.mark.parametrize("broken", ["nan", "exception"])
def test_a_failing_model_leaves_the_last_good_pose(start: Start, broken: str) -> None:
    app = start()
    run(app, 3)
    good = app.state.simulation.current
    fake = controller(app)
    if broken == "nan":
        fake.answer_nan = True
    else:
        fake.fail_with = RuntimeError("bad weights")
    run(app, MAX_FAILURES + 2)
    assert app.state.simulation.current is good
    assert app.state.simulation.halted
    assert "model failed" in message(app)
    fake.answer_nan, fake.fail_with = False, None
    app.scene.reset_character()
    app.window.inject_key("w", True)
    run(app, 3)
    assert fake.z > 0.0


# --- clips


def record(app: App, frames: int = 30) -> None:
    app.window.inject_key("w", True)
    app.window.inject_key("r", True)
    app.window.inject_key("r", False)
    run(app, frames)
    app.window.inject_key("r", True)
    app.window.inject_key("r", False)
    run(app)
    app.window.inject_key("w", False)
    run(app)


def test_record_play_trim_export(start: Start, tmp_path: Path) -> None:
    app = start()
    run(app, 2)
    record(app)
    clips = app.state.clips
    assert [item.name for item in clips.items] == ["Take 1"]
    take = clips.items[0].clip
    shown = app.scene.renderer.poses  # what the screen showed is what the take holds
    starts = [i for i, pose in enumerate(shown) if np.array_equal(pose.hips_position, take.hips_positions[0])]
    assert starts
    for i in range(len(take)):
        assert np.array_equal(shown[starts[-1] + i].hips_position, take.hips_positions[i])

    app.takes.play(0)
    assert clips.playback is not None
    clips.playback.seek(5)
    clips.playback.trim_in()
    clips.playback.seek(20)
    clips.playback.trim_out()
    run(app)
    clips.export_path = str(tmp_path / "new folder" / "walk")
    app.takes.export()
    run(app)
    assert clips.items[0].saved == tmp_path / "new folder" / "walk.bvh"
    motion = read_bvh(tmp_path / "new folder" / "walk.bvh")
    assert len(motion.positions) == 16
    assert motion.fps == pytest.approx(60.0, abs=1e-3)
    assert motion.positions[0, 0] == pytest.approx(100 * take.hips_positions[5], abs=0.01)


def test_a_failing_export_keeps_the_clip(start: Start, tmp_path: Path) -> None:
    app = start()
    run(app, 2)
    record(app)
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    app.state.clips.export_path = str(blocked / "walk.bvh")
    app.takes.export()
    run(app)
    assert str(blocked) in message(app)
    assert len(app.state.clips.items) == 1
    assert app.state.clips.items[0].saved is None
    app.state.clips.export_path = "  "
    app.takes.export()
    assert "path is empty" in message(app)


def test_the_last_seconds_are_always_in_memory(start: Start) -> None:
    app = start()
    app.state.settings.keep_seconds = 0.25
    run(app, 40)
    app.window.inject_key("t", True)
    run(app)
    assert len(app.state.clips.items[0].clip) == 15
    assert not app.state.clips.recording


def test_moving_leaves_the_playback_and_nothing_else_does(start: Start) -> None:
    app = start()
    run(app, 2)
    record(app)
    app.takes.play(0)
    run(app, 3)
    assert app.state.clips.playback is not None
    app.window.inject_key("w", True)
    run(app)
    assert app.state.clips.playback is None
    app.takes.play(0)  # with the key still held the clip plays on
    run(app, 3)
    assert app.state.clips.playback is not None


def test_unsaved_takes_are_rescued_when_the_program_ends(start: Start, tmp_path: Path) -> None:
    app = start()
    app.state.settings.export_folder = str(tmp_path / "clips")
    run(app, 2)
    record(app)
    app.takes.toggle_recording()
    run(app, 5)  # a take that is still running
    written = app.takes.rescue()
    assert [path.name for path in written] == ["take-1.bvh", "take-2.bvh"]
    assert all(path.is_file() for path in written)
    assert app.takes.rescue() == []


def test_a_defect_does_not_cost_the_take(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def frame(app: App) -> None:
        if app.frames_shown == 0:
            app.state.settings.export_folder = str(tmp_path / "clips")
            app.takes.toggle_recording()
        if app.frames_shown == 10:
            raise ZeroDivisionError
        original(app)

    original = App.frame
    monkeypatch.setattr(App, "frame", frame)
    with pytest.raises(ZeroDivisionError):
        app_module.run(ViewOptions(offscreen=True, frames=20, terrain="flat"), fake_services(), tmp_path)
    assert (tmp_path / "clips" / "take-1.bvh").is_file()


def test_every_clip_panel_state_can_be_drawn(start: Start) -> None:
    app = start()
    run(app, 2)
    record(app)
    app.takes.play(0)
    app.actions.toggle_help()
    app.takes.toggle_recording()
    run(app, 2)
    app.takes.remove(0)
    run(app, 2)
    assert app.state.clips.items == []
    assert app.state.clips.playback is None


def test_screenshot_and_frames_are_written(start: Start, tmp_path: Path) -> None:
    from PIL import Image

    app = start(
        width=128,
        height=96,
        screenshot=tmp_path / "a" / "out.png",
        frames=2,
        frames_directory=tmp_path / "film",
    )
    while not app.finished:
        app.frame()
    assert app.end() == 0
    with Image.open(tmp_path / "a" / "out.png") as image:
        assert image.size == (128, 96)
    assert sorted(p.name for p in (tmp_path / "film").iterdir()) == ["frame_00000.png", "frame_00001.png"]


# --- parts that need no window


def test_settings_survive_and_damage_is_named(tmp_path: Path) -> None:
    settings = Settings(blend_seconds=2.5, terrain="stairs", export_unit="m")
    save_settings(settings, tmp_path / "deep")
    assert load_settings(tmp_path / "deep") == (settings, [])
    file = tmp_path / "deep" / "settings.json"
    for damage in ("{", "[]", "\0", '{"a":' * 100_000):
        file.write_text(damage, encoding="utf-8")
        loaded, complaints = load_settings(tmp_path / "deep")
        assert loaded == Settings()
        assert str(file) in complaints[0]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("blend_seconds", "long"),
        ("blend_seconds", 99),
        ("export_fps", 25),
        ("vsync", 1),
        ("terrain", 5),
        ("camera", "side"),
        ("width", math.inf),
    ],
)
def test_one_bad_setting_keeps_the_others(tmp_path: Path, name: str, value: Any) -> None:
    (tmp_path / "settings.json").write_text(json.dumps({name: value, "dead_zone": 0.3}), encoding="utf-8")
    settings, complaints = load_settings(tmp_path)
    assert settings.dead_zone == 0.3
    assert getattr(settings, name) == getattr(Settings(), name)
    assert len(complaints) == 1
    assert name in complaints[0]


def test_damaged_settings_are_a_message(start: Start, tmp_path: Path) -> None:
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "settings.json").write_text("{", encoding="utf-8")
    app = start()
    run(app)
    assert any("settings.json" in m.text for m in app.state.messages.recent)


def test_config_directory_obeys_the_environment() -> None:
    assert config_directory({"SPORT_CONFIG_DIR": "/a"}) == Path("/a")
    assert config_directory({"XDG_CONFIG_HOME": "/b"}) == Path("/b/sport-viewer")
    assert config_directory({}) == Path(os.path.expanduser("~/.config/sport-viewer"))


def test_errors_stay_and_notes_fade() -> None:
    now = [0.0]
    messages = Messages(clock=lambda: now[0])
    messages.error("a\nb")
    now[0] = 1000.0
    assert messages.current is not None
    assert messages.current.text == "a b"
    messages.note("fine")
    assert messages.current.text == "fine"
    now[0] = 2000.0
    assert messages.current is None


@pytest.mark.parametrize("scale", [1.0, 1.25, 2.0])
@pytest.mark.parametrize(
    "size", [(1280, 720), (1920, 1080), (960, 540), (640, 360), (2560, 1440), (200, 2000)]
)
def test_panels_never_overlap(size: tuple[int, int], scale: float) -> None:
    for scene_height in (0.0, 250.0 * scale, 480.0 * scale):
        layout = arrange(*size, scale, True, True, scene_height)
        rects = [r for r in vars(layout).values() if isinstance(r, Rect) and r is not layout.view]
        for i, a in enumerate(rects):
            assert a.x >= 0
            assert a.y >= 0
            assert a.x + a.width <= size[0] + 1e-6
            assert a.y + a.height <= size[1] + 1e-6
            for b in rects[i + 1 :]:
                assert not a.overlaps(b)


def test_simulation_steps_at_60_hz_whatever_the_display() -> None:
    ground = Terrain.flat()
    for rate in (24.0, 60.0, 144.0):
        simulation = Simulation.standing(ground)
        simulation.use(FakeController(ground))
        fake = simulation.controller
        assert isinstance(fake, FakeController)
        begin = fake.steps
        from runtime.controls import Controls

        for _ in range(round(rate * 2)):
            simulation.advance(1.0 / rate, Controls(move=(0.0, 1.0)))
        assert fake.steps - begin == pytest.approx(120, abs=1)
        assert len(simulation.advance(10.0, Controls())) == MAX_STEPS


def test_interpolated_poses_keep_bone_lengths() -> None:
    ground = Terrain.flat()
    fake = FakeController(ground)
    from runtime.controls import Controls

    a = fake.step(Controls())
    b = fake.step(Controls(move=(1.0, 0.0)))
    middle = interpolate(a, b, 0.5)
    assert middle.root_yaw == pytest.approx(math.pi / 4)
    assert middle.hips_position == pytest.approx((a.hips_position + b.hips_position) / 2)
    length = np.linalg.norm(middle.positions[3] - middle.positions[4])
    assert length == pytest.approx(np.linalg.norm(a.positions[3] - a.positions[4]), rel=1e-5)


def test_playback_loops_between_its_marks() -> None:
    from runtime.clip import ClipRecorder
    from runtime.controls import Controls

    fake, recorder = FakeController(Terrain.flat()), ClipRecorder()
    for _ in range(61):
        recorder.add(fake.step(Controls(move=(0.0, 1.0))))
    playback = Playback(recorder.last(10.0), Terrain.flat(), 0)
    playback.seek(15)
    playback.trim_in()
    playback.seek(45)
    playback.trim_out()
    playback.toggle()
    playback.advance(0.25)
    assert playback.start_s <= playback.time_s <= playback.end_s
    playback.loop = False
    playback.advance(5.0)
    assert not playback.playing
    assert playback.frame == 45
    assert playback.pose().hips_position == pytest.approx(playback.clip.hips_positions[45], abs=1e-5)
    playback.toggle()
    assert playback.frame == 15


def test_export_names(tmp_path: Path) -> None:
    assert export_target(" ~/a/walk ") == Path("~/a/walk.bvh").expanduser()
    assert export_target('"/a/b.BVH"') == Path("/a/b.BVH")
    with pytest.raises(UsageError, match="folder"):
        export_target(str(tmp_path))
    assert file_stem("Take 3: Löwe/../x") == "take-3-l-we-x"
    assert file_stem("***") == "clip"
    (tmp_path / "a.bvh").write_text("", encoding="utf-8")
    assert free_path(tmp_path / "a.bvh") == tmp_path / "a-2.bvh"
