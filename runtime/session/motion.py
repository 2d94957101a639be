"""The frames of a take as they were recorded, resimulated or read, with the input that made them.

A motion is immutable. It is loaded from its session's file when needed, so that a long list of takes uses little
memory. Of the clips that are not in use, the most recently used stay in memory.
"""

from __future__ import annotations

import threading
import uuid
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.errors import FileError
from runtime.session.frames import CLIP_FRAME_BYTES
from runtime.takes.clip import Clip
from runtime.takes.input_recording import InputRecording
from runtime.takes.metadata import UNKNOWN, UNMOVED, LoopReport, Origin, PromptEvent, describe

MAX_KEPT_FRAMES = (128 << 20) // CLIP_FRAME_BYTES  # half an hour, or one clip of any length


@dataclass(frozen=True)
class MotionHeader:
    """Description of a motion without its frames; the fields are those of `Clip`."""

    name: str
    fps: float
    frames: int
    terrain: str = "flat"
    prompts: tuple[PromptEvent, ...] = ()
    origin: Origin = UNKNOWN
    gait_seconds: tuple[tuple[str, float], ...] = ()
    placed: tuple[float, ...] | None = UNMOVED
    size: float = 1.0
    loop: LoopReport | None = None
    has_gaits: bool = False
    resimulable: bool = False  # its input is known: it can be resimulated

    @staticmethod
    def of(clip: Clip, inputs: InputRecording | None) -> MotionHeader:
        return MotionHeader(
            clip.name, clip.fps, len(clip), clip.terrain, clip.prompts, clip.origin, clip.gait_seconds,
            clip.placed, clip.size, clip.loop, clip.gaits is not None, inputs is not None,
        )  # fmt: skip

    @property
    def seconds(self) -> float:
        return (self.frames - 1) / self.fps

    def describe(self) -> str:
        """Return some lines for the user about how the motion was made."""
        return describe(self.terrain, self.prompts, self.origin, dict(self.gait_seconds))

    def clip(self, hips: Array, rotations: Array, contacts: Array, gaits: NDArray[np.int8]) -> Clip:
        return Clip(
            self.name, self.fps, hips, rotations, contacts, self.prompts, self.terrain, self.origin,
            self.gait_seconds, gaits if self.has_gaits else None, self.placed, self.size, self.loop,
        )  # fmt: skip


class MotionSource(Protocol):
    """A source from which motions are loaded: a session's file."""

    def load_clip(self, key: str, header: MotionHeader) -> Clip:
        """Load the frames of a motion; FileError if that fails."""

    def load_inputs(self, key: str) -> InputRecording | None:
        """Load the input of a motion."""


class Motion:
    """Frames and input of a motion under a unique key; motions are equal if their keys are."""

    def __init__(
        self,
        key: str,
        header: MotionHeader,
        clip: Clip | None = None,
        inputs: InputRecording | None = None,
        source: MotionSource | None = None,
    ) -> None:
        self.key, self.header = key, header
        self._clip, self._inputs, self._source = clip, inputs, source
        self._known_clip: weakref.ref[Clip] | None = None
        self._known_inputs: weakref.ref[InputRecording] | None = None
        self._lock = threading.Lock()

    @staticmethod
    def of(clip: Clip, inputs: InputRecording | None = None) -> Motion:
        return Motion(uuid.uuid4().hex, MotionHeader.of(clip, inputs), clip, inputs)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Motion) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    def __repr__(self) -> str:
        return f"Motion({self.header.name!r}, {self.header.frames} frames)"

    @property
    def clip(self) -> Clip:
        """The frames, loaded when needed; thread-safe, FileError if they cannot be read."""
        with self._lock:
            known = self._clip or (None if self._known_clip is None else self._known_clip())
            if known is None:
                known = self._loaded_from().load_clip(self.key, self.header)
                self._known_clip = weakref.ref(known)
            return known

    @property
    def inputs(self) -> InputRecording | None:
        """The input that drove the motion, or None if unknown. Unreadable input raises FileError once, then is None."""
        with self._lock:
            if not self.header.resimulable:
                return None
            known = self._inputs or (None if self._known_inputs is None else self._known_inputs())
            if known is None:
                try:
                    known = self._loaded_from().load_inputs(self.key)
                except FileError:
                    self.header = replace(self.header, resimulable=False)
                    raise
                self._known_inputs = None if known is None else weakref.ref(known)
            return known

    def stored(self, source: MotionSource) -> None:
        """Load the motion from a file from now on, so that it can be released from memory."""
        with self._lock:
            self._source = source
            self._known_clip = self._known_clip if self._clip is None else weakref.ref(self._clip)
            self._known_inputs = self._known_inputs if self._inputs is None else weakref.ref(self._inputs)
            self._clip = self._inputs = None

    @property
    def is_stored(self) -> bool:
        return self._source is not None

    def _loaded_from(self) -> MotionSource:
        if self._source is None:
            raise FileError(f"{self.header.name}: its frames are gone.", "Record it again.")
        return self._source


@dataclass
class ClipCache:
    """A thread-safe cache of clips."""

    _clips: OrderedDict[Hashable, Clip] = field(default_factory=OrderedDict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def get(self, key: Hashable, make: Callable[[], Clip]) -> Clip:
        """Return the clip of a key, calling `make` if it is not cached."""
        with self._lock:
            if key in self._clips:
                self._clips.move_to_end(key)
                return self._clips[key]
        made = make()
        with self._lock:
            self._clips[key] = made
            while len(self._clips) > 1 and sum(map(len, self._clips.values())) > MAX_KEPT_FRAMES:
                self._clips.popitem(last=False)
        return made
