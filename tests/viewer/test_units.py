"""Parts of the viewer that need no window: settings, messages, layout, simulation, playback, file names."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from runtime.controls import Controls
from runtime.errors import UsageError
from runtime.session.motion import Motion
from runtime.session.session import Take
from runtime.takes.recorder import ClipRecorder
from runtime.terrain.height_map import Terrain
from tests.helpers.viewer_fakes import FakeController
from viewer.exports.bvh_export import export_target, file_stem, free_path
from viewer.gui.layout import Rect, arrange, framing
from viewer.gui.status import Stats
from viewer.gui.widgets import clock
from viewer.scene.simulation import MAX_STEPS, Simulation, interpolate
from viewer.session.playback import Playback
from viewer.settings import config_directory


def test_config_directory_obeys_the_environment() -> None:
    assert config_directory({"SPORT_CONFIG_DIR": "/a"}) == Path("/a")
    assert config_directory({"XDG_CONFIG_HOME": "/b"}) == Path("/b/sport-viewer")
    assert config_directory({}) == Path(os.path.expanduser("~/.config/sport-viewer"))


@pytest.mark.parametrize("scale", [1.0, 1.25, 2.0])
@pytest.mark.parametrize(
    "size", [(1280, 720), (1920, 1080), (960, 540), (640, 360), (2560, 1440), (200, 2000)]
)
def test_panels_never_overlap(size: tuple[int, int], scale: float) -> None:
    layout = arrange(*size, scale, True, True)
    rects = [r for r in vars(layout).values() if isinstance(r, Rect) and r is not layout.view]
    for i, a in enumerate(rects):
        assert a.x >= 0
        assert a.y >= 0
        assert a.x + a.width <= size[0] + 1e-6
        assert a.y + a.height <= size[1] + 1e-6
        for b in rects[i + 1 :]:
            beside = a.x + a.width <= b.x or b.x + b.width <= a.x
            assert beside or a.y + a.height <= b.y or b.y + b.height <= a.y


def test_the_picture_is_centred_in_what_the_panels_leave() -> None:
    wide, narrow = arrange(1280, 720, 1.0), arrange(800, 600, 1.0)
    assert framing(arrange(1280, 720, 1.0, panels=False))[0] == 0.0
    assert framing(wide)[0] == pytest.approx(2 * (wide.view.x + wide.view.width / 2) / 1280 - 1)
    assert (1 + framing(narrow)[0]) / 2 * 800 > narrow.tabs.x + narrow.tabs.width + 100
    assert framing(arrange(360, 600, 1.0))[0] == 0.0  # hardly anything is left


def test_the_timeline_takes_its_height_from_the_view() -> None:
    for size in ((1280, 720), (800, 500)):
        layout = arrange(*size, 1.0, transport=True)
        _, up, share = framing(layout)
        # its lower edge is the bar
        assert up - share == pytest.approx(1.0 - 2.0 * layout.transport.y / size[1])
        assert up + share == pytest.approx(1.0)
    assert framing(arrange(1280, 720, 1.0))[1:] == (0.0, 1.0)


def test_rates_are_those_of_the_clock() -> None:
    stats = Stats()
    for _ in range(100):
        # offscreen: one step a picture, however long it takes
        stats.add(work_s=0.08, interval_s=0.1, steps=1)
    assert stats.fps == pytest.approx(10.0)
    assert stats.steps_per_s == pytest.approx(10.0)
    assert stats.frame_ms == pytest.approx(80.0)
    for i in range(1000):
        stats.add(0.001, 1 / 144, steps=[1, 0, 1, 0, 0][i % 5] + (i % 60 == 0))
    assert stats.fps == pytest.approx(144.0, rel=0.01)
    assert stats.steps_per_s == pytest.approx(60.0, rel=0.05)
    uneven = Stats()
    for i in range(400):
        uneven.add(0.001, [0.005, 0.095][i % 2], steps=1)
    assert uneven.fps == pytest.approx(20.0, rel=0.1)
    assert uneven.steps_per_s == pytest.approx(uneven.fps)


def test_simulation_steps_at_60_hz_whatever_the_display() -> None:
    ground = Terrain.flat()
    for rate in (24.0, 60.0, 144.0):
        simulation = Simulation.standing(ground)
        simulation.use(FakeController(ground))
        fake = simulation.controller
        assert isinstance(fake, FakeController)
        begin = fake.steps
        for _ in range(round(rate * 2)):
            simulation.advance(1.0 / rate, Controls(move=(0.0, 1.0)))
        assert fake.steps - begin == pytest.approx(120, abs=1)
        assert len(simulation.advance(10.0, Controls())) == MAX_STEPS


def test_interpolated_poses_keep_bone_lengths() -> None:
    fake = FakeController(Terrain.flat())
    a = fake.step(Controls())
    b = fake.step(Controls(move=(1.0, 0.0)))
    middle = interpolate(a, b, 0.5)
    assert middle.root_yaw == pytest.approx(math.pi / 4)
    assert middle.hips_position == pytest.approx((a.hips_position + b.hips_position) / 2)
    length = np.linalg.norm(middle.positions[3] - middle.positions[4])
    assert length == pytest.approx(np.linalg.norm(a.positions[3] - a.positions[4]), rel=1e-5)


def test_playback_loops_between_its_marks() -> None:
    fake, recorder = FakeController(Terrain.flat()), ClipRecorder()
    for _ in range(61):
        recorder.add(fake.step(Controls(move=(0.0, 1.0))))
    clip = recorder.last(10.0)
    take = Take(1, Motion.of(clip), trim=(15, 45))
    playback = Playback(take, clip, Terrain.flat(), Terrain.flat())
    assert playback.frame == 15
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
    assert export_target("~nobody-of-this-name/walk.bvh") == Path("~nobody-of-this-name/walk.bvh")
    assert export_target("x" * 300).name == "x" * 300 + ".bvh"
    with pytest.raises(UsageError, match="folder"):
        export_target(str(tmp_path))
    assert file_stem("Take 3: Löwe/../x") == "take-3-löwe-x"
    assert file_stem("Mu\u0308de König") == "müde-könig"
    assert file_stem("疲れた 王") == "疲れた-王"
    assert len(file_stem("王" * 300).encode()) <= 120
    assert file_stem("***") == "clip"
    (tmp_path / "a.bvh").write_text("", encoding="utf-8")
    assert free_path(tmp_path / "a.bvh") == tmp_path / "a-2.bvh"
    too_long = tmp_path / f"{'long' * 100}.bvh"  # to look for it is an error
    assert free_path(too_long) == too_long


def test_a_length_in_the_list_is_the_one_that_messages_say() -> None:
    for frames in range(1, 2000):
        seconds = frames / 60
        minutes, rest = divmod(float(f"{seconds:.1f}"), 60)
        assert clock(seconds) == f"{minutes:.0f}:{rest:04.1f}"
