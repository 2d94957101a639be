"""Where the frames of a film go: MP4, numbered PNG files, animated WebP or GIF; each whole or not at all."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path
from runtime.errors import FileError, UsageError

Frame = NDArray[np.uint8]

CODEC = "libx264"
_X264 = {"preset": "veryfast", "crf": "18"}
_BT709 = 1  # code of primaries, transfer and matrix of HD video
_LIMITED = 1  # code of the range 16..235
ANIMATED = {".webp": "WEBP", ".gif": "GIF"}
MAX_ANIMATED_FRAMES = 1200  # they are all held in memory


class FrameWriter(Protocol):
    """Takes frames in their order."""

    def add(self, frame: Frame) -> None:
        """One more frame `(H, W, 3)`, sRGB."""
        ...


def check_writer(path: Path, size: tuple[int, int], frames: int) -> None:
    """UsageError when a film of this size and length cannot be written with this ending."""
    suffix = path.suffix.lower()
    if suffix == ".mp4" and any(side % 2 for side in size):
        raise UsageError(f" {size[0]}x{size[1]}: H.264 needs even numbers.", "Try 1280x720.", "size")
    if suffix == ".mp4":
        _open_av()
    if suffix in ANIMATED and frames > MAX_ANIMATED_FRAMES:
        raise UsageError(
            f"{path}: {frames} frames; {suffix} takes {MAX_ANIMATED_FRAMES} at most.",
            "Choose .mp4, a shorter --range or a lower --fps.",
        )


@contextlib.contextmanager
def open_writer(path: Path, size: tuple[int, int], fps: float) -> Iterator[FrameWriter]:
    """A writer for the ending of `path`; what it wrote disappears when the block ends with an error. FileError."""
    suffix = path.suffix.lower()
    if suffix == ".mp4":
        with atomic_path(path) as temporary, _Mp4(temporary, path, size, fps) as film:
            yield film
    elif suffix == ".png":
        with _numbered(path) as numbered:
            yield numbered
    elif suffix in ANIMATED:
        animation = _Animation([])
        yield animation
        with atomic_path(path) as temporary:
            animation.save(temporary, path, fps)
    else:
        raise UsageError(f"{path}: no film is written with this ending.", "Choose .mp4, .png, .webp or .gif.")


def _open_av() -> Any:
    try:
        import av
    except ImportError as error:
        raise UsageError(
            f"MP4: the Python package 'av' cannot be used ({error}).", "Run pip install av, or choose .png."
        ) from error
    return av


class _Mp4:
    """H.264 in MP4, BT.709, with the index in front so that it plays while it loads."""

    def __init__(self, temporary: Path, path: Path, size: tuple[int, int], fps: float) -> None:
        self._av = av = _open_av()
        self._path = path
        try:
            self._container = av.open(str(temporary), "w", format="mp4", options={"movflags": "+faststart"})
            rate = Fraction(fps).limit_denominator(1001)
            stream = self._container.add_stream(CODEC, rate=rate, options=_X264)
        except (av.FFmpegError, OSError, ValueError) as error:
            raise FileError(
                f"{path}: no H.264 film can be begun ({error}).", "Choose .png frames."
            ) from error
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.time_base = 1 / rate
        context.colorspace = context.color_primaries = context.color_trc = _BT709
        context.color_range = _LIMITED
        self._stream, self._count = stream, 0

    def __enter__(self) -> _Mp4:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._mux(None)
        finally:
            self._container.close()

    def add(self, frame: Frame) -> None:
        """Encode one frame."""
        rgb = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
        yuv = rgb.reformat(
            format="yuv420p", src_colorspace="ITU709", dst_colorspace="ITU709", dst_color_range="MPEG"
        )
        yuv.pts, yuv.time_base = self._count, self._stream.codec_context.time_base
        self._count += 1
        self._mux(yuv)

    def _mux(self, frame: Any) -> None:
        try:
            for packet in self._stream.encode(frame):
                self._container.mux(packet)
        except (self._av.FFmpegError, OSError) as error:
            raise FileError(
                f"{self._path}: the film cannot be written ({error}).", "Choose a folder with space left."
            ) from error


class _NumberedPng:
    def __init__(self, path: Path) -> None:
        self._path = path
        self.written: list[Path] = []

    def add(self, frame: Frame) -> None:
        from PIL import Image

        target = self._path.with_name(f"{self._path.stem}_{len(self.written):05d}.png")
        with atomic_path(target) as temporary:
            Image.fromarray(frame).save(temporary, format="PNG", compress_level=3)
        self.written.append(target)


@contextlib.contextmanager
def _numbered(path: Path) -> Iterator[_NumberedPng]:
    """Frames NAME_00000.png and on; without their film they are taken away again."""
    writer = _NumberedPng(path)
    try:
        yield writer
    except BaseException:
        for made in writer.written:
            made.unlink(missing_ok=True)
        raise


class _Animation:
    def __init__(self, frames: list[Any]) -> None:
        self._frames = frames

    def add(self, frame: Frame) -> None:
        from PIL import Image

        self._frames.append(Image.fromarray(frame))

    def save(self, temporary: Path, path: Path, fps: float) -> None:
        """All frames as one endless animation."""
        kind = ANIMATED[path.suffix.lower()]
        options: dict[str, Any] = {"quality": 70, "method": 4} if kind == "WEBP" else {"optimize": True}
        first, *others = self._frames
        tick = 10 if kind == "GIF" else 1  # milliseconds; each frame ends at the tick nearest to its time
        ends = np.round(np.arange(len(self._frames) + 1) * 1000.0 / fps / tick) * tick
        first.save(
            temporary,
            kind,
            save_all=True,
            append_images=others,
            duration=[int(end - begin) for begin, end in pairwise(ends)],
            loop=0,
            **options,
        )
