"""The controller of one character (its state and settings), and crowds of them. `runtime.motion.frame` computes a frame."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls, Gait
from runtime.edits.body import BodyEdits
from runtime.errors import UsageError
from runtime.feet.foot_lock import FootLock
from runtime.motion.features import FPS
from runtime.motion.frame import Frame, step
from runtime.motion.model import MotionModel
from runtime.motion.request import full_speed
from runtime.motion.state import CharacterState, standing
from runtime.motion.style import Style, StyleBlend, StyleCodes, StyleFolder, StyleMix
from runtime.motion.trajectory import Trajectory, TrajectoryView
from runtime.motion.walkable import WalkableShare
from runtime.pose import Pose
from runtime.records import copied, joined, part
from runtime.terrain.height_map import Terrain
from runtime.terrain.room import nearest_place
from runtime.traversal.traversal import Traversal

log = logging.getLogger("sport.controller")

TEMPERATURE = 0.7  # of the sampler: livelier than the mean, closer to the captures than 1 (docs/model.md)
SETTLE_SECONDS = 2.0
FAULT = "The motion network gave values that are not finite; the character was reset."


def _check(**numbers: float) -> None:
    """Raise UsageError for a number that would make all later poses NaN."""
    for name, value in numbers.items():
        if not np.isfinite(value):
            raise UsageError(f"Controller: {name} {value}: expected a finite number.", "Give a number.")


class Controller:
    """A character with its model, terrain and state, stepped frame by frame.

    Deterministic: the same model, seed, controls, terrain and styles give the same poses. Raises UsageError for numbers
    that are not finite and a negative seed.
    """

    def __init__(
        self,
        model: MotionModel,
        terrain: Terrain,
        seed: int = 0,
        temperature: float = TEMPERATURE,
        strength: float = 1.0,
        response: float = 0.0,
    ) -> None:
        _check(temperature=temperature, strength=strength, response=response)
        if seed < 0:
            raise UsageError(f"Controller: seed {seed}: expected 0 or more.", "Choose another seed.")
        self.model = model
        self.terrain = terrain
        self.temperature = temperature
        self._frame: Frame | None = None
        self.response = response  # 0: starts, stops and turns as in capture, 1: as in a game
        self.seed = seed
        self.message = ""  # description of the network's failure in this frame, for the status line
        self._folder = StyleFolder(model.fold_style, strength, model.calibration)
        self._stand(StyleBlend.constant(model.neutral, strength, self._folder.fold), 0.0, 0.0, 0.0)

    def reset(self, x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Pose:
        """Place the character standing at x, z (metres), facing `yaw` (radians)."""
        _check(x=x, z=z, yaw=yaw)
        self._stand(self._state.styles[0], float(x), float(z), float(yaw))
        return self.pose

    def _stand(self, style: StyleBlend, x: float, z: float, yaw: float) -> None:
        self._state = standing(self.model, self.terrain, style, self.seed, x, z, yaw)
        self._frame, self._pose = None, self._state.poses.pose()

    @property
    def state(self) -> CharacterState:
        """The complete state of the character; later frames do not change this value."""
        return self._state

    def put(self, state: CharacterState, codes: StyleCodes) -> None:
        """Continue from a state, with its style folded from `codes`; ModelError if a code does not fit the model."""
        folder = StyleFolder(self.model.fold_style, codes.strength, self.model.calibration)
        style = StyleBlend.of(codes, folder.fold)
        self._folder, self.seed = folder, int(state.seed[0])
        self._state, self._frame, self._pose = state, None, state.poses.pose()
        self._restyle(style)

    def _restyle(self, style: StyleBlend) -> None:
        self._state = copied(self._state)
        self._state.styles = (style,)

    def set_style(self, style: Array | StyleMix, transition_seconds: float = 1.0) -> None:
        """Blend to Z^t `(6, 64)` or a mix of codes over the given time, starting with the next frame.

        Raises ModelError if a code does not fit the model; the style is then unchanged.
        """
        _check(transition_seconds=transition_seconds)
        self._restyle(self._state.styles[0].towards(style, float(transition_seconds), self._folder.fold))
        if transition_seconds <= 0.0:
            self._state.walkable = WalkableShare()

    def twin(self) -> Controller:
        """Return a new controller with the same model, terrain and settings, to resimulate a take alongside this one."""
        return Controller(self.model, self.terrain, self.seed, self.temperature, self.strength, self.response)

    @property
    def strength(self) -> float:
        """Style strength: 0 is neutral walking, 1 is as the model produces it, more exaggerates."""
        return self._folder.strength

    @strength.setter
    def strength(self, value: float) -> None:
        _check(strength=value)
        if value == self.strength:  # called every frame: do not restart a blend in progress
            return
        self._folder = StyleFolder(self.model.fold_style, value, self.model.calibration)
        self._restyle(self._state.styles[0].at_strength(value, self._folder.fold))

    def settle(self, gait: Gait = Gait.WALK, seconds: float = SETTLE_SECONDS) -> Pose:
        """Simulate hidden frames at rest until the style is settled, and return the pose to begin from.

        A character starts in neutral standing, and the network needs some frames to reach a style. With `Gait.CROUCH`
        it settles crouched.
        """
        root, yaw = self.pose.root_position, self.pose.root_yaw
        rest = Controls(facing=(float(np.sin(yaw)), float(np.cos(yaw))), gait=gait)
        for _ in range(round(seconds * FPS)):
            self.step(rest)
        state = copied(self._state)
        labels = state.trajectory.gait
        state.trajectory = Trajectory.standing(float(root[0]), float(root[2]), yaw)
        state.trajectory.gait[:] = labels
        state.feet = (FootLock(),)
        self._state = state
        return self.pose

    def set_terrain(self, terrain: Terrain) -> None:
        """Change the terrain; the character keeps its X and Z, and any traversal ends.

        Where it has no room to stand, it moves to the nearest free place.
        """
        self.terrain = terrain
        x, z = (float(v) for v in self._state.trajectory.here[0])
        place = nearest_place(terrain, x, z)
        if place != (x, z):
            self.reset(*place, self.pose.root_yaw)
            return
        state = copied(self._state)
        ground = np.array([float(terrain.height(x, z))])
        state.poses = state.poses.raised(ground - state.ground)
        state.jumps[0].raise_by(float(ground[0] - state.ground[0]))
        state.ground = ground
        state.traversals, state.feet, state.edits = (Traversal(),), (FootLock(),), (BodyEdits(),)
        self._state, self._frame = state, None

    @property
    def pose(self) -> Pose:
        """The pose of the last frame."""
        return self._pose

    @property
    def style(self) -> Style:
        """The style of this frame (a blend during a transition)."""
        return self._state.styles[0].style

    @property
    def requested_speed(self) -> float:
        """Speed (m/s) requested by the stick in the last frame."""
        return float(self._state.requested_speed[0])

    def full_speed(self, gait: Gait) -> float:
        """Return the speed (m/s) that a full stick requests in the present style."""
        return full_speed(self.style, gait)

    @property
    def unlocked(self) -> tuple[Array, Array]:
        """Return hips `(3,)` and local rotations `(31, 4)` before foot lock, from the network or a keyframed traversal."""
        if self._frame is None:
            return self.pose.hips_position, self.pose.local_rotations
        return self._frame.hips[0], self._frame.local[0]

    @property
    def blocked(self) -> str | None:
        """The reason why the character is blocked, for the status line, or None."""
        return None if self._frame is None else self._frame.reasons[0]

    @property
    def traversal(self) -> str:
        """The kind of traversal in progress: "bar", "gap", "up", "down", "climb", "descend", or ""."""
        return self._state.traversals[0].kind

    @property
    def trajectory(self) -> TrajectoryView:
        """Return the 12 trajectory samples, projected onto the terrain."""
        return self._state.trajectory.view(self.terrain)

    def step(self, controls: Controls) -> Pose:
        """Simulate 1/60 s and return the pose. If the network fails, the character stands and `message` says so for this frame."""
        return self.take(
            *step(self.model, self._state, (controls,), self.terrain, (self.temperature,), (self.response,))
        )

    def take(self, state: CharacterState, frame: Frame) -> Pose:
        """Take over a simulated state and frame of this character, and return its pose."""
        self._state, self._frame, self._pose = state, frame, state.poses.pose()
        self.message = FAULT if frame.faults[0] else ""
        if self.message:
            log.error(self.message)
        return self._pose


MAX_CHARACTERS = 64  # characters
MIN_BATCH_CHARACTERS = 4  # from this many on, they run in full precision with one network call per thread


class Crowd:
    """Steps several controllers with one model and terrain together; each keeps its own style, seed, strength and place.

    Fewer than MIN_BATCH_CHARACTERS are bit-identical to stepping alone; for more, the first step loads the model in full precision.
    Raises UsageError for none, for more than MAX_CHARACTERS, and for controllers of several models or terrains.
    """

    def __init__(self, members: Sequence[Controller]) -> None:
        if not 1 <= len(members) <= MAX_CHARACTERS:
            raise UsageError(
                f"Crowd: {len(members)} characters; expected 1 to {MAX_CHARACTERS}.", "Take fewer."
            )
        if any(m.model is not members[0].model or m.terrain is not members[0].terrain for m in members):
            raise UsageError("Crowd: characters of several models or grounds.", "Give all the same.")
        self.members = tuple(members)
        self._helper = ThreadPoolExecutor(1, "crowd")

    def close(self) -> None:
        """Stop the helper thread."""
        self._helper.shutdown()

    @property
    def terrain(self) -> Terrain:
        """The terrain of all members."""
        return self.members[0].terrain

    def set_terrain(self, terrain: Terrain) -> None:
        """Change the terrain of all members; they keep their places."""
        for member in self.members:
            member.set_terrain(terrain)

    def step(self, controls: Controls | Sequence[Controls]) -> list[Pose]:
        """Simulate 1/60 s of every character, with one stick for all or one each; half of them on the helper thread."""
        middle = len(self.members) // 2
        sticks = [controls] * len(self.members) if isinstance(controls, Controls) else controls
        halves = self.members[:middle], self.members[middle:]
        model = self.members[0].model
        model = model.in_full if len(self.members) >= MIN_BATCH_CHARACTERS else model
        other = self._helper.submit(_stepped, model, halves[0], sticks[:middle]) if middle else None
        frames = _stepped(model, halves[1], sticks[middle:])
        frames = frames if other is None else other.result() + frames
        return [member.take(*frame) for member, frame in zip(self.members, frames, strict=True)]


def _stepped(
    model: MotionModel, members: Sequence[Controller], controls: Sequence[Controls]
) -> list[tuple[CharacterState, Frame]]:
    """Return the new states and frames of characters that are stepped together."""
    first = members[0]
    state, frame = step(
        model,
        joined([member.state for member in members]),
        controls,
        first.terrain,
        [member.temperature for member in members],
        [member.response for member in members],
    )
    return [(part(state, i), frame.part(i)) for i in range(len(members))]
