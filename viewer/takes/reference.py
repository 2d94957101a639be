"""What is shown beside the take that plays, or over it, in sync: another take as somebody else, or a film."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.pose import Pose
from runtime.takes.clip import Clip
from runtime.takes.own_skeleton import OwnSkeleton
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.render.overlays import Figure
from viewer.stage.simulation import make_pose
from viewer.takes.figures import Bones, bones_of
from viewer.takes.playback import Playback
from viewer.takes.state import ClipItem, TakesState
from viewer.takes.video import Video, read_video

ASIDE_M = 1.0
CHARACTER, VIDEO = Slot("reference character"), Slot("reference video")
LIMITS = {  # of what a project keeps, with its first value
    "offset_s": (-600.0, 600.0, 0.0),
    "aside_m": (-20.0, 20.0, ASIDE_M),
    "size": (0.2, 1.0, 0.4),
    "opacity": (0.1, 1.0, 0.5),
}


class Look(StrEnum):
    """Who moves as the reference does."""

    TAKE = "As the take"  # the character on the stage
    SKELETON = "Its own skeleton"  # that of its file
    CHARACTER = "Its own character"  # from a file


@dataclass
class Reference:
    """What is shown beside the take that plays, from where that begins."""

    state: TakesState
    messages: Messages
    jobs: Jobs
    load_character: Callable[[Path], Any]  # on any thread
    item: ClipItem | None = None
    video: Video | None = None  # in place of an item
    offset_s: float = LIMITS["offset_s"][2]  # the reference is shown so much later
    aside_m: float = LIMITS["aside_m"][2]  # to the right of the take
    size: float = LIMITS["size"][2]  # of a film's picture, as a share of the view
    opacity: float = LIMITS["opacity"][2]  # of a film over the take
    over: bool = False  # translucent, in the same place
    look: Look = Look.TAKE
    character_path: Path | None = None
    character: Any = None
    _placed: tuple[Clip, Clip, Array, float] | None = field(default=None, init=False)
    _bones: tuple[OwnSkeleton, Bones] | None = field(default=None, init=False)

    def show(self, item: ClipItem) -> None:
        """Compare with a take of the list; the same again shows none."""
        again = self.item is item
        self.close()
        if not again:
            self.item = item
            self.look = Look.SKELETON if item.own is not None else Look.TAKE

    def close(self) -> None:
        """Show the take alone."""
        self.item = self.video = None
        self.offset_s, self.look = 0.0, Look.TAKE

    def forget(self, item: ClipItem) -> None:
        """A take left the list."""
        if self.item is item:
            self.close()

    @property
    def shown(self) -> bool:
        """Whether there is one to show."""
        playback = self.state.playback
        other = self.item is not None and playback is not None and self.item.clip is not playback.clip
        return playback is not None and (other or self.video is not None)

    @property
    def name(self) -> str:
        """What it is called."""
        return self.video.path.name if self.video is not None else "" if self.item is None else self.item.name

    @property
    def looks(self) -> tuple[Look, ...]:
        """Who can show it now."""
        own = (Look.SKELETON,) if self.item is not None and self.item.own is not None else ()
        return (Look.TAKE, *own, *((Look.CHARACTER,) if self.character is not None else ()))

    # --- files

    def open_video(self, path: Path, keep_numbers: bool = False) -> None:
        """Show a film beside the take that plays, or that plays next; at once in sync with it unless `keep_numbers`."""
        take = partial(self._take_video, self.offset_s if keep_numbers else 0.0)
        self.jobs.submit(VIDEO, partial(read_video, path), take, reading=path.name)

    def _take_video(self, offset_s: float, video: Video) -> None:
        self.close()
        self.video, self.offset_s = video, offset_s
        later = "" if self.state.playback is not None else " It is shown beside the take that you play."
        self.messages.note(f"{video.describe()}.{later}")

    def open_character(self, path: Path) -> None:
        """Let the character of a file show the reference."""
        self.jobs.submit(
            CHARACTER,
            partial(self.load_character, path),
            partial(self.use_character, path),
            reading=path.name,
        )

    def use_character(self, path: Path, character: Any) -> None:
        """A character was loaded."""
        self.character_path, self.character, self.look = path, character, Look.CHARACTER

    # --- what is shown

    def time_s(self, playback: Playback) -> float:
        """The reference's own time at the one that is shown of the take."""
        return playback.time_s - playback.start_s + self.offset_s

    def pose(self, playback: Playback) -> Pose | None:
        """The reference in our skeleton at the time that is shown of the take; None where there is none."""
        if not self.shown or self.item is None:
            return None
        clip = self.item.clip
        move, turn = self._place(playback.clip, clip)
        pose = clip.sample(self.time_s(playback))
        hips = rotations.rotate(rotations.from_yaw(turn), pose.hips_position) + move
        local = np.array(pose.local_rotations)
        local[0] = rotations.multiply(rotations.from_yaw(turn), local[0])
        ground = float(playback.terrain.height(float(hips[0]), float(hips[2])))
        hips[1] += ground - float(playback.terrain.height(*self._start(playback.clip)))
        return make_pose(hips, local, pose.contacts, ground, pose.root_yaw + turn)

    def figure(self, playback: Playback, pose: Pose) -> Figure | None:
        """The reference at `pose` as somebody of another mesh; None where the character on the stage shows it."""
        if self.look is Look.CHARACTER and self.character is not None:
            return Figure(self.character, self.character.skin_matrices(pose), pose, ghost=self.over)
        own = None if self.item is None or self.look is not Look.SKELETON else self.item.own
        if own is None or self.item is None:
            return None
        if self._bones is None or self._bones[0] is not own:
            self._bones = own, bones_of(own)
        bones, clip = self._bones[1], self.item.clip
        _, turn = self._place(playback.clip, clip)
        time_s = min(max(self.time_s(playback), 0.0), clip.seconds)
        there = clip.sample(time_s).hips_position  # the points keep their place about our hips
        points = rotations.rotate(rotations.from_yaw(turn), own.sample(time_s * clip.fps) - there)
        return Figure(bones, bones.matrices(points + pose.hips_position), pose, on_top=self.over)

    def _place(self, take: Clip, clip: Clip) -> tuple[Array, float]:
        """The shift `(3,)` and the turn that let the reference begin where the take does, beside it."""
        if self._placed is None or self._placed[0] is not take or self._placed[1] is not clip:
            ours, theirs = take.pose(0), clip.pose(0)
            turn = math.remainder(ours.root_yaw - theirs.root_yaw, math.tau)
            moved = rotations.rotate(rotations.from_yaw(turn), np.asarray(theirs.hips_position, float))
            shift = np.asarray(ours.hips_position, float) - moved
            shift[1] = float(ours.hips_position[1] - theirs.hips_position[1]) if abs(shift[1]) > 0.3 else 0.0
            self._placed = take, clip, shift, turn
        *_, shift, turn = self._placed
        yaw = take.pose(0).root_yaw
        right = np.array([-math.cos(yaw), 0.0, math.sin(yaw)])
        return shift + (0.0 if self.over else self.aside_m) * right, turn

    @staticmethod
    def _start(take: Clip) -> tuple[float, float]:
        return float(take.hips_positions[0, 0]), float(take.hips_positions[0, 2])
