"""Films of takes: drawn by an offscreen renderer and written at the same time, with captions, progress and cancellation."""

import multiprocessing
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import lru_cache, partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path
from runtime.atomic import sweep_of
from runtime.character.character import DEFAULT_CHARACTER, Character, load_character
from runtime.errors import SportError, UsageError
from runtime.formats.prepare import ExportOptions, PreparedTake
from runtime.interrupts import forget, signals_kept_from_children, undo_when_ended
from runtime.pose import Pose
from runtime.takes.clip import Clip
from runtime.takes.metadata import PromptEvent, title
from runtime.terrain.height_map import Terrain
from viewer.filming.shots import CameraPath, FilmOptions, camera_path
from viewer.filming.writers import Frame, check_writer, open_writer
from viewer.render.camera import Camera
from viewer.render.offscreen import OffscreenTarget
from viewer.render.overlays import Overlays
from viewer.render.quality import choose_quality
from viewer.render.renderer import Renderer

MIN_LETTER_PX = 8  # letter size
_BACK, _INK = (20, 28, 40, 170), (240, 244, 250, 255)


def caption(prompts: Sequence[PromptEvent], seconds: float) -> str:
    """Return the caption of a film at a time: the typed prompt in force, in quotation marks; "" before the first."""
    begun = [event for event in prompts if event.seconds <= seconds + 1e-6]
    if not begun:
        return ""
    last = begun[-1]
    return f"“{title(replace(last, prompt=last.typed, typed='') if last.typed else last)}”"


def write_caption(frame: NDArray[np.uint8], text: str) -> None:
    """Draw `text` onto a frame `(H, W, 3)`, in place."""
    if text:
        left, top, pixels = draw_caption((frame.shape[1], frame.shape[0]), text)
        under = frame[top : top + pixels.shape[0], left : left + pixels.shape[1]]
        opacity = pixels[..., 3:] / 255.0
        under[:] = np.round(under * (1.0 - opacity) + pixels[..., :3] * opacity).astype(np.uint8)


@lru_cache(maxsize=8)
def draw_caption(size: tuple[int, int], text: str) -> tuple[int, int, NDArray[np.float32]]:
    """Return left, top and pixels `(h, w, 4)` of a caption: as large as fits, shortened if even small letters do not."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.new("RGBA", size, (0, 0, 0, 0))
    draw = ImageDraw.Draw(image)

    def width(letters: int) -> float:
        return draw.textlength(text, ImageFont.load_default(letters)) + 2.2 * letters

    letters = max(MIN_LETTER_PX, image.height // 22)
    while letters > MIN_LETTER_PX and width(letters) > 0.96 * image.width:
        letters -= 1
    while len(text) > 1 and width(letters) > 0.96 * image.width:
        text = text[:-2] + "…"
    half, middle = width(letters) / 2, image.height - 1.3 * letters
    box = (image.width / 2 - half, middle - letters, image.width / 2 + half, middle + letters)
    draw.rounded_rectangle(box, radius=letters, fill=_BACK)
    # letters are blended over the bar
    ink = Image.new("RGBA", size, (0, 0, 0, 0))
    font = ImageFont.load_default(letters)
    ImageDraw.Draw(ink).text((image.width / 2, middle), text, fill=_INK, font=font, anchor="mm")
    done = Image.alpha_composite(image, ink)
    left, top, right, bottom = done.getbbox() or (0, 0, 1, 1)
    return left, top, np.asarray(done.crop((left, top, right, bottom)), np.float32)


Draw = Callable[[Camera, Pose], Frame]


@contextmanager
def studio(
    size: tuple[int, int], terrain: Terrain, character: Character | None = None, quality: str = "high"
) -> Iterator[Draw]:
    """Open an offscreen renderer and yield a function that draws `character` (None: the mannequin) as `(H, W, 3)`, sRGB.

    Raises DisplayError without OpenGL.
    """
    target = OffscreenTarget(*size)
    renderer = Renderer(target.ctx, choose_quality(target.ctx, quality))
    try:
        renderer.set_terrain(terrain)
        renderer.set_character(character or load_character(asset_path(DEFAULT_CHARACTER)))

        def draw(camera: Camera, pose: Pose) -> Frame:
            renderer.render(target.framebuffer, camera, pose, Overlays())
            return target.read()

        yield draw
    finally:
        renderer.release()
        target.release()


Progress = Callable[[int, int], None]  # frames done, frames in all
OpenStudio = Callable[[tuple[int, int], Terrain, Any, str], AbstractContextManager[Draw]]

MAX_FRAMES = 216_000  # an hour at 60 frames a second
MAX_QUEUED_FRAMES = 6  # frames drawn ahead of the writer


def count_frames(seconds: float, fps: float) -> int:
    """Return the number of frames of a film of this length; UsageError if there are too many."""
    count = max(1, round(seconds * fps))
    if count > MAX_FRAMES:
        raise UsageError(f"{count} frames of film: expected {MAX_FRAMES} at most.", "Choose a shorter range.")
    return count


def film_frames(
    clip: Clip, terrain: Terrain, options: FilmOptions, draw: Draw, camera: CameraPath | None = None
) -> Iterator[Frame]:
    """Yield the frames of a film, drawn by `draw`; `camera` overrides the one in the options."""
    see = camera or camera_path(options, clip, terrain)
    for index in range(count_frames(len(clip) / clip.fps, options.fps)):
        seconds = index / options.fps
        pose = clip.sample(seconds)
        frame = draw(see(pose), pose)
        if options.captions:
            write_caption(frame, caption(clip.prompts, seconds))
        yield frame


def make_film(
    clip: Clip,
    terrain: Terrain,
    path: Path,
    options: FilmOptions,
    *,
    character: Any = None,
    progress: Progress = lambda done, total: None,
    cancel: threading.Event | None = None,
    open_studio: OpenStudio = studio,
) -> int:
    """Write a film of a clip on its ground and return its number of frames, 0 if it was cancelled.

    The ending of `path` decides the format. `character` is a `runtime.character.character.Character` (None: the
    mannequin). `progress` is called after each frame; setting `cancel` stops and removes the file. All runs on the
    calling thread, which may be a worker. Raises UsageError, FileError, DisplayError.
    """
    options.check()
    terrain = terrain.seen_by(clip.size)
    total = count_frames(len(clip) / clip.fps, options.fps)
    check_writer(path, options.size, total)
    camera = camera_path(options, clip, terrain, 0.0 if character is None else character.height)
    writing: deque[Future[None]] = deque()
    try:
        with (
            open_writer(path, options.size, options.fps) as write,
            ThreadPoolExecutor(1, "sport-film") as writer,
            open_studio(options.size, terrain, character, options.quality) as draw,
        ):
            for done, frame in enumerate(film_frames(clip, terrain, options, draw, camera), 1):
                writing.append(writer.submit(write, frame))
                if len(writing) > MAX_QUEUED_FRAMES:
                    writing.popleft().result()
                progress(done, total)
                if cancel is not None and cancel.is_set():
                    raise _Cancelled
            for future in writing:
                future.result()
    except _Cancelled:
        return 0
    return total


class _Cancelled(Exception):
    """Raised when a film is cancelled."""


def film_of_take(
    take: PreparedTake,
    terrain: Terrain,
    path: Path,
    export: ExportOptions,
    film: FilmOptions,
    progress: Progress = lambda done, total: None,
    cancel: threading.Event | None = None,
) -> str:
    """Write a film of a prepared take, with the character of its options; return a sentence about it, "" if cancelled."""
    from runtime.character.character import load_character

    character = None
    if export.character is not None:
        character = load_character(export.character, export.joint_map, export.character_unit)
    frames = make_film(take.clip, terrain, path, film, character=character, progress=progress, cancel=cancel)
    if not frames:
        return ""
    text = f"{path}: {frames} frames at {film.fps:g} fps, {frames / film.fps:.1f} s"
    return text if take.clip.loop is None else f"{text}; {take.clip.loop.describe()}"


# --- in a separate process at low priority, so that the window keeps its frame rate

NICENESS = 5  # of the process: the window has priority, and the film still gets a quarter
POLL_S = 0.1
KILL_S = 0.2  # for a cancelled film to clean up by itself


def film_in_process(
    take: PreparedTake,
    terrain: Terrain,
    path: Path,
    export: ExportOptions,
    film: FilmOptions,
    progress: Progress,
    cancel: threading.Event,
) -> str:
    """Run `film_of_take` in another process and wait for it; also raises SportError if that process is killed."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs,), name="sport-film", daemon=True)

    def end() -> None:
        process.kill()
        process.join()
        sweep_of(process.pid or 0, path.parent)

    with signals_kept_from_children():
        process.start()
    undo_when_ended(process, end)
    theirs.close()
    try:
        work = partial(film_of_take, take, terrain, path, export, film)
        return _follow(ours, work, progress, cancel, process.kill)
    except (EOFError, ConnectionError) as error:
        if cancel.is_set():
            return ""
        raise SportError(
            f"{path}: the encoder was stopped from outside.", "Free some memory, or choose a smaller size."
        ) from error
    finally:
        ours.close()
        end() if cancel.is_set() else process.join()
        forget(process)


Make = Callable[[Progress, threading.Event], str]


def _follow(
    pipe: Connection, work: Make, progress: Progress, cancel: threading.Event, kill: Callable[[], None]
) -> str:
    """Hand over the work, report progress until the film is done, and return its sentence.

    Raises EOFError or ConnectionError if the process is gone.
    """
    cancelled = 0.0
    while True:
        if cancel.is_set() and not cancelled:
            cancelled = time.monotonic()
            pipe.send("cancel")
        elif cancelled and time.monotonic() - cancelled > KILL_S:
            kill()  # it cannot delay the end of the program
        if not pipe.poll(POLL_S):
            continue
        kind, value = pipe.recv()
        if kind == "ready":
            pipe.send(work)
        elif kind == "progress":
            progress(*value)
        elif kind == "failed":
            raise value
        else:
            return str(value)


def _work(pipe: Connection) -> None:
    """Make the film in the other process; it is abandoned if the window's process is gone."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    cancel = threading.Event()

    def report(kind: str, value: Any) -> None:
        try:
            pipe.send((kind, value))
        except OSError:
            cancel.set()

    def progress(done: int, total: int) -> None:
        if pipe.poll():
            cancel.set()
        report("progress", (done, total))

    report("ready", None)
    try:
        make = pipe.recv()
    except (EOFError, OSError):
        return  # the program has ended
    if make == "cancel":
        return
    try:
        report("done", make(progress, cancel))
    except Exception as error:  # raised again in the window's process
        report("failed", error)
