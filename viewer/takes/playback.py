"""Playing a clip back: time, trim and loop, and the pose to show."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from runtime.pose import Pose
from runtime.terrain.height_map import Terrain

if TYPE_CHECKING:
    from runtime.takes.clip import Clip

MIN_FRAMES = 2


@dataclass(frozen=True)
class Trim:
    """A change of the trim marks, made when the take had so many older versions."""

    before: tuple[int, int]
    after: tuple[int, int]
    versions: int


@dataclass
class Playback:
    """One clip at a time `time_s`, between the trim marks `first` and `last` (frames, both included)."""

    clip: Clip
    terrain: Terrain  # its own, or the live one
    live: Terrain  # the one under the live character when it began to play
    index: int  # in the clip list
    time_s: float = 0.0
    playing: bool = True
    loop: bool = True
    speed: float = 1.0
    first: int = 0
    last: int = -1
    trims: list[Trim] = field(default_factory=list)  # newest last
    undone_trims: list[Trim] = field(default_factory=list)
    _marks: tuple[int, int] = (0, -1)  # after the last of them

    def __post_init__(self) -> None:
        if self.last < 0:
            self.last = self.frames - 1
        self._marks = self.first, self.last

    @property
    def frames(self) -> int:
        """Frames of the whole clip."""
        return len(self.clip)

    @property
    def frame(self) -> int:
        """The frame shown."""
        return min(max(round(self.time_s * self.clip.fps), 0), self.frames - 1)

    @property
    def start_s(self) -> float:
        """Time of the first frame kept."""
        return self.first / self.clip.fps

    @property
    def end_s(self) -> float:
        """Time of the last frame kept."""
        return self.last / self.clip.fps

    @property
    def trimmed(self) -> bool:
        """Whether the marks leave something out."""
        return (self.first, self.last) != (0, self.frames - 1)

    def advance(self, seconds: float) -> None:
        """Let time pass; at the end begin again, or stop."""
        if not self.playing:
            return
        self.time_s += seconds * self.speed
        if self.time_s < self.start_s:
            self.time_s = self.start_s
        if self.time_s <= self.end_s:
            return
        if self.loop and self.end_s > self.start_s:
            self.time_s = self.start_s + math.fmod(self.time_s - self.start_s, self.end_s - self.start_s)
        else:
            self.time_s, self.playing = self.end_s, False

    def toggle(self) -> None:
        """Play or pause; playing at the end begins again."""
        if not self.playing and self.time_s >= self.end_s - 1e-6:
            self.time_s = self.start_s
        self.playing = not self.playing

    def seek(self, frame: int) -> None:
        """Show a frame and pause."""
        self.playing = False
        self.time_s = min(max(frame, 0), self.frames - 1) / self.clip.fps

    def step(self, frames: int) -> None:
        """Go so many frames on, or back, and pause; at an end, on from the other when the clip loops."""
        wanted = self.frame + frames
        if self.loop and not 0 <= wanted < self.frames:
            wanted %= self.frames
        self.seek(wanted)

    def show(self, clip: Clip) -> None:
        """Another version of the clip at the same time; of another length, it keeps what it can of the trim."""
        whole, before = not self.trimmed, self.frames
        self.clip = clip
        if self.frames != before:
            last = self.frames - 1
            self._marks = self.first, self.last = (
                (0, last) if whole else self._fitted((self.first, self.last))
            )
            self.time_s = min(self.time_s, last / clip.fps)

    def _fitted(self, marks: tuple[int, int]) -> tuple[int, int]:
        """Trim marks within the clip."""
        last = min(marks[1], self.frames - 1)
        return max(min(marks[0], last - MIN_FRAMES + 1), 0), last

    def trim_in(self, frame: int | None = None) -> None:
        """Keep the clip from a frame, the one shown by default."""
        wanted = self.frame if frame is None else frame
        self.first = max(min(wanted, self.last - MIN_FRAMES + 1), 0)

    def trim_out(self, frame: int | None = None) -> None:
        """Keep the clip up to a frame, the one shown by default."""
        wanted = self.frame if frame is None else frame
        self.last = min(max(wanted, self.first + MIN_FRAMES - 1), self.frames - 1)

    def keep_trim(self, versions: int) -> bool:
        """Make the marks a step of undo; whether they are others than before."""
        now = self.first, self.last
        if now == self._marks:
            return False
        self.trims.append(Trim(self._marks, now, versions))
        self.undone_trims.clear()
        self._marks = now
        return True

    def undo_trim(self, versions: int) -> bool:
        """Take the last change of the marks back, if the take was not edited since; whether there was one."""
        return self._go_over(self.trims, self.undone_trims, versions, back=True)

    def redo_trim(self, versions: int) -> bool:
        """Change the marks again as before the last undo; whether there was one."""
        return self._go_over(self.undone_trims, self.trims, versions, back=False)

    def _go_over(self, steps: list[Trim], other: list[Trim], versions: int, back: bool) -> bool:
        if not steps or steps[-1].versions != versions:
            return False
        step = steps.pop()
        other.append(step)
        self._marks = self.first, self.last = self._fitted(step.before if back else step.after)
        return True

    def pose(self) -> Pose:
        """The pose at the current time, standing on the terrain shown."""
        return self.standing(self.clip.sample(self.time_s))

    def pose_at(self, frame: int) -> Pose:
        """The pose of a frame, standing on the terrain shown."""
        return self.standing(self.clip.pose(frame))

    def standing(self, pose: Pose) -> Pose:
        """A pose of the clip, with its root on the terrain shown."""
        x, _, z = (float(v) for v in pose.hips_position)
        ground = np.array([x, float(self.terrain.height(x, z)), z], np.float32)
        return dataclasses.replace(pose, root_position=ground)
