"""The reference compared with the playing take, in sync: another take shown by any character, or a film."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from runtime import rotations
from runtime.arrays import AnyArray, Array
from runtime.pose import Pose
from runtime.safe_read import printable
from runtime.session.session import LIVE, CharacterChoice, Reference, Session, Take
from runtime.takes.clip import Clip
from runtime.takes.own_skeleton import OwnSkeleton
from viewer.edit.video import Video, read_video
from viewer.editor import Editor
from viewer.jobs import Slot
from viewer.render.overlays import Figure
from viewer.scene.simulation import make_pose
from viewer.session.playback import Playback
from viewer.session.takes import Takes
from viewer.settings import remembered

CHARACTER, VIDEO = Slot("reference character"), Slot("reference video")
FRAMES = Slot("frames of the reference")
MAX_BONES = 250
MAX_BONE_M = 1.2  # longer bones are gaps, such as from a scene's origin to the hips
WAIST_BONE_FRACTION, THICKNESS_BONE_FRACTION = 0.18, 0.11  # of a spindle's length
THINNEST_M, THICKEST_M = 0.006, 0.04
COLOR = (0.55, 0.33, 0.06)  # linear; amber, unlike any character or ground
LIMITS = {  # of the draggable fields
    "offset_s": (-600.0, 600.0),
    "aside_m": (-20.0, 20.0),
    "size": (0.2, 1.0),
    "opacity": (0.1, 1.0),
}


class Look(StrEnum):
    """The body that shows the reference."""

    TAKE = "As the take"  # the character in the scene
    SKELETON = "Its own skeleton"  # as in its file
    CHARACTER = "Its own character"  # from a file


def _lies_in(folder: Path, path: Path) -> bool:
    """Return whether a path leads into a folder, without following links outside."""
    if ".." in path.parts or not path.is_relative_to(folder):
        return False
    return not any(
        part.is_symlink() for part in (path, *path.parents) if part.is_relative_to(folder) and part != folder
    )


@dataclass
class References:
    """The reference that plays in sync with the take: another take or a film, loaded as the session asks."""

    editor: Editor
    takes: Takes
    video: Video | None = None  # loaded
    character: Any = None
    _video_path: str = ""  # loaded or being loaded
    _character_of: CharacterChoice | None = None
    _placed: tuple[Clip, Clip, float, Array, float] | None = None
    _bones: tuple[OwnSkeleton, Bones] | None = None
    _clip: tuple[Take, Clip | None] | None = None

    def __post_init__(self) -> None:
        self.editor.followers.append(self.follow)

    @property
    def reference(self) -> Reference:
        return self.editor.session.reference or Reference()

    @property
    def take(self) -> Take | None:
        """The reference take, or None for a film or no reference."""
        reference = self.editor.session.reference
        if reference is None or reference.video or reference.take == LIVE:
            return None
        return self.editor.session.take(reference.take)

    @property
    def look(self) -> Look:
        """The body that shows the reference, as far as it is available."""
        chosen = self.reference.look
        default = Look.SKELETON if self.take is not None and self.take.own is not None else Look.TAKE
        return Look(chosen) if chosen in self.looks else default

    @property
    def shown(self) -> bool:
        playback = self.takes.playback
        if playback is None or self.editor.session.reference is None:
            return False
        return self.video is not None if self.reference.video else self.take not in (None, playback.take)

    @property
    def name(self) -> str:
        if self.reference.video:
            return Path(self.reference.video).name
        return "" if self.take is None else self.take.title

    @property
    def looks(self) -> tuple[Look, ...]:
        own = (Look.SKELETON,) if self.take is not None and self.take.own is not None else ()
        return (Look.TAKE, *own, *((Look.CHARACTER,) if self.character is not None else ()))

    # --- edits

    def show(self, number: int) -> None:
        """Use a take of the list as reference; choosing it again removes it."""
        if self.take is not None and self.take.number == number:
            self.close()
            return
        take = self.editor.session.take(number)
        if take is not None:
            made = Reference(take=number, aside_m=self.reference.aside_m, over=self.reference.over)
            self.editor.do(f"reference {take.title}", lambda session: replace(session, reference=made))

    def close(self) -> None:
        if self.editor.session.reference is not None:
            self.editor.do("end of the comparison", lambda session: replace(session, reference=None))

    def set(self, held: bool = False, **values: Any) -> None:
        """Set fields of the reference; `held` during a drag."""
        made = replace(self.reference, **values)
        change = self.editor.drag if held else self.editor.do
        change("place of the reference", lambda session: replace(session, reference=made))

    def open_video(self, path: Path) -> None:
        """Use a film as reference for the playing take, or the next one played."""
        made, settings = Reference(video=str(path.absolute())), self.takes.settings
        settings.known_films = remembered(made.video, settings.known_films)

        def take(video: Video) -> None:
            self._take_video(video)
            self.editor.do(f"reference {path.name}", lambda session: replace(session, reference=made))
            later = "" if self.takes.playback is not None else " It is shown with the take that you play."
            self.editor.messages.note(f"{video.describe()}.{later}")

        self.takes.jobs.submit(VIDEO, partial(read_video, path), take, reading=path.name)

    def open_character(self, path: Path) -> None:
        """Show the reference with the character of a file."""
        scene = self.takes.scene

        def take(loaded: tuple[CharacterChoice, Path | None, Any]) -> None:
            choice, _, character = loaded
            self._character_of, self.character = choice, character
            self.set(look=str(Look.CHARACTER), character=choice)

        self.takes.jobs.submit(CHARACTER, partial(scene.read_character, path), take, reading=path.name)

    def follow(self, before: Session, now: Session) -> None:
        """Load what the session's reference needs."""
        reference, jobs = self.reference, self.takes.jobs
        if reference.video != self._video_path:
            self.video, self._video_path = None, reference.video
            if reference.video:
                self._load_video(Path(reference.video))
        choice = reference.character
        if choice != self._character_of:
            self._character_of, self.character = choice, None
            if choice is not None:
                load = partial(self.takes.scene.read_choice, choice)
                jobs.submit(CHARACTER, load, lambda loaded: setattr(self, "character", loaded[2]))

    def _load_video(self, path: Path) -> None:
        """Load the session's film, if it was chosen here or lies next to the session's file."""
        home = self.editor.file.path.parent
        if str(path) in self.takes.settings.known_films or _lies_in(home, path):
            self.takes.jobs.submit(VIDEO, partial(read_video, path), self._take_video, reading=path.name)
        else:
            self.editor.messages.warn(
                f"The session's film {printable(path.name)} lies elsewhere and is not opened by itself: choose it again."
            )

    def _take_video(self, video: Video) -> None:
        self.video, self._video_path = video, str(video.path.absolute())

    # --- shown reference

    def time_s(self, playback: Playback) -> float:
        """Return the reference's own time (seconds) for the shown time of the take."""
        return playback.time_s - playback.start_s + self.reference.offset_s

    def _clip_of(self, take: Take) -> Clip | None:
        """Return the frames of a take; None until they are loaded."""
        if self._clip is None or self._clip[0] != take:
            self._clip = take, None

            def loaded(clip: Clip) -> None:
                if self._clip == (take, None):
                    self._clip = take, clip

            self.takes.jobs.submit(FRAMES, lambda: take.clip, loaded)
        return self._clip[1]

    def pose(self, playback: Playback) -> Pose | None:
        """Return the reference's pose on our skeleton at the shown time, or None."""
        take = self.take
        if not self.shown or take is None:
            return None
        clip = self._clip_of(take)
        if clip is None:
            return None
        move, turn = self._place(playback.clip, clip)
        pose = clip.sample(self.time_s(playback))
        hips = rotations.rotate(rotations.from_yaw(turn), pose.hips_position) + move
        local = np.array(pose.local_rotations)
        local[0] = rotations.multiply(rotations.from_yaw(turn), local[0])
        ground = float(playback.terrain.height(float(hips[0]), float(hips[2])))
        start = playback.clip.hips_positions[0]
        hips[1] += ground - float(playback.terrain.height(float(start[0]), float(start[2])))
        return make_pose(hips, local, pose.contacts, ground, pose.root_yaw + turn)

    def figure(self, playback: Playback, pose: Pose) -> Figure | None:
        """Return the reference as a figure with another mesh, or None if the live character's mesh shows it."""
        if self.look is Look.CHARACTER and self.character is not None:
            return Figure(self.character, self.character.skin_matrices(pose), pose, ghost=self.reference.over)
        take = self.take
        own = None if take is None or self.look is not Look.SKELETON else take.own
        if own is None or take is None:
            return None
        if self._bones is None or self._bones[0] is not own:
            self._bones = own, bones_of(own)
        bones, clip = self._bones[1], self._clip_of(take)
        if clip is None:
            return None
        _, turn = self._place(playback.clip, clip)
        time_s = min(max(self.time_s(playback), 0.0), clip.seconds)
        there = clip.sample(time_s).hips_position  # the points keep their position relative to our hips
        points = rotations.rotate(rotations.from_yaw(turn), own.sample(time_s * clip.fps) - there)
        return Figure(bones, bones.matrices(points + pose.hips_position), pose, on_top=self.reference.over)

    def _place(self, take: Clip, clip: Clip) -> tuple[Array, float]:
        """Return the offset `(3,)` and rotation with which the reference begins beside the start of the take."""
        if self._placed is None or self._placed[0] is not take or self._placed[1] is not clip:
            ours, theirs = take.pose(0), clip.pose(0)
            turn = math.remainder(ours.root_yaw - theirs.root_yaw, math.tau)
            moved = rotations.rotate(rotations.from_yaw(turn), np.asarray(theirs.hips_position, float))
            shift = np.asarray(ours.hips_position, float) - moved
            shift[1] = float(ours.hips_position[1] - theirs.hips_position[1]) if abs(shift[1]) > 0.3 else 0.0
            self._placed = take, clip, ours.root_yaw, shift, turn
        *_, yaw, shift, turn = self._placed
        right = np.array([-math.cos(yaw), 0.0, math.sin(yaw)])
        return shift + (0.0 if self.reference.over else self.reference.aside_m) * right, turn


@dataclass(frozen=True, eq=False)
class Bones:
    """A mesh of spindles, one per bone, each along +Y with length 1 in its rest pose."""

    ends: AnyArray  # (B, 2) point indices of the skeleton
    positions: AnyArray
    normals: AnyArray
    colors: AnyArray
    joint_indices: AnyArray
    joint_weights: AnyArray
    triangles: AnyArray

    def skin_matrices(self, pose: Pose) -> Array:
        """Raise NotImplementedError; bones are posed by points, see `matrices`."""
        raise NotImplementedError("bones follow points: `matrices`")

    def matrices(self, points: Array) -> Array:
        """Return the matrices `(B, 4, 4)` that place each spindle between its two `points` `(K, 3)`."""
        start, along = points[self.ends[:, 0]], points[self.ends[:, 1]] - points[self.ends[:, 0]]
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-6)
        up = along / length[:, None]
        helper = np.where(np.abs(up[:, :1]) < 0.9, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
        side = np.cross(up, helper)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        thick = np.clip(length * THICKNESS_BONE_FRACTION, THINNEST_M, THICKEST_M)[:, None]
        shown = (length <= MAX_BONE_M)[:, None]  # shrunk to nothing otherwise
        made = np.zeros((len(up), 4, 4), np.float32)
        made[:, :3, 0], made[:, :3, 1] = side * thick * shown, along * shown
        made[:, :3, 2], made[:, :3, 3] = np.cross(side, up) * thick * shown, start
        made[:, 3, 3] = 1.0
        return made


def bones_of(own: OwnSkeleton) -> Bones:
    """Return the bones of a skeleton as a mesh; only the longest if there are too many to draw."""
    ends = np.array([(parent, k) for k, parent in enumerate(own.parents) if parent >= 0], np.int64).reshape(
        -1, 2
    )
    first = own.points[0].astype(np.float64)
    lengths = np.linalg.norm(first[ends[:, 1]] - first[ends[:, 0]], axis=1)
    longest = np.argsort(-lengths, kind="stable")[:MAX_BONES]
    ends = ends[np.sort(longest[lengths[longest] > 1e-4])]
    corners, normals = _spindle()
    count, each = len(ends), len(corners)
    return Bones(
        ends=ends,
        positions=np.tile(corners, (count, 1)),
        normals=np.tile(normals, (count, 1)),
        colors=np.tile(np.array(COLOR, np.float32), (count * each, 1)),
        joint_indices=np.repeat(np.arange(count, dtype=np.uint16), each)[:, None]
        * np.array([1, 0, 0, 0], np.uint16),
        joint_weights=np.tile(np.array([1, 0, 0, 0], np.float32), (count * each, 1)),
        triangles=np.arange(count * each, dtype=np.uint32).reshape(-1, 3),
    )


def _spindle() -> tuple[Array, Array]:
    """Return corners `(24, 3)` and normals of eight flat triangles around +Y, counter-clockwise from outside."""
    ring = np.array(
        [
            (1.0, WAIST_BONE_FRACTION, 0.0),
            (0.0, WAIST_BONE_FRACTION, -1.0),
            (-1.0, WAIST_BONE_FRACTION, 0.0),
            (0.0, WAIST_BONE_FRACTION, 1.0),
        ]
    )
    low, high = np.zeros(3), np.array([0.0, 1.0, 0.0])
    faces = []
    for i in range(4):
        a, b = ring[i], ring[(i + 1) % 4]
        faces += [(low, b, a), (high, a, b)]
    corners = np.array(faces)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals[:, 1] *= THICKNESS_BONE_FRACTION**2  # compensates for the stretching matrices
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return corners.reshape(-1, 3).astype(np.float32), np.repeat(normals, 3, axis=0).astype(np.float32)
