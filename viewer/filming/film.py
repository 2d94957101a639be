"""A film of a take: drawing and writing at the same time, with progress, and an end at any time."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runtime.errors import UsageError
from runtime.formats.prepare import ExportOptions, PreparedTake
from runtime.pose import Pose
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from viewer.filming.captions import caption, write_caption
from viewer.filming.shots import CameraPath, FilmOptions, camera_path
from viewer.filming.writers import Frame, check_writer, open_writer
from viewer.render.camera import Camera

Draw = Callable[[Camera, Pose], Frame]
Progress = Callable[[int, int], None]  # frames done, frames in all
OpenStudio = Callable[[FilmOptions, Terrain, Any], AbstractContextManager[Draw]]

MAX_FRAMES = 216_000  # an hour at 60 frames a second
QUEUED = 6  # frames drawn ahead of the writer


@dataclass(frozen=True)
class FilmResult:
    """What became of a film: frames written, or none of it where it was cancelled."""

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
    """The frames of a film one by one, as `draw` draws a pose; `camera` in place of the one of the options."""
    see = camera or camera_path(options, clip, terrain)
    for index in range(count_frames(clip, options.fps)):
        seconds = index / options.fps
        pose = clip.sample(seconds)
        frame = draw(see(pose), pose)
        if options.captions:
            write_caption(frame, caption(clip.prompts, seconds))
        yield frame


def open_studio(options: FilmOptions, terrain: Terrain, character: Any) -> AbstractContextManager[Draw]:
    """A studio that draws the frames of such a film."""
    from viewer.filming.studio import studio
    from viewer.render.quality import HIGH, SOFTWARE

    return studio(options.size, terrain, character, SOFTWARE if options.quality == "software" else HIGH)


def make_film(
    clip: Clip,
    terrain: Terrain,
    path: Path,
    options: FilmOptions,
    *,
    character: Any = None,
    progress: Progress = lambda done, total: None,
    cancel: threading.Event | None = None,
    open_studio: OpenStudio = open_studio,
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
    camera = camera_path(options, clip, terrain, 0.0 if character is None else character.height)
    writing: deque[Future[None]] = deque()
    try:
        with (
            open_writer(path, options.size, options.fps) as write,
            ThreadPoolExecutor(1, "sport-film") as writer,
            open_studio(options, terrain, character) as draw,
        ):
            for done, frame in enumerate(film_frames(clip, terrain, options, draw, camera), 1):
                writing.append(writer.submit(write, frame))
                if len(writing) > QUEUED:
                    writing.popleft().result()
                progress(done, total)
                if cancel is not None and cancel.is_set():
                    raise _Cancelled
            for future in writing:
                future.result()
    except _Cancelled:
        return FilmResult(path, 0, 0.0, cancelled=True)
    return FilmResult(path, total, total / options.fps)


class _Cancelled(Exception):
    """The film is not wanted any more."""


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
