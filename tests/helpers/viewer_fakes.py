"""Fakes of the motion model and its prompts, to test the application without networks."""

from __future__ import annotations

import math
import threading
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from runtime.controls import Controls, Gait
from runtime.errors import SportError
from runtime.motion.state import CharacterState, standing
from runtime.motion.style import StyleBlend, StyleCodes
from runtime.pose import Pose
from runtime.prompts.answer import Answer
from runtime.prompts.expander import Expansion, check_prompt
from runtime.prompts.parts import PartDescriptions
from runtime.terrain.height_map import Terrain
from tests.helpers.walker import WalkerModel
from viewer.scene.simulation import make_pose, rest_pose
from viewer.services import Loaded, Services

_WALKER = WalkerModel()
SPEEDS = {Gait.WALK: 1.4, Gait.JOG: 3.0, Gait.CROUCH: 0.8, Gait.JUMP: 1.4}  # m/s


class FakeController:
    """Slides the standing pose over the ground according to the controls."""

    def __init__(self, terrain: Terrain) -> None:
        self.terrain = terrain
        self.x, self.z, self.yaw = 0.0, 0.0, 0.0
        self.temperature = self.strength = 1.0
        self.response = 0.0
        self.steps = self.styled_at_step = 0
        self.styles: list[tuple[np.ndarray, float]] = []
        self.fail_with: Exception | None = None
        self.answer_nan = False
        self.message = ""
        self.blocked: str | None = None
        self.traversal = ""
        self.seed = 0

    def step(self, controls: Controls) -> Pose:
        if self.fail_with is not None:
            raise self.fail_with
        self.steps += 1
        speed = SPEEDS[controls.gait] / 60.0
        self.x += controls.move[0] * speed
        self.z += controls.move[1] * speed
        if controls.facing is not None:
            self.yaw = math.atan2(*controls.facing)
        elif controls.move != (0.0, 0.0):
            self.yaw = math.atan2(*controls.move)
        ground = float(self.terrain.height(self.x, self.z))
        standing = rest_pose(self.terrain, self.x, self.z)
        local = standing.local_rotations.copy()
        local[0] = (math.cos(self.yaw / 2), 0.0, math.sin(self.yaw / 2), 0.0)
        hips = standing.hips_position * (np.nan if self.answer_nan else 1.0)
        return make_pose(hips, local, np.ones(4), ground, self.yaw)

    def settle(self, gait: Gait = Gait.WALK, seconds: float = 0.0) -> Pose:
        return self.step(Controls(facing=(math.sin(self.yaw), math.cos(self.yaw))))

    def full_speed(self, gait: Gait) -> float:
        return SPEEDS[gait]

    @property
    def trajectory(self) -> Any:
        ahead = np.linspace(-1.0, 1.0, 12)
        x, z = self.x + ahead * math.sin(self.yaw), self.z + ahead * math.cos(self.yaw)
        positions = np.stack([x, self.terrain.height(x, z), z], -1)
        directions = np.tile([math.sin(self.yaw), math.cos(self.yaw)], (12, 1))
        return SimpleNamespace(positions=positions, directions=directions)

    def set_style(self, z: np.ndarray, transition_seconds: float) -> None:
        self.styles.append((z, transition_seconds))
        self.styled_at_step = self.steps  # number of earlier steps

    def set_terrain(self, terrain: Terrain) -> None:
        self.terrain = terrain

    def reset(self, x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Pose:
        self.x, self.z, self.yaw = x, z, yaw
        ground = float(self.terrain.height(x, z))
        standing = rest_pose(self.terrain, x, z, yaw)
        return make_pose(standing.hips_position, standing.local_rotations, np.ones(4), ground, yaw)

    @property
    def state(self) -> CharacterState:
        """Return the state for a snapshot: position, and number of steps."""
        style = StyleBlend.constant(
            _WALKER.neutral, self.strength, lambda mix, like=None: _WALKER.fold_style(mix.codes[0], 1.0)
        )
        state = standing(_WALKER, self.terrain, style, self.seed, self.x, self.z, self.yaw)
        state.frame = np.array([self.steps])
        return state

    def put(self, state: CharacterState, codes: StyleCodes) -> None:
        (self.x, self.z), self.yaw = state.trajectory.here[0].tolist(), float(state.poses.yaw[0])
        self.steps, self.seed, self.strength = int(state.frame[0]), int(state.seed[0]), codes.strength

    def twin(self) -> FakeController:
        return FakeController(self.terrain)


class FakeLibrary:
    """Repeats the prompt in each part; `near` is returned as nearest for every prompt."""

    near: tuple[tuple[str, float], ...] = (("waddling duck", 0.8), ("goose step", 0.4))

    def __init__(self) -> None:
        self.looked_up: list[tuple[str, str]] = []  # text and thread

    def expand(self, prompt: str) -> Expansion:
        prompt = check_prompt(prompt)
        parts = ("arm", "arm 2", "leg", "leg 2", "torso", "head")
        parts = PartDescriptions(*(f"{part} of {prompt}" for part in parts))
        return Expansion(parts, "library", ((prompt, 0.9), *self.near))

    def nearest(self, text: str) -> tuple[tuple[str, float], ...]:
        self.looked_up.append((text, threading.current_thread().name))
        return self.near


class FakeEncoder:
    """Encodes each part by its own words only: their length and first character."""

    def encode(self, descriptions: PartDescriptions) -> np.ndarray:
        return np.stack([self.code(words) for words in descriptions.as_tuple()])

    @staticmethod
    def code(words: str) -> np.ndarray:
        return np.linspace(len(words), ord(words[0]), 64, dtype=np.float32)


class FakePrompts:
    """A prompt worker without a thread: answers at the next poll."""

    def __init__(self, expander: Any) -> None:
        self.expander, self.encoder = expander, FakeEncoder()
        self.asked: list[str | PartDescriptions] = []
        self.held = False  # while true, there is no answer
        self._result: Any = None

    @property
    def busy(self) -> bool:
        return self._result is not None

    def submit(self, prompt: str | PartDescriptions) -> None:
        self.asked.append(prompt)
        try:
            self._result = self.answer(prompt)
        except SportError as error:
            self._result = error

    def answer(self, prompt: str | PartDescriptions) -> Answer:
        given = isinstance(prompt, PartDescriptions)
        expansion = Expansion(prompt, "explicit") if given else self.expander.expand(prompt)
        return Answer.of(prompt, expansion, self.encoder.encode(expansion.descriptions), 1.0)

    def withdraw(self) -> None:
        self._result = None

    def use(self, expander: Any) -> None:
        self.expander = expander

    def poll(self) -> Any:
        if self.held:
            return None
        result, self._result = self._result, None
        if isinstance(result, SportError):
            raise result
        return result

    def close(self, timeout_s: float = 2.0) -> bool:
        self._result = None
        return True


class FakeRenderer:
    """Records draw requests, and clears the picture if `drawn`."""

    def __init__(self, ctx: Any, quality: str = "", drawn: bool = True) -> None:
        self.drawn = drawn
        self.quality = SimpleNamespace(name=quality or "software")
        self.ctx = ctx
        self.terrain: Terrain | None = None
        self.poses: list[Pose] = []

    def set_terrain(self, terrain: Terrain) -> None:
        self.terrain = terrain

    def set_character(self, character: Any) -> None:
        self.character = character

    def render(self, framebuffer: Any, camera: Any, pose: Pose, overlays: Any) -> None:
        self.poses.append(pose)
        self.overlays = overlays
        if self.drawn:
            framebuffer.use()
            framebuffer.clear(0.5, 0.6, 0.7, 1.0)

    def release(self) -> None:
        self.ctx = None


class FakeCrowd:
    """Fake controllers, stepped in sequence."""

    def __init__(self, members: list[Any]) -> None:
        self.members = members

    def step(self, controls: Controls) -> list[Pose]:
        return [member.step(controls) for member in self.members]

    def set_terrain(self, terrain: Terrain) -> None:
        for member in self.members:
            member.set_terrain(terrain)

    def close(self) -> None:
        pass


def fake_services(real_renderer: bool = False, drawn: bool = True) -> Services:
    """Return services with a fake model, real terrains, and by default fake character and renderer; see `FakeRenderer`."""
    real = Services()

    def load_model(directory: Any, terrain: Terrain, seed: int, gpt: Any) -> Loaded:
        library = FakeLibrary()
        workers = FakePrompts(library), FakePrompts(library)
        return Loaded(FakeController(terrain), workers, library, "fake", "numpy")

    return Services(
        load_model=load_model,
        load_terrain=real.load_terrain,
        load_character=real.load_character
        if real_renderer
        else lambda path, joints=None, unit="": SimpleNamespace(path=path, joint_map=joints, unit=unit),
        make_renderer=real.make_renderer if real_renderer else partial(FakeRenderer, drawn=drawn),
        terrain_names=real.terrain_names,
        make_crowd=FakeCrowd,
        library_prompts=lambda: (
            ("a proud king",),
            ("a proud king", "proud peacock", "someone limping", "an old king"),
        ),
        open_expander=real.open_expander,
        check_endpoint=real.check_endpoint,
    )
