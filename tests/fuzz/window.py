"""The target that is the window: damaged files of every kind are dropped on it, and it says so and goes on."""

import contextlib
import random
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from runtime.errors import FileError
from tests.helpers.app_driver import InjectedPads, controller, run
from tests.helpers.viewer_fakes import fake_services
from viewer.app import App
from viewer.messages import Level
from viewer.options import ViewOptions
from viewer.services import Services

from . import files, sessions
from .target import Target, put

_SUFFIXES = {
    "BVH": ".bvh", "motion .glb": ".glb", "character .glb": ".vrm", "packed character": ".glb", "FBX": ".fbx",
    "character .gltf": ".gltf", "session": ".sport", "ground .png": ".png", "ground .npy": ".npy", "ground .obj": ".obj",
}  # fmt: skip
_KINDS = {target.name: target for target in (*files.TARGETS, *sessions.TARGETS) if target.name in _SUFFIXES}


@contextlib.contextmanager
def _opened(folder: Path) -> Iterator[App]:
    services = replace(fake_services(), load_character=Services().load_character)
    options = ViewOptions(offscreen=True, terrain="flat", width=320, height=240, panels=False)
    app = App(options, services, InjectedPads(), folder / "config")
    app.window.draw_interface = lambda: None  # type: ignore[method-assign]
    try:
        run(app)
        yield app
    finally:
        app.close()


@cache
def _seeds(folder: Path, name: str) -> list[bytes]:
    home = folder / name.replace(" ", "")
    home.mkdir()
    return _KINDS[name].seeds(home)


def _damaged(rng: random.Random, name: bytes) -> bytes:
    return name + b"|" + str(rng.getrandbits(40)).encode()


def _drop(folder: Path, data: bytes) -> None:
    """FileError with what the window says; AssertionError where it says nothing, or does not go on."""
    name, _, seed = data.decode().partition("|")
    rng, target = random.Random(seed), _KINDS[name]
    path = put(folder, f"dropped{_SUFFIXES[name]}", target.damage(rng, rng.choice(_seeds(folder, name))))
    with _opened(folder) as app:
        app.messages.recent.clear()
        app.open_files([path])
        run(app, 3)
        wrong = [message.text for message in app.messages.recent if message.level is Level.ERROR]
        steps = controller(app).steps
        app.takes.close_playback()
        run(app, 2)
        assert controller(app).steps > steps
        assert np.isfinite(app.scene.simulation.current.positions).all()
    assert len(wrong) <= 1, wrong
    if wrong:
        raise FileError(wrong[0])


TARGETS = (
    Target("dropped on the window", lambda _: [name.encode() for name in _KINDS], _damaged, _drop, 0.1),
)
