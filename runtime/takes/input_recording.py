"""The input of a take: the stick of every frame and the changes, from which its frames can be resimulated.

After an edit (`input_edits`) a take is resimulated with the recorded stick: frames before the edit stay bit-identical,
and so do later ones if nothing was changed. Keyframes hold the controller's state every few seconds, so that
no take has to be resimulated from its start.
"""

from __future__ import annotations

import math
from array import array
from collections import deque
from collections.abc import Callable, Iterable, MutableSequence, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, Protocol, overload

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.controls import MAX_STICK, Controls, Gait
from runtime.errors import FileError
from runtime.motion.features import FPS
from runtime.motion.snapshot import Snapshot, take_snapshot
from runtime.motion.style import StyleMix
from runtime.pose import Pose
from runtime.takes.clip import Clip, are_poses, shift_prompts, stacked
from runtime.takes.metadata import PromptEvent, gait_seconds
from runtime.takes.recorder import follows_live
from runtime.terrain.height_map import Terrain

KEYFRAME_STEPS = 120  # between two keyframes: 2 s are resimulated in about a quarter of a second

COLUMNS = 8  # per frame: stick x and z, facing x and z (NaN if none), gait, temperature, strength, response
MAX_SETTING = 10.0
_NOWHERE = (math.nan, math.nan)


@dataclass(frozen=True)
class InputFrame:
    """The controls of one simulated frame, and the settings that can change from frame to frame."""

    controls: Controls
    temperature: float
    strength: float
    response: float = 0.0

    @property
    def row(self) -> tuple[float, ...]:
        """Return the frame as `COLUMNS` numbers."""
        requested = self.controls
        facing = requested.facing or _NOWHERE
        return (*requested.move, *facing, int(requested.gait), self.temperature, self.strength, self.response)


class InputFrames(Sequence[InputFrame]):
    """The immutable input frames of a take; slices share memory."""

    def __init__(self, rows: NDArray[np.float64]) -> None:
        """Rows `(T, COLUMNS)` as `InputFrame.row` has them; they must not be changed later."""
        self.rows = rows.view()
        self.rows.flags.writeable = False

    @staticmethod
    def of(frames: Iterable[InputFrame]) -> InputFrames:
        return InputFrames(np.array([frame.row for frame in frames], np.float64).reshape(-1, COLUMNS))

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, at: int) -> InputFrame: ...
    @overload
    def __getitem__(self, at: slice) -> InputFrames: ...
    def __getitem__(self, at: int | slice) -> InputFrame | InputFrames:
        if isinstance(at, slice):
            return InputFrames(self.rows[at])
        x, z, facing_x, facing_z, gait, *settings = self.rows[at].tolist()
        facing = None if math.isnan(facing_x) else (facing_x, facing_z)
        return InputFrame(Controls((x, z), facing, Gait(int(gait))), *settings)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, InputFrames) and np.array_equal(self.rows, other.rows, equal_nan=True)

    __hash__ = None  # type: ignore[assignment]

    def __add__(self, later: InputFrames) -> InputFrames:
        return InputFrames(np.concatenate([self.rows, later.rows]))

    def gaits(self) -> NDArray[np.int8]:
        """Return the requested gait of each frame `(T,)`, numbered as by `metadata.gait_of`."""
        requested = self.rows[:, 4].astype(np.int8)
        moves = (self.rows[:, :2] != 0.0).any(axis=1)
        return np.where(moves | (requested == Gait.JUMP), requested, np.int8(Gait.STAND))


def are_asked(rows: NDArray[np.float64]) -> bool:
    """Return whether rows `(T, COLUMNS)` from a file are valid input frames."""
    move, facing, gait, settings = rows[:, :2], rows[:, 2:4], rows[:, 4], rows[:, 5:]
    turned = (np.abs(facing) <= MAX_STICK).all(axis=1) | np.isnan(facing).all(axis=1)
    return bool(
        (np.abs(move) <= MAX_STICK).all()  # also rejects NaN
        and turned.all()
        and np.isin(gait, [float(each) for each in Gait]).all()
        and (np.abs(settings) <= MAX_SETTING).all()
    )


class Steppable(Protocol):
    """Interface of a controller that can be resimulated: `runtime.motion.controller.Controller` or a test stand-in."""

    temperature: float
    strength: float
    response: float

    def step(self, controls: Controls) -> Pose:
        """Simulate 1/60 s and return the pose."""

    def set_style(self, z: Any, transition_seconds: float) -> None:
        """Blend to a style code `(6, 64)` or a mix of codes."""

    def set_terrain(self, terrain: Terrain) -> None:
        """Change the terrain."""

    def reset(self, x: float, z: float, yaw: float) -> Any:
        """Place the character standing at x, z (metres), facing `yaw` (radians)."""


@dataclass(frozen=True, eq=False)
class StyleChange:
    """A style change: from `frame` on the character blends to `z` `(6, 64)`, or to a mix, within `seconds`.

    `event` holds the prompt; `note` is free for the recording program.
    """

    frame: int
    z: Array | StyleMix
    seconds: float
    event: PromptEvent
    note: Any = None

    def apply(self, controller: Steppable) -> None:
        controller.set_style(self.z, self.seconds)


@dataclass(frozen=True, eq=False)
class GroundChange:
    """A change of the terrain, from `frame` on."""

    frame: int
    name: str  # or the path of its file
    terrain: Terrain

    def apply(self, controller: Steppable) -> None:
        controller.set_terrain(self.terrain)


@dataclass(frozen=True, eq=False)
class Restart:
    """A reset of the character to a place (metres, radians) before `frame`; the hidden step there is in no take."""

    frame: int
    x: float
    z: float
    yaw: float

    def apply(self, controller: Steppable) -> None:
        controller.reset(self.x, self.z, self.yaw)
        controller.step(Controls())


Change = StyleChange | GroundChange | Restart


@dataclass(frozen=True, eq=False)
class Keyframe:
    """The controller's state before the step of `frame`, after that frame's changes."""

    frame: int
    snapshot: Snapshot


@dataclass(frozen=True, eq=False)
class InputRecording:
    """The input of a clip, with frames counted from the clip's first one; lead-in frames are negative.

    `frames` start with the first keyframe, at or before the clip's start, and end with the clip.
    """

    frames: InputFrames
    changes: tuple[Change, ...]  # in chronological order
    keyframes: tuple[Keyframe, ...]

    @property
    def start(self) -> int:
        """Number of the first frame, 0 or less."""
        return self.keyframes[0].frame

    def __len__(self) -> int:
        return len(self.frames) + self.start

    def frame(self, number: int) -> InputFrame:
        return self.frames[number - self.start]

    def ground(self, number: int) -> GroundChange | None:
        """Return the terrain in force at a frame, or None for the controller's own."""
        found = [c for c in self.changes if isinstance(c, GroundChange) and c.frame <= number]
        return found[-1] if found else None

    def gaits(self) -> NDArray[np.int8]:
        """Return the requested gait of each clip frame `(T,)`, numbered as by `gait_of`."""
        return self.frames[-self.start :].gaits()

    def prompts(self) -> tuple[PromptEvent, ...]:
        """Return the clip's prompts with their times; changes by a moving slider count as one, the last, at the time of the first."""
        kept: list[tuple[int, PromptEvent]] = []
        for change in self.changes:
            if not isinstance(change, StyleChange):
                continue
            at = change.frame
            if kept and follows_live(kept[-1], change.frame, change.seconds):
                at = kept.pop()[0]
            kept.append((at, replace(change.event, seconds=at / FPS, transition_seconds=change.seconds)))
        return shift_prompts(tuple(event for _, event in kept), 0.0, len(self) / FPS)


def resimulate(
    inputs: InputRecording,
    controller: Steppable,
    first_frame: int,
    last_frame: int | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[list[Pose], tuple[Keyframe, ...]]:
    """Simulate frames `first_frame` to `last_frame` (default: the end) again; return the poses, and all keyframes with new ones.

    `inputs` must be unchanged before `first_frame`. `controller`, which needs the model of the take, is left after the last
    frame. `progress` receives the fraction done. About 2 ms a frame, plus up to `KEYFRAME_STEPS` frames before the first.
    """
    end = len(inputs) if last_frame is None else last_frame + 1
    key = keyframe_for(inputs, first_frame).frame

    def recorded(number: int, _: Pose | None) -> Controls | None:
        progress((number - key) / max(end - key, 1))
        return inputs.frame(number).controls if number < end else None

    return started(inputs, controller, first_frame, recorded)


def started(
    inputs: InputRecording,
    controller: Steppable,
    first_frame: int,
    stick: Callable[[int, Pose | None], Controls | None],
) -> tuple[list[Pose], tuple[Keyframe, ...]]:
    """Simulate from `first_frame` on with a new `stick` until it returns None; return the poses and the keyframes.

    `stick` gets the number of each frame and the previous pose (None before `first_frame`). Before, the recorded stick
    is used; other changes are those of the inputs, whose last settings stay in force.
    """
    key = keyframe_for(inputs, first_frame)
    ground = inputs.ground(key.frame)
    if ground is not None:
        controller.set_terrain(ground.terrain)
    key.snapshot.restore(controller)  # type: ignore[arg-type]
    keyframes = [k for k in inputs.keyframes if k.frame < first_frame]
    later = _changes_after(inputs, key.frame, first_frame)
    for number in range(key.frame, first_frame):
        for change in later.get(number, ()):
            change.apply(controller)
        _step(controller, inputs.frame(number))
    poses: list[Pose] = []
    for number in count(first_frame):
        controls = stick(number, poses[-1] if poses else None)
        if controls is None:
            break
        for change in later.get(number, ()):
            change.apply(controller)
        _keep_state(keyframes, number, controller)
        frame = inputs.frame(min(number, len(inputs) - 1))
        poses.append(_step(controller, replace(frame, controls=controls)))
    return poses, tuple(keyframes)


def _keep_state(keyframes: MutableSequence[Keyframe], number: int, controller: Steppable) -> None:
    """Add a keyframe if one is due."""
    if not keyframes or number - keyframes[-1].frame >= KEYFRAME_STEPS:
        keyframes.append(Keyframe(number, take_snapshot(controller)))  # type: ignore[arg-type]


def _changes_after(inputs: InputRecording, key: int, first_frame: int) -> dict[int, list[Change]]:
    """Return the changes by frame that a keyframe's state lacks: of its own frame only those that were edited."""
    later: dict[int, list[Change]] = {}
    for change in inputs.changes:
        again = key == first_frame == change.frame and isinstance(change, StyleChange)
        if change.frame > key or again:
            later.setdefault(change.frame, []).append(change)
    return later


def keyframe_for(inputs: InputRecording, frame: int) -> Keyframe:
    """Return the last keyframe before a frame, or the first of all."""
    before = [k for k in inputs.keyframes if k.frame < frame]
    return before[-1] if before else inputs.keyframes[0]


def _step(controller: Steppable, frame: InputFrame) -> Pose:
    controller.temperature, controller.response = frame.temperature, frame.response
    if controller.strength != frame.strength:  # setting it folds the style again
        controller.strength = frame.strength
    return controller.step(frame.controls)


def resimulated_take(
    clip: Clip,
    inputs: InputRecording,
    controller: Steppable,
    first_frame: int,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Clip, InputRecording]:
    """Return a take for edited inputs: frames before `first_frame` from `clip`, the rest resimulated."""
    poses, keyframes = resimulate(inputs, controller, first_frame, progress=progress)
    made = replace(inputs, keyframes=keyframes)
    return with_poses(clip, made, poses, first_frame), made


def with_poses(clip: Clip, inputs: InputRecording, poses: Sequence[Pose], first_frame: int) -> Clip:
    """Return the clip with new poses from `first_frame` on, and the prompts and gaits of the inputs. Raises FileError."""
    if poses:
        made = stacked(poses)
        if not are_poses(*made):  # a damaged state of a controller may lead anywhere
            problem = "The take cannot be resimulated: its input leads to invalid poses."
            raise FileError(problem, "Edit it elsewhere, or record it again.")
        parts = zip(clip.arrays, made, strict=True)
        clip = clip.posed(*(np.concatenate([kept[:first_frame], new]) for kept, new in parts))
    gaits = inputs.gaits()
    return replace(clip, prompts=inputs.prompts(), gaits=gaits, gait_seconds=gait_seconds(gaits, clip.fps))


class InputRecorder:
    """Records the input of every frame, in parallel to a `ClipRecorder` with the same frame numbers.

    Per frame call `before_steps`, step, then `add` for each step; call the mark methods as things happen.
    """

    def __init__(self) -> None:
        self._first = 0  # number of the oldest frame kept
        self._numbers = array("d")  # `COLUMNS` numbers per frame kept
        self._changes: list[Change] = []
        self._keyframes: deque[Keyframe] = deque()

    @property
    def next_frame(self) -> int:
        """Number of the next frame, counted since the program's start."""
        return self._first + len(self._numbers) // COLUMNS

    def before_steps(self, controller: Steppable) -> None:
        """Store the state of `controller` if a keyframe is due."""
        _keep_state(self._keyframes, self.next_frame, controller)

    def add(self, controls: Controls, controller: Steppable) -> None:
        """Store the input of one simulated step."""
        frame = InputFrame(controls, controller.temperature, controller.strength, controller.response)
        self._numbers.extend(frame.row)

    def mark_style(self, style: StyleChange, holds: bool = False) -> None:
        """Record that a style takes effect now, whatever its own frame; `holds` if it is in the controller's state already."""
        if holds:
            self._changes = [c for c in self._changes if not isinstance(c, StyleChange)]
        z = style.z if isinstance(style.z, StyleMix) else np.array(style.z, np.float32)
        self._changes.append(replace(style, frame=self.next_frame - holds, z=z))

    def mark_ground(self, name: str, terrain: Terrain) -> None:
        self._changes.append(GroundChange(self.next_frame, name, terrain))

    def mark_restart(self, x: float, z: float, yaw: float) -> None:
        """Record that the character was placed; see `Restart`."""
        self._changes.append(Restart(self.next_frame, x, z, yaw))

    def forget(self) -> None:
        """Discard all inputs after something that cannot be resimulated; takes that began before it lose their input."""
        self._first = self.next_frame
        self._numbers = array("d")
        self._keyframes.clear()
        self._changes = self._still_holding(self._first)

    def drop_before(self, frame: int) -> None:
        """Discard the inputs of frames before this number."""
        popped = False
        while len(self._keyframes) > 1 and self._keyframes[1].frame <= frame:
            self._keyframes.popleft()
            popped = True
        if popped:
            first = self._keyframes[0].frame
            del self._numbers[: (first - self._first) * COLUMNS]
            self._first = first
            self._changes = self._still_holding(first) + [c for c in self._changes if c.frame > first]

    def _still_holding(self, frame: int) -> list[Change]:
        """Return the last style and ground up to a frame."""
        last = {type(c): c for c in self._changes if c.frame <= frame and not isinstance(c, Restart)}
        return list(last.values())

    @property
    def known(self) -> tuple[Keyframe | None, Change | None]:
        """Return the last keyframe and change; they differ from before if anything but the stick changed."""
        key = self._keyframes[-1] if self._keyframes else None
        return key, self._changes[-1] if self._changes else None

    def sticks(self, first_frame: int) -> NDArray[np.float64] | None:
        """Return stick positions and settings `(T, 8)` from `first_frame` to the newest; None if unknown."""
        return None if first_frame < self._first else self._since(first_frame).rows

    def _since(self, number: int) -> InputFrames:
        """Return the kept frames from a number on."""
        numbers = np.array(self._numbers[(number - self._first) * COLUMNS :])
        return InputFrames(numbers.reshape(-1, COLUMNS))

    def cut(self, first_frame: int) -> InputRecording | None:
        """Return the inputs of a clip from `first_frame` to the newest; None if the state there is unknown."""
        keys = [k for k in self._keyframes if k.frame <= first_frame]
        if not keys or first_frame >= self.next_frame:
            return None
        later = (key for key in self._keyframes if key.frame > first_frame)
        keyframes = (replace(key, frame=key.frame - first_frame) for key in (keys[-1], *later))
        changes = (replace(change, frame=change.frame - first_frame) for change in self._changes)
        return InputRecording(self._since(keys[-1].frame), tuple(changes), tuple(keyframes))
