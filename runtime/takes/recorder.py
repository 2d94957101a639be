"""The recorder, which always keeps the last minutes, so that a take can begin in the past."""

from collections import deque
from dataclasses import replace
from itertools import islice

import numpy as np

from runtime.arrays import Array
from runtime.errors import UsageError
from runtime.pose import FPS, Pose
from runtime.skeleton import J
from runtime.takes.clip import Clip, shift_prompts
from runtime.takes.metadata import UNKNOWN, Origin, PromptEvent, gait_seconds

LIVE_SECONDS = 0.1  # transition while a slider is dragged: reset in every frame, it eases towards the target


class ClipRecorder:
    """Records continuously: keeps the last `max_seconds`, so that a take can begin in the past, and all of a running take.

    A take longer than `MAX_TAKE_SECONDS` keeps its last part. Frames are copied, so poses may be reused.
    """

    MAX_TAKE_SECONDS = 3600.0

    def __init__(self, max_seconds: float = 300.0, fps: float = 60.0) -> None:
        self.fps = fps
        self._keep = max(1, round(max_seconds * fps))
        self._limit = max(self._keep, round(self.MAX_TAKE_SECONDS * fps))
        self._frames: deque[Array] = deque()
        self.first_frame = 0  # number of the oldest frame kept; frames count from 0 since the program's start
        self.take_first: int | None = None  # number of the take's first frame
        self._prompts: deque[tuple[int, PromptEvent]] = deque()

    @property
    def recording(self) -> bool:
        """Whether a take is running."""
        return self.take_first is not None

    @property
    def next_frame(self) -> int:
        """Number of the next frame, counted since the program's start."""
        return self.first_frame + len(self._frames)

    @property
    def take_seconds(self) -> float:
        """Length of the running take in seconds, 0 without one."""
        return 0.0 if self.take_first is None else (self.next_frame - self.take_first) / self.fps

    @property
    def seconds(self) -> float:
        """How many seconds `last` can go back."""
        return len(self._frames) / self.fps

    def add(self, pose: Pose, gait: int = -1) -> None:
        """Store the pose of one simulated frame and its requested gait (-1: unknown)."""
        row = np.concatenate([pose.hips_position, np.ravel(pose.local_rotations), pose.contacts, [gait]])
        self.add_row(row.astype(np.float32))

    def add_row(self, row: Array) -> None:
        """Store one frame `(132,)` float32: hips, local rotations, contacts, gait. The array must not be changed later."""
        self._frames.append(row)
        keep = self._keep
        if self.take_first is not None:
            keep = min(max(keep, self.next_frame - self.take_first), self._limit)
        while len(self._frames) > keep:
            self._frames.popleft()
            self.first_frame += 1
        while len(self._prompts) > 1 and self._prompts[1][0] <= self.first_frame:
            self._prompts.popleft()  # no kept frame was made by it

    def mark_prompt(
        self, prompt: str, transition_seconds: float = 0.0, words: str = "", typed: str = ""
    ) -> None:
        """Record that `prompt` applies from the next frame on; see `PromptEvent`.

        Live changes within `LIVE_SECONDS` are merged into one, the last, at the time of the first.
        """
        event, frame = PromptEvent(0.0, prompt, transition_seconds, words, typed), self.next_frame
        if self._prompts and follows_live(self._prompts[-1], frame, transition_seconds, self.fps):
            frame, _ = self._prompts.pop()
        self._prompts.append((frame, event))

    def rows(self, first: int) -> Array:
        """Return frames `(T, 132)` from number `first` to the newest."""
        rows = list(islice(self._frames, first - self.first_frame, None))
        return np.stack(rows) if rows else np.zeros((0, 132), np.float32)

    def events(self, first: int) -> tuple[PromptEvent, ...]:
        """Return the prompt events from frame number `first` on, with times relative to it."""
        events = tuple(replace(event, seconds=(at - first) / self.fps) for at, event in self._prompts)
        return shift_prompts(events, 0.0, (self.next_frame - first) / self.fps)

    def start(self) -> None:
        """Begin a take with the next frame; no effect if one is running."""
        if self.take_first is None:
            self.take_first = self.next_frame

    def stop(self, name: str = "take", terrain: str = "flat", origin: Origin | None = None) -> Clip:
        """End the take and return it; UsageError if none is running or it has no frame yet."""
        if self.take_first is None:
            raise UsageError("no take is running.", "Start recording first.")
        begin, self.take_first = self.take_first, None
        return self._clip(begin, name, terrain, origin)

    def last(
        self, seconds: float, name: str = "take", terrain: str = "flat", origin: Origin | None = None
    ) -> Clip:
        """Return the last `seconds`, as far as they are kept, as a clip; a running take continues."""
        count = max(1, round(seconds * self.fps))
        return self._clip(self.next_frame - count, name, terrain, origin)

    def _clip(self, begin: int, name: str, terrain: str, origin: Origin | None) -> Clip:
        begin = max(begin, self.first_frame)
        table = self.rows(begin)
        if not len(table):
            raise UsageError("nothing is recorded yet.", "Let the character move first.")
        gaits = table[:, -1].astype(np.int8)
        return Clip(
            name=name,
            fps=self.fps,
            hips_positions=table[:, :3],
            local_rotations=table[:, 3:-5].reshape(-1, J, 4),
            contacts=table[:, -5:-1],
            prompts=self.events(begin),
            terrain=terrain,
            origin=origin or UNKNOWN,
            gait_seconds=gait_seconds(gaits, self.fps),
            gaits=gaits,
        )


def follows_live(before: tuple[int, PromptEvent], frame: int, seconds: float, fps: float = FPS) -> bool:
    """Return whether a style change at `frame` continues the slider movement that began with `before`.

    A transition of 0 seconds, that of the first style, never continues one.
    """
    begun, event = before
    live = all(0.0 < each <= LIVE_SECONDS for each in (event.transition_seconds, seconds))
    return live and frame - begun < round(LIVE_SECONDS * fps)
