"""Frames of a character on a ground without a window: what films and contact sheets are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from runtime.assets import asset_path
from runtime.character.character import DEFAULT_CHARACTER, Character, load_character
from runtime.pose import Pose
from runtime.terrain.height_map import Terrain
from viewer.render.camera import Camera
from viewer.render.offscreen import OffscreenTarget
from viewer.render.overlays import Overlays
from viewer.render.quality import HIGH, Quality
from viewer.render.renderer import Renderer

Image = NDArray[np.uint8]


@contextmanager
def studio(
    size: tuple[int, int],
    terrain: Terrain,
    character: Character | None = None,
    quality: Quality = HIGH,
) -> Iterator[Callable[[Camera, Pose], Image]]:
    """A function that draws a pose of `character` (None: the shipped one) as seen by a camera: `(H, W, 3)`, sRGB.

    DisplayError without OpenGL.
    """
    target = OffscreenTarget(*size)
    renderer = Renderer(target.ctx, quality)
    try:
        renderer.set_terrain(terrain)
        renderer.set_character(character or load_character(asset_path(DEFAULT_CHARACTER)))

        def draw(camera: Camera, pose: Pose) -> Image:
            renderer.render(target.framebuffer, camera, pose, Overlays())
            return target.read()

        yield draw
    finally:
        renderer.release()
        target.release()
