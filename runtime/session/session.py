"""A session: everything that a user has made and can undo, as one immutable value.

The live character is the take with an open end (`Session.live`): it has a prompt, a path, pins and camera keys like any
take in the list.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from typing import Any

from runtime.character.shape import BodyShape
from runtime.errors import UsageError
from runtime.motion.control_scripts import Waypoint
from runtime.session.motion import ClipCache, Motion
from runtime.session.prompt_blend import PromptBlend
from runtime.takes.camera_keys import CameraKey
from runtime.takes.clip import Clip
from runtime.takes.own_skeleton import OwnSkeleton
from runtime.takes.pose_edits import NO_EDITS, PoseEdits
from runtime.terrain.height_map import Terrain

LIVE = 0  # the number of the live character among the takes
MIN_FRAMES = 2  # minimum length after a trim
MAX_RATING = 5
NO_SHAPE, NO_PROMPT = BodyShape(), PromptBlend()


@dataclass(frozen=True)
class Ground:
    """A ground by its name or file; grounds with the same heights are equal."""

    spec: str
    terrain: Terrain = field(compare=False)
    key: str  # hash of its content

    @staticmethod
    def of(spec: str, terrain: Terrain) -> Ground:
        about = f"{terrain.name} {terrain.cell_m} {terrain.origin} {terrain.unit_m} {terrain.heights.shape}"
        digest = hashlib.blake2b(terrain.heights.tobytes(), digest_size=16, key=about.encode()[:64])
        return Ground(spec, terrain, digest.hexdigest())


@dataclass(frozen=True)
class CharacterChoice:
    """The character: the mannequin in a shape, or a file whose content is stored under `key`."""

    shape: BodyShape = NO_SHAPE
    path: str = ""  # the opened file; "" for the mannequin
    key: str = ""  # hash of the content of its files
    unit: str = ""  # unit of length in its file: m, cm, mm or in; "" to infer it from its height


@dataclass(frozen=True)
class ModelName:
    """The model that moved the character; `folder` is "" for the shipped one."""

    folder: str = ""
    name: str = ""
    sha256: str = ""
    seed: int = 0


@dataclass(frozen=True)
class Reference:
    """What a take is compared with: take `take` of the session, or the film `video` if given."""

    take: int = LIVE
    video: str = ""  # a path
    look: str = ""  # its appearance, a term of the viewer
    character: CharacterChoice | None = None  # of its own
    offset_s: float = 0.0  # delay
    aside_m: float = 1.0  # to the right of the take
    size: float = 0.4  # width of a film's picture relative to the view's
    opacity: float = 0.5  # of a film over the take
    over: bool = False  # translucent, in the same place


@dataclass(frozen=True)
class Variant:
    """A character of the compare view, with its prompt and seed."""

    number: int
    prompt: PromptBlend
    seed: int = 0


@dataclass(frozen=True)
class Take:
    """A take: its motion and the edits over it. Without a motion it is the live character."""

    number: int = LIVE  # unique in a session
    motion: Motion | None = None
    name: str = ""  # given by the user; "" for the motion's
    trim: tuple[int, int] | None = None  # first and last frame that are kept
    numbered_from: int = 0  # frame that is shown as 0: where the part of a split take begins
    poses: PoseEdits = NO_EDITS  # pins and footplants
    cameras: tuple[CameraKey, ...] = ()
    path: tuple[Waypoint, ...] = ()  # as drawn; () with a motion: the motion's own path
    prompt: PromptBlend = NO_PROMPT  # of the live character; a motion has its own in its input
    mirrored: bool = False
    color: int = 0  # of its row; 0 for none
    rating: int = 0  # up to `MAX_RATING` stars; 0 for none
    note: str = ""  # by the user
    recorded: bool = True  # in this program, not read from a file
    ground: Ground | None = None  # on which it was made, if known
    own: OwnSkeleton | None = field(default=None, compare=False)  # original skeleton of a retargeted file

    @property
    def title(self) -> str:
        made = "Live" if self.motion is None else self.motion.header.name
        name = self.name or (f"{made}, mirrored" if self.mirrored else made)
        return " ".join(name.split()) or f"Take {self.number}"  # a foreign name may be blank

    @property
    def made(self) -> Motion:
        """The take's motion; UsageError for the live character, which has none yet."""
        if self.motion is None:
            raise UsageError("The live character is not recorded.", "Record a take with R.")
        return self.motion

    @property
    def frames(self) -> int:
        return self.made.header.frames

    @property
    def range(self) -> tuple[int, int]:
        """First and last frame after the trim."""
        last = self.frames - 1
        if self.trim is None:
            return 0, last
        end = min(self.trim[1], last)
        return max(min(self.trim[0], end - MIN_FRAMES + 1), 0), end

    @property
    def trimmed(self) -> bool:
        """Whether the trim removes any frame."""
        return self.range != (0, self.frames - 1)

    @property
    def base_clip(self) -> Clip:
        """The take's frames before pose edits; FileError if its file cannot be read."""
        clip = self.made.clip
        return _mirrored(self.made) if self.mirrored else clip

    @property
    def below_layer(self) -> Clip:
        """The take's frames with footplants, before the pose layer and pins."""
        plants = PoseEdits(footplants=self.poses.footplants)
        return _posed(self.made, self.mirrored, plants) if plants else self.base_clip

    def frame(self, number: int) -> Clip:
        """Return one edited frame as a clip, for a preview before all frames are computed."""
        return self.poses.frame(self.below_layer, number)

    @property
    def clip(self) -> Clip:
        return _posed(self.made, self.mirrored, self.poses) if self.poses else self.base_clip

    @property
    def exported(self) -> Clip:
        """The clip that is exported: trimmed, with the take's title as name."""
        clip = replace(self.clip, name=self.title)
        return clip.trim(*self.range) if self.trimmed else clip


_CLIPS = ClipCache()  # mirrored, or with pins and footplants


def _mirrored(motion: Motion) -> Clip:
    from runtime.takes.mirror import mirrored

    return _CLIPS.get(motion, lambda: mirrored(motion.clip))


def _posed(motion: Motion, is_mirrored: bool, poses: PoseEdits) -> Clip:
    def made() -> Clip:
        return replace(poses.apply(_mirrored(motion) if is_mirrored else motion.clip), loop=None)

    return _CLIPS.get((motion, is_mirrored, poses), made)


@dataclass(frozen=True)
class Session:
    """Takes in order, the live character, its ground and body, and the compare view's variants."""

    takes: tuple[Take, ...] = ()
    live: Take = Take()
    ground: Ground | None = None  # None until one is loaded
    character: CharacterChoice = CharacterChoice()
    model: ModelName = ModelName()
    reference: Reference | None = None
    variants: tuple[Variant, ...] = ()  # of the compare view
    counter: int = 0  # number of the last take made
    selected: int = LIVE

    def take(self, number: int) -> Take | None:
        """Return a take by its number; the live character has number 0."""
        if number == LIVE:
            return self.live
        return next((take for take in self.takes if take.number == number), None)

    def index(self, number: int) -> int:
        """Return the index of a take in the list, or -1."""
        return next((i for i, take in enumerate(self.takes) if take.number == number), -1)

    @property
    def current(self) -> Take | None:
        """The selected take, or None."""
        return None if self.selected == LIVE else self.take(self.selected)

    def with_take(self, number: int, **changes: Any) -> Session:
        """Return the session with fields of a take or the live character replaced; unchanged if there is no such take."""
        if number == LIVE:
            return replace(self, live=replace(self.live, **changes))
        takes = tuple(replace(take, **changes) if take.number == number else take for take in self.takes)
        return replace(self, takes=takes)


def has_edits(session: Session) -> bool:
    """Return whether a session contains work besides takes: edits of the live character, or variants."""
    live = session.live
    return bool(live.path or live.poses or live.cameras or session.variants)
