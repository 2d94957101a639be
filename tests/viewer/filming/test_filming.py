"""Films: as many frames as the take is long, whole or not at all, seen from where it was asked."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image

from runtime.character.character import load_character
from runtime.errors import FileError, UsageError
from runtime.formats.prepare import ExportOptions, prepare
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent
from runtime.terrain.height_map import Terrain
from runtime.terrain.library import load_terrain
from tests.helpers.foreign_rigs import vrm_rig
from tests.helpers.walker import walk
from viewer.filming.film import _work, caption, count_frames, film_in_process, make_film, write_caption
from viewer.filming.shots import CAMERAS, VIEW, FilmOptions, Shot, camera_path
from viewer.filming.writers import open_writer
from viewer.render.camera import Camera

FLAT = Terrain.flat()
SMALL = FilmOptions(width=96, height=64, quality="software")
CLIP = Clip("walk", 60.0, *walk(90), prompts=(PromptEvent(0.0, "proud"), PromptEvent(1.0, "drunk")))


@contextmanager
def paper(size: tuple[int, int], terrain: Terrain, character: Any, quality: str) -> Iterator[Any]:
    """A studio that draws nothing but a shade that grows."""
    drawn = 0

    def draw(camera: Camera, pose: Any) -> np.ndarray:
        nonlocal drawn
        drawn += 1
        return np.full((*size[::-1], 3), 40 + 2 * drawn, np.uint8)

    yield draw


def decoded(path: Path) -> tuple[list[np.ndarray], float, str]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        return frames, float(stream.average_rate), stream.codec_context.name


@pytest.mark.parametrize(("fps", "count"), [(30.0, 45), (24.0, 36), (60.0, 90), (29.97, 45)])
def test_a_film_has_as_many_frames_as_the_take_is_long(tmp_path: Path, fps: float, count: int) -> None:
    path = tmp_path / "walk.mp4"
    options = FilmOptions(width=96, height=64, fps=fps, captions=False)
    seen: list[tuple[int, int]] = []
    result = make_film(CLIP, FLAT, path, options, open_studio=paper, progress=lambda *at: seen.append(at))
    frames, rate, codec = decoded(path)
    assert (len(frames), codec) == (count, "h264")
    assert rate == pytest.approx(fps, rel=1e-3)
    assert result == count
    assert seen == [(k, count) for k in range(1, count + 1)]
    shades = [frame.mean() for frame in frames[:20]]
    assert np.allclose(shades, 42 + 2 * np.arange(20), atol=3), "each frame once, in its order, in its colour"
    assert [p.name for p in tmp_path.iterdir()] == ["walk.mp4"]


def test_the_real_renderer_films_a_users_character_on_its_ground(tmp_path: Path) -> None:
    ground = load_terrain("hills")
    clip = Clip("up", 60.0, *walk(30, terrain=ground), terrain="hills")
    ours, theirs = tmp_path / "a.mp4", tmp_path / "b.mp4"
    make_film(clip, ground, ours, SMALL)
    make_film(clip, ground, theirs, SMALL, character=load_character(vrm_rig(tmp_path / "v.glb")))
    a, b = decoded(ours)[0], decoded(theirs)[0]
    assert len(a) == len(b) == 15
    difference = np.abs(np.stack(a).astype(int) - np.stack(b)).max(axis=-1)
    assert (difference[:, 8:56, 32:64] > 30).mean() > 0.05, "another character"
    assert (difference[:, :10, :] > 30).mean() < 0.02, "the same sky"


def test_captions_can_be_left_out(tmp_path: Path) -> None:
    for name, captions in (("with", True), ("without", False)):
        options = FilmOptions(width=96, height=64, captions=captions)
        make_film(CLIP, FLAT, tmp_path / f"{name}.png", options, open_studio=paper)
    first = [np.asarray(Image.open(tmp_path / f"{name}_00044.png")) for name in ("with", "without")]
    changed = np.abs(first[0].astype(int) - first[1]).max(axis=-1) > 0
    assert changed[44:].mean() > 0.1
    assert not changed[:40].any()
    assert len(list(tmp_path.glob("with_*.png"))) == 45


def test_the_caption_is_the_prompt_in_force() -> None:
    assert caption(CLIP.prompts, 0.5) == "“proud”"
    assert caption(CLIP.prompts, 1.0) == "“drunk”"
    frame = np.full((90, 200, 3), 200, np.uint8)
    write_caption(frame, "“" + "a very long prompt " * 3 + "”")
    assert (frame[60:] != 200).any(axis=-1).mean() > 0.2
    assert (frame[:45] == 200).all()
    assert (frame[:, 0] == 200).all()


@pytest.mark.parametrize("suffix", [".mp4", ".png", ".webp"])
def test_a_cancelled_film_leaves_nothing(tmp_path: Path, suffix: str) -> None:
    cancel = threading.Event()
    path = tmp_path / f"walk{suffix}"
    path.write_bytes(b"the film before")

    def stop(done: int, total: int) -> None:
        if done == 7:
            cancel.set()

    result = make_film(CLIP, FLAT, path, SMALL, open_studio=paper, progress=stop, cancel=cancel)
    assert result == 0
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"the film before"


def test_a_film_is_made_in_a_process_of_its_own(tmp_path: Path) -> None:
    path, seen = tmp_path / "walk.mp4", []
    take, film = prepare(CLIP, ExportOptions(), FLAT), FilmOptions(48, 32, 4.0, quality="software")
    options, event = ExportOptions(), threading.Event()
    text = film_in_process(take, FLAT, path, options, film, lambda *at: seen.append(at), event)
    assert seen[-1] == (6, 6)
    assert "6 frames" in text
    assert len(decoded(path)[0]) == 6
    with pytest.raises(UsageError, match="not a film format"):
        film_in_process(take, FLAT, tmp_path / "nowhere" / "a.xyz", options, film, print, event)


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no process can be stopped here")
def test_a_film_whose_process_does_not_answer_is_given_up_at_once(tmp_path: Path) -> None:
    cancel = threading.Event()

    def stop(_done: int, _total: int) -> None:
        if not cancel.is_set():
            (process,) = [p for p in multiprocessing.active_children() if p.name == "sport-film"]
            assert process.pid is not None
            os.kill(process.pid, signal.SIGSTOP)
            cancel.set()

    film = FilmOptions(48, 32, 60.0, quality="software")
    take = prepare(CLIP, ExportOptions(), FLAT)
    assert film_in_process(take, FLAT, tmp_path / "a.mp4", ExportOptions(), film, stop, cancel) == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("handed_over", [None, "cancel"])
def test_a_film_that_the_program_no_longer_wants_ends_without_a_word(handed_over: str | None) -> None:
    ours, theirs = multiprocessing.Pipe()
    if handed_over:
        ours.send(handed_over)
    else:
        os.write(ours.fileno(), b"\0\0\1\0half")  # the program ended as it handed the take over
        ours.close()
    _work(theirs)


def test_a_film_without_room_is_refused_once_and_its_muxer_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that wait must not reach it again: that ends the process."""
    path, calls = tmp_path / "a.mp4", []
    path.write_bytes(b"the film before")
    real = av.open

    class Full:
        def __init__(self, *args: Any, **options: Any) -> None:
            self._real = real(*args, **options)
            self.add_stream = self._real.add_stream

        def mux(self, packets: Any) -> None:
            calls.append(packets)
            raise OSError(28, "No space left on device")

        def __enter__(self) -> None:
            return None

        def __exit__(self, *_: object) -> None:
            self._real.close()

    monkeypatch.setattr(av, "open", Full)
    with pytest.raises(FileError, match=r"a\.mp4: No space left on device\. Choose a folder with space left"):
        make_film(CLIP, FLAT, path, SMALL, open_studio=paper)
    assert len(calls) == 1
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"the film before"


def test_numbered_frames_replace_an_older_film_only_when_all_are_there(tmp_path: Path) -> None:
    old = tmp_path / "a_00000.png"
    old.write_bytes(b"old")

    def film(broken: bool) -> None:
        with open_writer(tmp_path / "a.png", (96, 64), 30.0) as write:
            write(np.zeros((64, 96, 3), np.uint8))
            write(np.zeros((64, 96, 3), np.uint8))
            if broken:
                raise OSError(28, "No space left on device")

    with pytest.raises(FileError, match=r"a\.png: No space left on device"):
        film(broken=True)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"old"]
    film(broken=False)
    assert [p.name for p in sorted(tmp_path.iterdir())] == ["a_00000.png", "a_00001.png"]
    assert Image.open(old).size == (96, 64)


@pytest.mark.parametrize(
    ("options", "name", "message"),
    [
        (FilmOptions(width=97, height=64), "a.mp4", "even numbers"),
        (FilmOptions(width=8, height=64), "a.mp4", "expected 16"),
        (FilmOptions(fps=0.0), "a.mp4", "fps 0"),
        (FilmOptions(camera="moon"), "a.mp4", "camera moon"),
        (FilmOptions(distance=-1.0), "a.mp4", "distance -1"),
        (SMALL, "a.avi", "not a film format"),
    ],
)
def test_films_that_cannot_be_made_are_named(
    options: FilmOptions, name: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=message):
        make_film(CLIP, FLAT, tmp_path / name, options, open_studio=paper)
    assert not list(tmp_path.iterdir())


def test_a_long_animation_is_sent_to_mp4(tmp_path: Path) -> None:
    long = Clip("long", 60.0, *walk(3000))
    assert count_frames(len(long) / long.fps, 30.0) == 1500
    with pytest.raises(UsageError, match=r"1500 frames; \.gif takes 1200") as refused:
        make_film(long, FLAT, tmp_path / "a.gif", SMALL, open_studio=paper)
    assert "--" not in str(refused.value), "the window says it, too"


def test_a_film_as_the_window_shows_it_keeps_its_direction_and_lens() -> None:
    view = Shot(0.7, 0.2, 5.0, fixed=True)
    path = camera_path(FilmOptions(camera=VIEW, view=view, fov_degrees=60.0), CLIP, FLAT)
    for seconds in (0.0, 0.5, 1.0):
        pose = CLIP.sample(seconds)
        camera = path(pose)
        assert (camera.yaw, camera.pitch, camera.distance, camera.fov_y) == (0.7, 0.2, 5.0, np.pi / 3)
        assert np.hypot(*(camera.target - pose.hips_position)[[0, 2]]) < 1.0
    with pytest.raises(UsageError, match="no such camera"):
        camera_path(FilmOptions(camera=VIEW), CLIP, FLAT)


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_keep_the_character_in_view(name: str) -> None:
    hills = load_terrain("hills")
    clip = Clip("up", 60.0, *walk(300, terrain=hills), terrain="hills")
    see = camera_path(FilmOptions(camera=name), clip, hills)
    for k in range(150):
        pose = clip.sample(k / 30.0)
        camera = see(pose)
        clip_matrix = camera.projection_matrix(16 / 9) @ camera.view_matrix()
        head, foot = pose.positions[16], pose.positions[4]
        for point in (head, foot):
            x, y, _, w = clip_matrix @ np.append(point, 1.0)
            assert w > 0.5
            assert max(abs(x / w), abs(y / w)) < 0.98, (name, k)
        eye = camera.position
        assert eye[1] > hills.height(eye[0], eye[2]) + 0.1


@pytest.mark.parametrize("name", CAMERAS)
def test_the_camera_steps_back_from_a_tall_character(name: str) -> None:
    clip = Clip("on", 60.0, *walk(60))
    see = camera_path(FilmOptions(500, 500, camera=name), clip, FLAT, height=3.0)
    pose = clip.sample(0.5)
    camera = see(pose)
    for height in (0.0, 3.0):
        point = np.array([pose.positions[0, 0], height, pose.positions[0, 2], 1.0])
        x, y, _, w = camera.projection_matrix(1.0) @ camera.view_matrix() @ point
        assert max(abs(x / w), abs(y / w)) < 0.98


def test_a_writer_gives_up_what_it_began(tmp_path: Path) -> None:
    def interrupted() -> None:
        with open_writer(tmp_path / "a.mp4", (96, 64), 30.0) as write:
            write(np.zeros((64, 96, 3), np.uint8))
            raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut"):
        interrupted()
    assert not list(tmp_path.iterdir())
