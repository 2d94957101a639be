"""A reference film: small compressed pictures in memory, for immediate access to any of them."""

import bisect
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.errors import FileError
from runtime.safe_read import open_regular, reason

SUFFIXES = (".mp4", ".mov", ".m4v", ".webm", ".mkv", ".avi", ".gif", ".webp")
MAX_SIDE_PX = 640  # larger pictures are scaled down
MAX_PICTURES, MAX_SECONDS = 7200, 240.0  # limits of what is read
MAX_KEPT_BYTES = 200 * 1024 * 1024  # of all pictures
MAX_SOURCE_PIXELS = 1 << 24  # per picture: the decoder holds several
JPEG_QUALITY = 85
# single-file formats that do not refer to other files
ALONE = {"format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,gif", "protocol_whitelist": "none"}
REMEDY = "Convert it to MP4 (H.264) or GIF."


@dataclass(frozen=True, eq=False)
class Video:
    """A film in memory: JPEG pictures, with the time in seconds at which each begins."""

    path: Path
    size: tuple[int, int]
    pictures: tuple[bytes, ...]
    times: tuple[float, ...]  # from 0 on, ascending
    seconds: float
    cut: bool = False  # the film is longer

    def index(self, time_s: float) -> int:
        """Return the index of the picture at a time, limited to the first and last."""
        return max(bisect.bisect_right(self.times, time_s + 1e-6) - 1, 0)

    def picture(self, index: int) -> NDArray[np.uint8]:
        """Return a picture `(H, W, 3)`, sRGB, top row first."""
        from PIL import Image

        with Image.open(io.BytesIO(self.pictures[index])) as image:
            return np.asarray(image.convert("RGB"))

    def describe(self) -> str:
        more = f", the first {self.seconds:.0f} s of it" if self.cut else ""
        return f"{self.path.name}: {len(self.pictures)} pictures, {self.seconds:.1f} s{more}"


def read_video(path: Path) -> Video:
    """Read a film; FileError says why it cannot be read."""
    made: list[tuple[float, bytes, tuple[int, int]]] = []
    try:
        cut = _read_pictures(path, made)
    except FileError:
        raise
    except Exception as error:  # decoders raise arbitrary errors for damaged files
        if not made:
            raise FileError(f"{path.name}: not a readable film ({reason(error)}).", REMEDY) from error
        cut = True
    if not made:
        raise FileError(f"{path.name}: a film without frames.", REMEDY)
    times, pictures, sizes = zip(*made, strict=True)
    each = (times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else 0.04
    starts = tuple(time_s - times[0] for time_s in times)
    return Video(path, sizes[0], pictures, starts, starts[-1] + each, cut)


def _read_pictures(path: Path, made: list[tuple[float, bytes, tuple[int, int]]]) -> bool:
    """Read times, JPEG pictures and their sizes into `made`; return whether the film is longer."""
    kept = 0
    for time_s, picture in _webp(path) if path.suffix.lower() == ".webp" else _decoded(path):
        if len(made) == MAX_PICTURES or time_s > MAX_SECONDS or kept > MAX_KEPT_BYTES:
            return True
        if not made or time_s > made[-1][0]:  # skip damaged or duplicate time stamps
            made.append((time_s, *_small(picture)))
            kept += len(made[-1][1])
    return False


def _small(image: Any) -> tuple[bytes, tuple[int, int]]:
    image.thumbnail((MAX_SIDE_PX, MAX_SIDE_PX))
    file = io.BytesIO()
    image.convert("RGB").save(file, "JPEG", quality=JPEG_QUALITY)
    return file.getvalue(), image.size


def _check(path: Path, width: int, height: int) -> None:
    if not 0 < width * height <= MAX_SOURCE_PIXELS:
        raise FileError(
            f"{path.name}: pictures of {width} x {height}.", "Make it smaller: 1920x1080 is plenty."
        )


def _decoded(path: Path) -> Iterator[tuple[float, Any]]:
    try:
        import av
    except ImportError as error:
        raise FileError(
            f"{path.name}: films need the Python package 'av' ({error}).", "Run pip install av."
        ) from error
    with open_regular(path) as file, av.open(file, "r", options=ALONE, io_open=_no_other) as container:
        if not container.streams.video:
            raise FileError(f"{path.name}: it has sound only.", "Choose a film.")
        stream = container.streams.video[0]
        _check(path, stream.codec_context.width, stream.codec_context.height)
        rate = float(stream.average_rate or 25)
        for number, frame in enumerate(container.decode(stream)):
            _check(path, frame.width, frame.height)
            yield number / rate if frame.time is None else float(frame.time), frame.to_image()


def _no_other(address: str, _flags: int, _options: dict[str, str]) -> Any:
    raise FileError(f"{address[:80]}: a film must be one file.", REMEDY)


def _webp(path: Path) -> Iterator[tuple[float, Any]]:
    from PIL import Image, ImageSequence

    time_s = 0.0
    with open_regular(path) as file, Image.open(file) as image:
        _check(path, *image.size)
        for frame in ImageSequence.Iterator(image):
            yield time_s, frame.convert("RGB")
            time_s += max(float(frame.info.get("duration", 0)), 10.0) / 1000.0
