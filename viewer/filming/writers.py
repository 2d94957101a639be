"""Film writers: MP4, numbered PNG files, animated WebP or GIF; each complete or not at all."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path, temporary_folder
from runtime.errors import FileError, UsageError

Frame = NDArray[np.uint8]  # (H, W, 3), sRGB
FrameWriter = Callable[[Frame], None]  # called with each frame in order

CODEC = "libx264"
_X264 = {"preset": "veryfast", "crf": "18"}
_BT709 = 1  # code for primaries, transfer and matrix of HD video
_LIMITED = 1  # code for the range 16..235
ANIMATED: dict[str, tuple[str, dict[str, Any]]] = {
    ".webp": ("WEBP", {"quality": 70, "method": 4}),
    ".gif": ("GIF", {"optimize": True}),
}
MAX_ANIMATED_FRAMES = 1200  # all held in memory


def check_writer(path: Path, size: tuple[int, int], frames: int) -> None:
    """Raise UsageError if a film of this size and length cannot be written with this ending."""
    suffix = path.suffix.lower()
    if suffix == ".mp4" and any(side % 2 for side in size):
        raise UsageError(f" {size[0]}x{size[1]}: H.264 needs even numbers.", "Try 1280x720.", "size")
    if suffix == ".mp4":
        _import_av()
    if suffix in ANIMATED and frames > MAX_ANIMATED_FRAMES:
        raise UsageError(
            f"{path}: {frames} frames; {suffix} takes {MAX_ANIMATED_FRAMES} at most.",
            "Choose .mp4, a shorter range or fewer frames a second.",
        )


@contextmanager
def open_writer(path: Path, size: tuple[int, int], fps: float) -> Iterator[FrameWriter]:
    """Open a writer for the ending of `path`; an error in the block removes the file. Raises FileError."""
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise UsageError(f"{path}: not a film format.", "Choose .mp4, .png, .webp or .gif.")
    with WRITERS[suffix](path, size, fps) as write:
        yield write


def _import_av() -> Any:
    try:
        import av
    except ImportError as error:
        raise UsageError(
            f"MP4: the Python package 'av' cannot be used ({error}).", "Run pip install av, or choose .png."
        ) from error
    return av


@contextmanager
def _mp4(path: Path, size: tuple[int, int], fps: float) -> Iterator[FrameWriter]:
    """Write H.264, BT.709, with the index in front so that it plays while it loads."""
    av = _import_av()
    rate = Fraction(fps).limit_denominator(1001)
    with atomic_path(path) as temporary:
        try:
            container = av.open(str(temporary), "w", format="mp4", options={"movflags": "+faststart"})
            stream = container.add_stream(CODEC, rate=rate, options=_X264)
        except (av.FFmpegError, OSError, ValueError) as error:
            raise FileError(
                f"{path}: the H.264 encoder cannot start ({error}).", "Choose .png frames."
            ) from error
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.time_base = 1 / rate
        context.colorspace = context.color_primaries = context.color_trc = _BT709
        context.color_range = _LIMITED
        count = 0
        failures: list[FileError] = []

        def encode(frame: Any) -> None:
            if failures:  # a muxer that has failed crashes the process when it is called again
                raise failures[0]
            try:
                container.mux(stream.encode(frame))
            except (av.FFmpegError, OSError) as error:
                why = getattr(error, "strerror", None) or error
                failures.append(FileError(f"{path}: {why}.", "Choose a folder with space left."))
                raise failures[0] from error

        def write(frame: Frame) -> None:
            nonlocal count
            rgb = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
            yuv = rgb.reformat(
                format="yuv420p", src_colorspace="ITU709", dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            yuv.pts, yuv.time_base = count, context.time_base
            count += 1
            encode(yuv)

        with container:
            yield write
            encode(None)


@contextmanager
def _numbered(path: Path, _size: tuple[int, int], _fps: float) -> Iterator[FrameWriter]:
    """Write frames NAME_00000.png, …; they replace those of an older film only when all are written."""
    from PIL import Image

    written: list[Path] = []

    def write(frame: Frame) -> None:
        written.append(folder / f"{path.stem}_{len(written):05d}.png")
        Image.fromarray(frame).save(written[-1], compress_level=3)

    with temporary_folder(beside=path) as folder:
        yield write
        for made in written:
            made.replace(path.with_name(made.name))


@contextmanager
def _animation(path: Path, _size: tuple[int, int], fps: float) -> Iterator[FrameWriter]:
    from PIL import Image

    frames: list[Any] = []
    yield lambda frame: frames.append(Image.fromarray(frame))
    kind, options = ANIMATED[path.suffix.lower()]
    tick = 10 if kind == "GIF" else 1  # milliseconds; each frame ends at the tick nearest to its time
    ends = np.round(np.arange(len(frames) + 1) * 1000.0 / fps / tick) * tick
    duration = [int(end - begin) for begin, end in pairwise(ends)]
    with atomic_path(path) as temporary:
        frames[0].save(
            temporary, kind, save_all=True, append_images=frames[1:], duration=duration, loop=0, **options
        )


WRITERS = {".mp4": _mp4, ".png": _numbered, ".webp": _animation, ".gif": _animation}
