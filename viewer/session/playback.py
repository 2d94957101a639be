"""Playback of a take: time, loop, and the pose to show."""

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from runtime.pose import Pose
from runtime.session.session import Take
from runtime.takes.clip import Clip
from runtime.takes.input_recording import InputRecording
from runtime.terrain.height_map import Terrain

MAX_RATE = 8


@dataclass
class Playback:
    """A take being played: `time_s`, and the frames `first` to `last` of its trim."""

    take: Take  # as in the session
    clip: Clip  # its frames, which may lag behind a pin being dragged
    terrain: Terrain  # its own, or the live one
    live: Terrain  # that of the live character when playback began
    inputs: InputRecording | None = None  # its input; None if unknown, and for a mirror image
    time_s: float = 0.0
    playing: bool = True
    loop: bool = True
    speed: float = 1.0
    rate: int = 1  # times that speed, negative for backwards: set by J and L
    shown: Take = field(init=False)  # the version of the take in `clip`
    first: int = field(init=False)  # of the trim, as `last`
    last: int = field(init=False)

    def __post_init__(self) -> None:
        self.shown = self.take
        self.use(self.take)
        self.time_s = max(self.time_s, self.start_s)

    def use(self, take: Take) -> None:
        """Use an edited take, even before its new frames are computed."""
        self.take, end = take, self.frames - 1
        self.first, self.last = (min(frame, end) for frame in take.range)

    @property
    def number(self) -> int:
        return self.take.number

    @property
    def number_shown(self) -> int:
        """The number of the shown frame, as the timeline counts."""
        return self.frame - self.take.numbered_from

    @property
    def frames(self) -> int:
        return self.clip.hips_positions.shape[0]

    @property
    def frame(self) -> int:
        return min(max(round(self.time_s * self.clip.fps), 0), self.frames - 1)

    @property
    def start_s(self) -> float:
        return self.first / self.clip.fps

    @property
    def end_s(self) -> float:
        return self.last / self.clip.fps

    def advance(self, seconds: float) -> None:
        """Advance the playhead; at an end, loop or stop."""
        if not self.playing:
            return
        outside = self.time_s < self.start_s  # a frame outside the trim was sought
        self.time_s += seconds * self.speed * self.rate
        length, over = self.end_s - self.start_s, self.time_s - self.start_s
        if 0.0 <= over <= length:
            return
        if over < 0.0 and (self.rate > 0 or outside):
            self.time_s = self.start_s
        elif self.loop and length > 0.0:
            self.time_s = self.start_s + over % length
        else:
            self.time_s, self.playing = (self.end_s if over > 0.0 else self.start_s), False

    def shuttle(self, direction: int) -> None:
        """Play forwards (1) or backwards (-1), faster with each call; 0 stops."""
        again = self.playing and self.rate * direction > 0
        self.rate = min(abs(self.rate) * 2, MAX_RATE) * direction if again else direction or 1
        self.playing = direction != 0

    def toggle(self) -> None:
        """Play or pause; at the end, playing starts over."""
        self.rate = 1
        if not self.playing and self.time_s >= self.end_s - 1e-6:
            self.time_s = self.start_s
        self.playing = not self.playing

    def seek(self, frame: int) -> None:
        self.playing = False
        self.time_s = min(max(frame, 0), self.frames - 1) / self.clip.fps

    def step(self, frames: int) -> None:
        """Move by frames and pause; a looping take wraps around."""
        wanted = self.frame + frames
        if self.loop and not 0 <= wanted < self.frames:
            wanted %= self.frames
        self.seek(wanted)

    def show(self, take: Take, clip: Clip, inputs: InputRecording | None) -> None:
        """Show the recomputed frames of an edited take, at the same time."""
        self.shown, self.clip, self.inputs = take, clip, inputs
        self.use(take)
        self.time_s = min(self.time_s, (self.frames - 1) / clip.fps)

    def pose(self) -> Pose:
        """Return the pose at the current time, standing on the terrain shown."""
        return self.pose_at(self.frame) if self._newer else self.standing(self.clip.sample(self.time_s))

    def pose_at(self, frame: int) -> Pose:
        """Return the pose of a frame, standing on the terrain shown."""
        if not self._newer:
            return self.standing(self.clip.pose(frame))
        return self.standing(self.take.frame(frame).pose(0))

    @property
    def _newer(self) -> bool:
        """Whether pins or pose keys have changed since the frames were made; footplants are only applied then."""
        take, shown = self.take, self.shown
        same = take.poses.footplants == shown.poses.footplants and take.motion == shown.motion
        return same and take.poses != shown.poses

    def standing(self, pose: Pose) -> Pose:
        """Return a pose of the take, with its root on the terrain shown."""
        x, _, z = (float(v) for v in pose.hips_position)
        ground = np.array([x, float(self.terrain.height(x, z)), z], np.float32)
        return dataclasses.replace(pose, root_position=ground)
