"""The export window of the real application, driven without a display: the files are there and hold the take."""

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import trimesh

from runtime.character.writer import write_character
from runtime.formats.table import FORMATS
from runtime.skeleton import SPORT_SKELETON
from tests.helpers.app_driver import Start, click_on, do, message, press, record, run, run_until, texts
from tests.helpers.glb_playback import play
from tests.helpers.gltf_characters import user_character
from viewer.app import App
from viewer.filming import film
from viewer.services import Services

FRAMES = 24
REAL = {"load_character": Services().load_character}


def export(app: App, folder: Path, suffix: str, **form: object) -> Path:
    """Record a walk, choose a format in the window as a person would, and press Export."""
    app.settings.export_folder = str(folder)
    record(app, FRAMES)
    do(app, "run 2; click ##more formats")
    if app.exporting.form.suffix != suffix:
        click_on(app, "##export format")
        click_on(app, FORMATS[suffix].name)
    app.exporting.choose(**form)
    do(app, "run 2; click ##export now")
    report = app.exporting
    assert report.report_good, report.report
    return folder / f"take-1{suffix}"


def test_a_range_is_the_trim_or_what_the_timeline_shows(start: Start, tmp_path: Path) -> None:
    app = start(services=REAL, terrain="flat")
    export(app, tmp_path, ".npz")
    do(app, "play 1; run 2")
    app.takes.trim(last=19)
    app.transport.timeline.shown = app.transport.timeline.shown.fitted(3, 17)
    for part, frames in (("", FRAMES), ("trim", 20), ("shown", 15)):
        app.exporting.choose(part=part)
        app.exporting.path = str(tmp_path / f"{part or 'all'}.npz")
        click_on(app, "##export now")
        assert len(np.load(tmp_path / f"{part or 'all'}.npz")["root_positions"]) == frames


def test_a_typed_name_gets_the_ending_of_the_format_and_keeps_its_dots(app: App) -> None:
    record(app, FRAMES)
    app.exporting.path = "clips/walk 1.5"
    for suffix in (".bvh", ".fbx"):
        app.exporting.choose_format(suffix)
        assert app.exporting.path == f"clips/walk 1.5{suffix}"


@pytest.mark.parametrize("own", [False, True])
def test_a_glb_has_mesh_skin_motion_and_ground(start: Start, tmp_path: Path, own: bool) -> None:
    app = start(services=REAL, terrain="hills")
    if own:
        write_character(tmp_path / "me.glb", user_character())
        app.open_files([tmp_path / "me.glb"])
    path = export(app, tmp_path, ".glb", ground="inside")
    triangles = sorted(len(mesh.faces) for mesh in trimesh.load(str(path)).geometry.values())
    assert len(triangles) >= 2, "the character and the ground"
    played = play(path)
    assert len(played.times) == FRAMES
    assert np.allclose(np.diff(played.times), 1 / 60, atol=1e-5)
    clip = app.editor.session.takes[0].clip
    moved = next(at for name, at in played.joints().items() if name.endswith("Hips"))[:, :3, 3]
    wanted = clip.size * (clip.hips_positions - clip.hips_positions[0])  # steps of its own legs
    assert np.allclose((moved - moved[0])[:, [0, 2]], wanted[:, [0, 2]], atol=1e-3)
    if not own:
        joints = np.stack([played.joints()[name][:, :3, 3] for name in SPORT_SKELETON.names], 1)
        assert np.abs(joints - clip.world()[0]).max() < 1e-3


def test_an_mp4_has_a_frame_for_each_thirtieth_second(start: Start, tmp_path: Path) -> None:
    app = start(services=REAL)
    path = export(app, tmp_path, ".mp4", size="640x360", quality="software", camera="side")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert (stream.width, stream.height, stream.codec_context.name) == (640, 360, "h264")
        assert stream.average_rate == 30
    assert len(pictures) == FRAMES // 2
    assert app.exporting.progress == (FRAMES // 2, FRAMES // 2)
    assert np.std(pictures[0]) > 10.0, "something is drawn"
    assert np.abs(pictures[0].astype(int) - pictures[-1]).max() > 30, "it moves"


def test_an_fbx_is_written(start: Start, tmp_path: Path) -> None:
    path = export(start(services=REAL), tmp_path, ".fbx")
    assert path.read_bytes().startswith(b"Kaydara FBX Binary")


def test_any_export_can_be_cancelled_while_it_is_written(start: Start, tmp_path: Path) -> None:
    app = start(services=REAL)
    exporting = app.exporting
    app.settings.export_folder = str(tmp_path)
    run(app, FRAMES)
    app.takes.save_last()
    load = exporting._ground_of(app.editor.session.takes[0])

    def cancelled_meanwhile() -> object:
        exporting.cancel()
        return load()

    for suffix in (".glb", ".bvh"):
        exporting.choose_format(suffix)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(type(exporting), "_ground_of", lambda self, item: cancelled_meanwhile)
            exporting.export()
        assert app.exporting.report == "Cancelled: nothing was written."
        assert not list(tmp_path.glob("last-seconds*"))
    assert not exporting.busy


def test_a_film_goes_on_without_its_window_and_is_cancelled_in_the_status_line(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half_done(*about: Any) -> str:
        *_, progress, cancel = about
        progress(5, 10)
        return "" if cancel.wait(20.0) else "a film"

    monkeypatch.setattr(film, "film_in_process", half_done)
    app = start(services=REAL)
    app.jobs.blocking = False
    export(app, tmp_path, ".mp4")
    press(app, "escape")
    assert not app.exporting.shown
    line = "Writing the export of Take 1: 5 of 10 frames…"
    run_until(app, lambda: any(line in text for text in texts(app)))
    click_on(app, "##doing")
    run_until(app, lambda: not app.exporting.busy)
    assert message(app) == "The export of Take 1 was cancelled."
    assert not any("Writing" in text for text in texts(app))


@pytest.mark.parametrize("typed", ["", "/"])
def test_a_field_without_a_name_gets_one_with_another_format(
    start: Start, tmp_path: Path, typed: str
) -> None:
    app = start(services=REAL)
    app.settings.export_folder = str(tmp_path)
    run(app, FRAMES)
    app.takes.save_last()
    app.exporting.open()
    app.exporting.path = typed
    app.exporting.choose_format(".bvh")
    assert Path(app.exporting.path).parent == tmp_path
    assert app.exporting.path.endswith(".bvh")
