"""A film of a take: drawing and writing side by side, with progress, and an end at any time."""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.errors import UsageError
from runtime.formats.prepare import ExportOptions, PreparedTake
from runtime.pose import Pose
from runtime.takes.camera_keys import CameraKey
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from viewer.filming.captions import Captions, caption
from viewer.filming.shots import CameraPath, ShotView, camera_path
from viewer.filming.writers import FrameWriter, check_writer, open_writer
from viewer.render.camera import Camera

Frame = NDArray[np.uint8]
Draw = Callable[[Camera, Pose], Frame]
Progress = Callable[[int, int], None]  # frames done, frames in all

MIN_SIDE, MAX_SIDE = 16, 4096
MAX_FRAMES = 216_000  # an hour at 60 frames a second
QUEUED = 6  # frames drawn ahead of the writer


@dataclass(frozen=True)
class FilmOptions:
    """How a film looks; `fps` is that of the film, whatever the take's."""

    width: int = 1280
    height: int = 720
    fps: float = 30.0
    camera: str = "front"  # one of `shots.CAMERAS`
    distance: float = 0.0  # metres of the camera, 0 for its usual one
    captions: bool = True
    quality: str = "high"  # or "software": faster without a graphics card
    view: ShotView | None = None  # of the camera "view"
    fov_degrees: float = 0.0  # field of view from bottom to top; 0 for the usual one
    keys: tuple[CameraKey, ...] = ()  # of the camera "keyed", in the time of the film

    def check(self) -> None:
        """UsageError names the option that cannot be used."""
        if not 1.0 <= self.fps <= 60.0:
            raise UsageError(f" {self.fps:g}: a film has 1 to 60.", "Try 30.", "fps")
        if not all(MIN_SIDE <= side <= MAX_SIDE for side in (self.width, self.height)):
            raise UsageError(
                f" {self.width}x{self.height}: expected {MIN_SIDE} to {MAX_SIDE} pixels a side.",
                "Try 1280x720.",
                "size",
            )
        if not (self.fov_degrees == 0.0 or 5.0 <= self.fov_degrees <= 120.0):
            raise UsageError(f" {self.fov_degrees:g}: expected 5 to 120 degrees.", "Try 38.", "fov_degrees")
        if not (self.distance == 0.0 or 0.5 <= self.distance <= 60.0):
            raise UsageError(f" {self.distance:g}: expected 0.5 to 60 m.", "Try 4.", "distance")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height


OpenStudio = Callable[[FilmOptions, Terrain, Any], AbstractContextManager[Draw]]


@dataclass(frozen=True)
class FilmResult:
    """What became of a film: frames written, or None of it where it was cancelled."""

    path: Path
    frames: int
    seconds: float
    cancelled: bool = False


def count_frames(clip: Clip, fps: float) -> int:
    """Frames of a film that lasts as long as the clip; UsageError when they are too many."""
    count = max(1, round(len(clip) / clip.fps * fps))
    if count > MAX_FRAMES:
        raise UsageError(
            f"{count} frames of film: expected {MAX_FRAMES} at most.", "Choose a shorter --range."
        )
    return count


def film_frames(
    clip: Clip, terrain: Terrain, options: FilmOptions, draw: Draw, camera: CameraPath | None = None
) -> Iterator[Frame]:
    """The frames of a film one by one, as `draw` draws a pose; `camera` in place of the one of the options.

    The window may step through this on its own thread and with its own renderer; `make_film` does it with a renderer
    of its own.
    """
    see = camera or _camera(clip, terrain, options)
    captions = Captions(options.size)
    for index in range(count_frames(clip, options.fps)):
        seconds = index / options.fps
        pose = clip.sample(seconds)
        frame = draw(see(pose), pose)
        if options.captions:
            captions.write(frame, caption(clip.prompts, seconds))
        yield frame


def _camera(clip: Clip, terrain: Terrain, options: FilmOptions, height: float = 0.0) -> CameraPath:
    aspect = options.width / options.height
    return camera_path(
        options.camera, clip, terrain, options.fps, aspect, options.distance, height, options.view,
        math.radians(options.fov_degrees), options.keys,
    )  # fmt: skip


def make_film(
    clip: Clip,
    terrain: Terrain,
    path: Path,
    options: FilmOptions,
    *,
    character: Any = None,
    camera: CameraPath | None = None,
    progress: Progress = lambda done, total: None,
    cancel: threading.Event | None = None,
    open_studio: OpenStudio | None = None,
) -> FilmResult:
    """Write a film of a clip on its ground; its length follows from the clip, its form from the ending of `path`.

    `character` is a `runtime.character.character.Character` (None: the mannequin). `progress` is called on the calling thread after
    each drawn frame; when `cancel` is set, what was written is taken away. The OpenGL context is made on the calling
    thread, which may be a worker. UsageError, FileError or DisplayError.
    """
    options.check()
    terrain = terrain.seen_by(clip.size)
    total = count_frames(clip, options.fps)
    check_writer(path, options.size, total)
    if camera is None and character is not None:
        camera = _camera(clip, terrain, options, character.height)
    try:
        with (
            open_writer(path, options.size, options.fps) as writer,
            _Beside(writer) as beside,
            (open_studio or _studio)(options, terrain, character) as draw,
        ):
            for done, frame in enumerate(film_frames(clip, terrain, options, draw, camera), 1):
                beside.add(frame)
                progress(done, total)
                if cancel is not None and cancel.is_set():
                    raise _Cancelled
    except _Cancelled:
        return FilmResult(path, 0, 0.0, cancelled=True)
    return FilmResult(path, total, total / options.fps)


def film_of_take(
    take: PreparedTake,
    terrain: Terrain,
    path: Path,
    export: ExportOptions,
    film: FilmOptions,
    progress: Progress = lambda done, total: None,
    cancel: threading.Event | None = None,
) -> str:
    """Write a film of a prepared take, on its ground, with the character of its options; a sentence about it, "" when cancelled."""
    from runtime.character.character import load_character
    from runtime.character.joint_map import read_joint_map

    joint_map = None if export.joint_map is None else read_joint_map(export.joint_map)
    character = None if export.character is None else load_character(export.character, joint_map)
    done = make_film(take.clip, terrain, path, film, character=character, progress=progress, cancel=cancel)
    if done.cancelled:
        return ""
    text = f"{path}: {done.frames} frames at {film.fps:g} fps, {done.seconds:.1f} s"
    return text if take.loop is None else f"{text}; {take.loop.describe()}"


def _studio(options: FilmOptions, terrain: Terrain, character: Any) -> AbstractContextManager[Draw]:
    from viewer.filming.studio import studio
    from viewer.render.quality import HIGH, SOFTWARE

    return studio(options.size, terrain, character, SOFTWARE if options.quality == "software" else HIGH)


class _Cancelled(Exception):
    """The film is not wanted any more."""


class _Beside:
    """Hands frames to a writer that works on a thread of its own, while the next ones are drawn."""

    def __init__(self, writer: FrameWriter) -> None:
        self._writer = writer
        self._frames: queue.Queue[Frame | None] = queue.Queue(QUEUED)
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="sport-film", daemon=True)

    def __enter__(self) -> _Beside:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._frames.put(None)
        self._thread.join()
        if kind is None and self._failure is not None:
            raise self._failure

    def add(self, frame: Frame) -> None:
        """Queue a frame; raises what the writer met."""
        if self._failure is not None:
            raise self._failure
        self._frames.put(frame)

    def _work(self) -> None:
        while (frame := self._frames.get()) is not None:
            if self._failure is None:
                try:
                    self._writer.add(frame)
                except BaseException as error:  # raised again on the thread that draws
                    self._failure = error
