"""Rendering without a window: a standalone EGL context, and a framebuffer to draw into."""

import io
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from runtime.atomic import atomic_path, write_new
from runtime.errors import DisplayError
from runtime.safe_read import expanded


def save_png(pixels: NDArray[np.uint8], path: Path, new: bool = False) -> Path:
    """Write an image `(height, width, 3)` as PNG and return the path. Raises FileError.

    With `new`, no file is replaced: a taken name becomes name-2, name-3, ….
    """
    from PIL import Image

    path = expanded(path)
    if new:
        data = io.BytesIO()
        Image.fromarray(pixels).save(data, format="PNG", compress_level=3)
        return write_new(path, data.getvalue())
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=3)
    return path


REMEDY = "Install the OpenGL libraries: apt-get install libegl1 libgl1 (or your system's Mesa packages)."


def create_offscreen_context() -> moderngl.Context:
    """Return a standalone OpenGL 3.3 context created by EGL; DisplayError names the missing library."""
    try:
        settings: dict[str, Any] = {"backend": "egl", "libegl": "libEGL.so.1", "libgl": "libGL.so.1"}
        return moderngl.create_context(require=330, standalone=True, **settings)
    except Exception as error:  # glcontext and moderngl raise bare Exception here
        raise DisplayError(f"{_missing_library(str(error))} ({error}).", REMEDY) from error


def _missing_library(message: str) -> str:
    for library in ("libEGL", "libGL"):
        if library in message:
            return f"{library} was not found, so no OpenGL context can be made"
    return "libEGL and libGL were found, but gave no OpenGL 3.3 context"


class OffscreenTarget:
    """An offscreen image: make a `Renderer` with `ctx`, render into `framebuffer`, and read the pixels with `read()`."""

    def __init__(self, width: int, height: int) -> None:
        self.ctx = create_offscreen_context()
        self.size = (width, height)
        self._color = self.ctx.renderbuffer(self.size, 4)
        self.framebuffer = self.ctx.framebuffer([self._color])

    def read(self) -> NDArray[np.uint8]:
        """Return the image `(H, W, 3)`, sRGB, top row first."""
        width, height = self.size
        data = self.framebuffer.read(components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)[::-1].copy()

    def release(self) -> None:
        self.framebuffer.release()
        self._color.release()
        self.ctx.release()
