"""Reference images: each ground with the mannequin, and a white character of one's own."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from runtime.terrain.library import TERRAIN_NAMES, make_terrain
from tests.helpers.golden_images import check_golden
from tests.helpers.render_scene import capsule_body, walking_pose
from viewer.render.camera import OrbitCamera
from viewer.render.offscreen import OffscreenTarget
from viewer.render.overlays import Overlays
from viewer.render.quality import FAST, SOFTWARE, Quality
from viewer.render.renderer import Renderer
from viewer.services import Services

SIZE = 240, 150
WHERE = 0.0, 1.6  # x, z


@pytest.fixture(scope="module")
def target() -> Iterator[OffscreenTarget]:
    offscreen = OffscreenTarget(*SIZE)
    yield offscreen
    offscreen.release()


@pytest.fixture(scope="module")
def renderer(target: OffscreenTarget) -> Iterator[Renderer]:
    renderer = Renderer(target.ctx, SOFTWARE)
    renderer.set_character(Services().load_character(None))
    yield renderer
    renderer.release()


def drawn(renderer: Renderer, target: OffscreenTarget, name: str) -> np.ndarray:
    """A ground from where a new user sees it, and a step on it."""
    ground = make_terrain(name)
    renderer.set_terrain(ground)
    camera = OrbitCamera((WHERE[0], float(ground.height(*WHERE)) + 0.87, WHERE[1]), -0.62, 0.22, 4.3)
    renderer.render(target.framebuffer, camera, walking_pose(ground, *WHERE), Overlays())
    return target.read()


@pytest.mark.parametrize("name", TERRAIN_NAMES)
def test_each_ground(renderer: Renderer, target: OffscreenTarget, name: str) -> None:
    check_golden(f"ground_{name}", drawn(renderer, target, name))


@pytest.mark.parametrize("quality", [SOFTWARE, FAST], ids=["software", "fast"])
def test_a_white_character_keeps_its_form(target: OffscreenTarget, quality: Quality) -> None:
    body = capsule_body()
    own = Renderer(target.ctx, quality)
    own.set_character(replace(body, colors=np.ones_like(body.colors)))
    picture = drawn(own, target, "hills")
    own.release()
    check_golden(f"white_{quality.name}", picture)
    white = picture[30:110, 95:145].max(axis=-1)
    assert white.max() < 254, "nothing is lost in white"
    assert np.ptp(white[white > 150]) > 50, "light and shade"
