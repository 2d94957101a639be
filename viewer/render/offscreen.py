"""Rendering without a window: a standalone EGL context, and a framebuffer to draw into."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from runtime.errors import DisplayError

REMEDY = "Install the OpenGL libraries: apt-get install libegl1 libgl1 (or your system's Mesa packages)."


def create_offscreen_context() -> moderngl.Context:
    """A standalone OpenGL 3.3 context through EGL; DisplayError names the library that is missing."""
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
    """An image in memory: `ctx` to make a `Renderer` with, `framebuffer` to render into, `read()` to look at."""

    def __init__(self, width: int, height: int) -> None:
        self.ctx = create_offscreen_context()
        self.size = (width, height)
        self._color = self.ctx.renderbuffer(self.size, 4)
        self.framebuffer = self.ctx.framebuffer([self._color])

    def read(self) -> NDArray[np.uint8]:
        """The image `(H, W, 3)`, sRGB, first row on top."""
        width, height = self.size
        data = self.framebuffer.read(components=3, alignment=1)
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)[::-1].copy()

    def release(self) -> None:
        """Free the framebuffer and the context."""
        self.framebuffer.release()
        self._color.release()
        self.ctx.release()
