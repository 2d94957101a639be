"""The table of data sets: what is in a folder of archives, whom to credit, and what differs between them when they are imported.

Reading, retargeting, labels, cutting, cleaning and ground are the same for all (`training.data.importer`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from runtime import rotations
from runtime.errors import FileError
from runtime.formats.bvh import BvhMotion, read_bvh
from runtime.safe_read import open_npz
from runtime.skeleton import Skeleton
from training.data import source_skeletons as skeletons
from training.data.source_skeletons import SourceSkeleton


@dataclass(frozen=True)
class ClipSource:
    """One file to import."""

    path: Path
    name: str  # unique among all sources
    source: str
    style: str
    content: str
    tier: str = "exact"
    terrain: str = "flat"  # "flat", "rollout" (known height map) or "contacts" (to be fitted)
    # files of one skeleton and one person or studio, calibrated together; by default the source
    capture: str = ""

    def __post_init__(self) -> None:
        if not self.capture:
            object.__setattr__(self, "capture", self.source)


@dataclass(frozen=True)
class Refusal:
    """A file, or a part of it, that does not enter the training clips."""

    name: str
    source: str
    reason: str


@dataclass(frozen=True)
class Shown:
    """What a file shows; see `ClipSource`."""

    style: str
    content: str
    tier: str = "exact"
    terrain: str = "flat"
    capture: str = ""


Listing = tuple[list[ClipSource], list[Refusal]]


@dataclass(frozen=True)
class DataSet:
    """One archive. To add one: its record in `DATA_SETS`, and its styles' descriptions in `styles.json` next to this file."""

    name: str  # of the archive and of its folder
    credit: str
    # what a file shows, or why it is left out
    shows: Callable[[Path], Shown | str]
    skeletons: tuple[SourceSkeleton, ...] = ()  # hierarchies that no other data set has
    free: bool = True  # allows commercial use with the credit
    source: str = ""  # that its clips are counted to; by default the data set itself
    files: str = "*.bvh"
    clip_name: str | Callable[[str], str] = ""  # prefix of a file's stem, or function of it; by default NAME_
    select: Callable[[list[ClipSource]], Listing] = lambda clips: (clips, [])  # of the clips that are shown
    read: Callable[[Path], BvhMotion] = read_bvh
    first_frame: int = 0  # before it: a T-pose
    has_tpose: bool = False  # at either end of a take
    long_takes: bool = False  # unique in their style and content: they give their tails to evaluation
    slide: float = 1.0  # times the speed at which a foot still counts as standing
    metres_per_unit: float | None = None  # None: by the ratio of leg lengths
    # Degrees by which faces are tilted up, by capture: the median face pitch (elevation of the head's +Z) over neutral
    # walks after retargeting was -22 in 100STYLE, -12 to -14 in the second Bandai Namco data set, -11 in JLPM, -23 to -29
    # in PFNN, -12 to -22 in O3DE and -12 to -17 of ACCAD's man. The tilt brings it to about -6; others stay at -2 to +3.
    head_lift_degrees: Mapping[str, float] = field(default_factory=dict)
    references: Mapping[str, str] = field(default_factory=dict)  # by capture: a take that begins upright

    def clips(self, folder: Path) -> Listing:
        """Files of the unpacked folder to import, and those that are left out."""
        source, name = self.source or self.name, self.clip_name or f"{self.name}_"
        clips: list[ClipSource] = []
        refused: list[Refusal] = []
        for path in sorted(folder.glob(self.files)):
            clip = name + path.stem if isinstance(name, str) else name(path.stem)
            shown = self.shows(path)
            if isinstance(shown, str):
                refused.append(Refusal(clip, source, shown))
            else:
                clips.append(ClipSource(path, clip, source, **vars(shown)))
        clips, more = self.select(clips)
        return clips, refused + more

    def of_capture(self, skeleton: SourceSkeleton, capture: str) -> SourceSkeleton:
        """`skeleton` with the constants of one capture, which its hierarchy does not give."""
        return replace(
            skeleton,
            reference=self.references.get(capture, skeleton.reference),
            head_lift_degrees=self.head_lift_degrees.get(capture, 0.0),
            fixed_scale=self.metres_per_unit or skeleton.fixed_scale,
        )


# --- Open 3D Engine's motion-matching takes: neutral locomotion, crouching, jumps onto a platform ---------------------

_O3DE_CONTENT = {
    "Crouching": "crouched walk", "Jumps": "mixed walk jog jump onto a platform", "Run": "run forward",
    "RunPivotTurn": "run turns", "Jog": "jog forward", "JogPivotTurn": "jog turns", "Walk": "walk forward",
}  # fmt: skip


def _o3de(path: Path) -> Shown | str:
    take = path.stem.rstrip("0123456789")
    if take == "Pushes":
        return "pushed by another: no movement that one wants"
    content = _O3DE_CONTENT.get(take, f"mixed walk jog: {take}")
    return Shown("neutral", content, terrain="contacts" if take == "Jumps" else "flat")


# --- ACCAD, Ohio State University: two people; starts, stops, turns, side steps, skipping, crouching, runs ------------

# by a part of a take's name: style and content, or why it is left out
_ACCAD: dict[str, tuple[str, str] | str] = {
    "CartWheel": "acrobatics: hands carry",
    "Crawl": "on hands and knees: contacts are those of feet",
    "Lie": "lying: contacts are those of feet",
    "Sway": "standing exercise", "Swing": "standing exercise",
    "PutDownBox": "bends to the floor with a box",
    "WithBox": ("carrying_box", "walk"),
    "SkipToStand": ("skipping", "skip"), "StandToSkip": ("skipping", "skip"), "Skip": ("skipping", "skip walk"),
    "Look": ("looking_around", "idle"), "A01_Stand": ("neutral", "idle"), "A1_Stand": ("neutral", "idle"),
    "Hop": ("neutral", "mixed walk jog hop"), "Leap": ("neutral", "walk jump"), "Jump": ("neutral", "mixed walk jog jump"),
    "WalkToRun": ("neutral", "mixed walk jog"), "RunToWalk": ("neutral", "mixed walk jog"),
    "Crouch": ("neutral", "crouch"),
}  # fmt: skip


def _accad(path: Path) -> Shown | str:
    found = next((v for word, v in _ACCAD.items() if word in path.name), None)
    if isinstance(found, str):
        return found
    person, _, take, *_ = path.stem.split("_")
    words = re.sub(r"(?<=[a-z])(?=[A-Z0-9])", " ", take).lower()
    style, content = found or ("neutral", words.replace("side step", "walk sideways"))
    return Shown(style, content, capture=f"accad_{person.lower()}")


# --- 100STYLE: styles walked and run in all directions, idles and transitions -----------------------------------------

_STYLE100_CONTENT = {
    "FW": "walk forward", "BW": "walk backward", "SW": "walk sideways", "FR": "run forward", "BR": "run backward",
    "SR": "run sideways", "ID": "idle", "TR1": "mixed transitions",
}  # fmt: skip


def _style100(path: Path) -> Shown:
    style, _, code = path.stem.partition("_")
    key = re.sub(r"(?<!^)(?=[A-Z])", "_", style).lower()
    key = "neutral_100style" if key == "neutral" else key
    tier = "estimated_root" if "estimated" in path.parent.name else "exact"
    return Shown(key, _STYLE100_CONTENT.get(code, code), tier)


# --- Bandai Namco Research Motiondataset: twenty styles of walking, running and turning, and gestures -----------------

_BANDAI_STYLES = {
    "dataset-1": {
        "normal": "neutral_bn", "happy": "happy", "sad": "sad", "angry": "angry_bn", "proud": "proud",
        "not-confident": "not_confident", "masculinity": "masculine", "feminine": "feminine", "childish": "childish",
        "old": "old", "tired": "tired", "active": "active", "musical": "musical",
    },
    "dataset-2": {
        "active": "active2", "elderly": "elderly", "exhausted": "exhausted", "feminine": "feminine2",
        "masculine": "masculine2", "normal": "neutral_bn2", "youthful": "youthful",
    },
}  # fmt: skip
_BANDAI_CONTENT = {
    "walk": "walk forward", "run": "run forward", "dash": "dash forward", "walk-back": "walk backward",
    "walk-left": "walk left", "walk-right": "walk right", "walk-turn-left": "walk turn left",
    "walk-turn-right": "walk turn right",
}  # fmt: skip
_GESTURES = {
    f"{verb}-{hand}": f"{short}_{hand.replace('-', '_')}"
    for verb, short in (("wave", "wave"), ("raise-up", "raise"))
    for hand in ("left-hand", "right-hand", "both-hands")
}
_GESTURE_PERFORMERS = ("normal", "active", "youthful")
GESTURE_CLIPS = 12  # per gesture: standing still needs few examples


def _bandai(path: Path) -> Shown | str:
    dataset, content, performer, _ = path.stem.split("_")
    capture = f"bandai{dataset[-1]}"
    if content in _GESTURES:
        if performer not in _GESTURE_PERFORMERS:
            return "gesture of another performer"
        return Shown(_GESTURES[content], _GESTURES[content].replace("_", " "), capture=capture)
    if content in _BANDAI_CONTENT:
        return Shown(_BANDAI_STYLES[dataset][performer], _BANDAI_CONTENT[content], capture=capture)
    return f"not locomotion: {content}"


def _bandai_name(stem: str) -> str:
    dataset, rest = stem.split("_", 1)
    return f"bandai{dataset[-1]}_{rest}"


def _longest_gestures(clips: list[ClipSource]) -> Listing:
    """Of each gesture and performer the longest files."""
    kept: list[ClipSource] = []
    refused: list[Refusal] = []
    gestures: dict[tuple[str, str], list[ClipSource]] = {}
    for clip in clips:
        _, content, performer, _ = clip.path.stem.split("_")
        if content in _GESTURES:
            gestures.setdefault((content, performer), []).append(clip)
        else:
            kept.append(clip)
    wanted = GESTURE_CLIPS // len(_GESTURE_PERFORMERS)
    for own in gestures.values():
        own.sort(key=lambda c: (-c.path.stat().st_size, c.path.name))
        kept += own[:wanted]
        reason = f"more than {GESTURE_CLIPS} clips of this gesture"
        refused += [Refusal(c.name, c.source, reason) for c in own[wanted:]]
    return kept, refused


# --- CMU motion capture: walks, runs, jumps, stairs, uneven ground; and subject 91, jumps with turns ------------------

_CMU_STYLES = {"exaggerated stride": "cmu_exaggerated_stride", "hop": "cmu_hop"}
_CMU_REFUSED = ("playground", "dance", "basketball", "soccer", "ladder", "grab", "jumping jacks", "balance")
_CMU_WANTED = {"walk", "run", "jog", "jump", "hop", "march", "navigate", "steps"}


@lru_cache(1)
def _cmu_descriptions(folder: Path) -> dict[str, str]:
    index = folder / "index.json"
    try:
        return json.loads(index.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"{index}: {error}.", "Unpack the archive again.") from error


def _cmu(path: Path) -> Shown | str:
    text = str(_cmu_descriptions(path.parent).get(path.stem, "")).lower()
    wanted = _CMU_WANTED & set(re.findall(r"[a-z]+", text))
    if not wanted or any(word in text for word in _CMU_REFUSED):
        return f"not locomotion: {text or 'no description'}"
    style = next((key for word, key in _CMU_STYLES.items() if word in text), "neutral_cmu")
    terrain = "contacts" if "uneven" in text or "steps" in text else "flat"
    capture = "cmu_plain" if path.stem.startswith("131_") else "cmu"
    return Shown(style, text, terrain=terrain, capture=capture)


# --- idles and loops: ProAnimationBank (arms crossed, a twitching stand, cycles), AnimatedDrawings (zombie, wave) -----

_FAIR: dict[str, Shown | str] = {
    "zombie": Shown("zombie", "walk forward"),
    "jumping": Shown("neutral", "jump on the spot"),
}
_ON_THE_SPOT = "a cycle on the spot: its feet slide"
_SMALL: dict[str, Shown | str] = {
    "crackhead": Shown("twitching", "idle"),
    "wave_hello": Shown("wave_right_hand", "wave right hand", capture="fair_zombie"),
    "dab": "a gesture that no words ask for",
    "crossarms": "shows arms crossed, which training holds out",
    "walk": _ON_THE_SPOT,
    "jog": _ON_THE_SPOT,
    "run": _ON_THE_SPOT,
}


def read_z_up(path: Path) -> BvhMotion:
    """A take whose Z is up, turned so that Y is."""
    motion = read_bvh(path)
    upright = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(-0.5 * np.pi))
    positions, local = motion.positions.copy(), motion.local_rotations.copy()
    positions[:, 0] = rotations.rotate(upright, positions[:, 0])
    local[:, 0] = rotations.multiply(np.broadcast_to(upright, local[:, 0].shape), local[:, 0])
    return replace(motion, positions=positions, local_rotations=local)


# --- 100STYLE's WalkingStickLeft run and walked backwards, as global joint transforms ---------------------------------


def read_transforms(path: Path) -> BvhMotion:
    """A take of global joint positions and rotations as a hierarchy; FileError when it is none."""
    with open_npz(path, "Unpack the archive again.") as file:
        positions, world = file["positions"].astype(np.float64), file["quaternions"].astype(np.float64)
        names, parents = file["bone_names"], file["parent_indices"]
        fps = float(file["framerate"])
    world = world[..., [3, 0, 1, 2]]  # stored as x, y, z, w
    local, bones = world.copy(), positions.copy()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            back = rotations.inverse(world[:, parent])
            local[:, joint] = rotations.multiply(back, world[:, joint])
            bones[:, joint] = rotations.rotate(back, positions[:, joint] - positions[:, parent])
    skeleton = Skeleton(tuple(map(str, names)), tuple(map(int, parents)), np.median(bones, axis=0))
    return BvhMotion(skeleton, bones, local, 1.0 / fps, {})


# --- the table, in the order in which they are imported ---------------------------------------------------------------

_STYLE100_CREDIT = "The 100STYLE Dataset - Ian Mason (CC BY 4.0)"
DATA_SETS: tuple[DataSet, ...] = (
    DataSet(
        "o3de",
        "Copyright (c) Contributors to the Open 3D Engine Project (Apache-2.0 or MIT)",
        _o3de,
        (skeletons.O3DE,),
        long_takes=True,
        head_lift_degrees={"o3de": 10.0},
    ),
    DataSet(
        "accad",
        "ACCAD, The Ohio State University (CC BY 3.0)",
        _accad,
        (skeletons.ACCAD,),
        # a take of each person in which they stand upright at the first frame
        references={"accad_female1": "Female1_A01_Stand.bvh", "accad_male1": "Male1_A1_Stand.bvh"},
        head_lift_degrees={"accad_male1": 8.0},
    ),
    DataSet(
        "100style",
        _STYLE100_CREDIT,
        _style100,
        (skeletons.STYLE100,),
        files="**/*.bvh",
        long_takes=True,
        has_tpose=True,
        head_lift_degrees={"100style": 16.0},
    ),
    # one more style of the same capture
    DataSet(
        "100style_more",
        _STYLE100_CREDIT,
        _style100,
        source="100style",
        files="**/*.bvh",
        clip_name="100style_",
    ),
    DataSet(
        "bandai_namco",
        "Bandai Namco Research Motiondataset (CC BY-NC 4.0)",
        _bandai,
        (skeletons.BANDAI,),
        free=False,
        files="**/*.bvh",
        clip_name=_bandai_name,
        select=_longest_gestures,
        head_lift_degrees={"bandai2": 7.0},
    ),
    DataSet(
        "cmu",
        "Data from mocap.cs.cmu.edu, created with funding from NSF EIA-0196217",
        _cmu,
        (skeletons.CMU_DAZ, skeletons.CMU_PLAIN),
        first_frame=3,  # frame 0 is a T-pose, smeared over the next two by the resampling to 60 Hz
    ),
    DataSet(
        "cmu91",
        "CMU subject 91: mocap.cs.cmu.edu, created with funding from NSF EIA-0196217",
        lambda _: Shown("neutral", "jump and turn"),
        (skeletons.CMU91,),
        first_frame=1,
    ),
    DataSet(
        "fair_zombie",
        "Zombie walk: Copyright (c) Meta Platforms, Inc. and affiliates (MIT)",
        lambda path: _FAIR.get(path.stem, "unknown take"),
        (skeletons.FAIR,),
        clip_name="fair_",
    ),
    DataSet(
        "small_mit",
        "ProAnimationBank (MIT); waving: Copyright (c) Meta Platforms, Inc. and affiliates (MIT)",
        lambda path: _SMALL.get(path.stem, "unknown take"),
        (skeletons.BIPED,),
        clip_name="small_",
        read=read_z_up,
        references={"small_mit": "crossarms.bvh"},
    ),
    DataSet(
        "walking_stick",
        "100STYLE WalkingStickLeft - Ian Mason, by way of a CC BY-NC repository (non-commercial)",
        lambda _: Shown("walking_stick", "run backward"),
        (skeletons.TRANSFORMS,),
        free=False,
        files="*.npz",
        clip_name="stick_",
        read=read_transforms,
        long_takes=True,
    ),
    DataSet(
        "jlpm",
        "José Luis Pontón, locomotion take (MIT)",
        lambda _: Shown("neutral_cmu", "mixed walk jog"),
        (skeletons.JLPM,),
        long_takes=True,
        slide=2.5,  # inertial capture: feet slide in stance, so contact is granted at higher speeds
        head_lift_degrees={"jlpm": 5.0},
    ),
    DataSet(
        "pfnn",
        "Holden et al. 2017, Phase-Functioned Neural Networks (academic, non-commercial)",
        lambda _: Shown("neutral_rough", "mixed locomotion"),
        (skeletons.PFNN,),
        free=False,
        head_lift_degrees={"pfnn": 20.0},
    ),
    DataSet(
        "pfnn_rollouts",  # of the skeleton of pfnn
        "Rollouts of the published PFNN, Holden et al. 2017 (academic, non-commercial)",
        lambda _: Shown("neutral_rough", "mixed locomotion on terrain", terrain="rollout"),
        free=False,
        clip_name="rollout_",
        metres_per_unit=0.01,  # its terrain is in centimetres
    ),
)
BY_NAME = {record.name: record for record in DATA_SETS}
NON_COMMERCIAL = "non-commercial: trained also on CC BY-NC and academic data"
FREE = "CC BY 4.0: may be published and used commercially with the credits"


def list_clips(data: Path, free_only: bool = False) -> Listing:
    """All clips below `data` (one folder per archive) and the files that are left out, in a stable order.

    `free_only` leaves out the archives whose weights may not be published.
    """
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for record in DATA_SETS:
        if free_only and not record.free:
            refused.append(Refusal(record.name, record.name, "licence is non-commercial"))
            continue
        folder = source_folder(data, record.name)
        if folder is None:
            refused.append(Refusal(record.name, record.name, "archive not present"))
            continue
        found, left_out = record.clips(folder)
        clips += found
        refused += left_out
    if not clips:
        raise FileError(
            f"{data}: none of {', '.join(BY_NAME)} found.", "Give the folder of the archives with --data."
        )
    return clips, refused


def source_folder(data: Path, source: str) -> Path | None:
    """Folder with the unpacked files of `source`: DATA/NAME/NAME or DATA/NAME."""
    for folder in (data / source / source, data / source):
        if folder.is_dir():
            return folder
    return None


def recognise(motion: BvhMotion, file_name: str) -> SourceSkeleton:
    """The known skeleton of a motion; FileError names the file when there is none."""
    names = set(motion.skeleton.names)
    known = [skeleton for record in DATA_SETS for skeleton in record.skeletons]
    found = next((skeleton for skeleton in known if skeleton.signature <= names), None)
    if found is None:
        raise FileError(
            f"{file_name}: none of the known skeletons.", "Give a joint map (SourceSkeleton) for this file."
        )
    missing = {joint.name for joint in found.joints.values()} - names
    if missing:
        raise FileError(f"{file_name}: joints {sorted(missing)} are missing.", "Export the clip again.")
    return found


def skeleton_of(clip: ClipSource, motion: BvhMotion) -> SourceSkeleton:
    """The skeleton of a clip with the constants of its capture."""
    found = recognise(motion, clip.path.name)
    owner = next(
        (r for r in DATA_SETS if clip.capture in {*r.head_lift_degrees, *r.references}), BY_NAME[clip.source]
    )
    return owner.of_capture(found, clip.capture)


def credits_of(sources: set[str]) -> list[str]:
    """A line for each archive, in a stable order, none twice; KeyError for one that is unknown."""
    return list(dict.fromkeys(BY_NAME[name].credit for name in sorted(sources)))


def licence_of(sources: set[str]) -> str:
    """What may be done with weights that were trained on these archives."""
    return FREE if all(BY_NAME[name].free for name in sources) else NON_COMMERCIAL


def style_library(path: Path) -> dict[str, Any]:
    """The written descriptions of every captured style, by style: `descriptions`, one mapping of body parts each.

    The last `measured` of them were measured. Styles of `path` (assets/prompts/styles.json) come before those of the same
    name in `styles.json` next to this file. FileError where `path` is damaged.
    """
    own = json.loads(Path(__file__).with_name("styles.json").read_text(encoding="utf-8"))
    try:
        return own | dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise FileError(
            f"{path}: not a readable JSON file.", "Restore assets/prompts/styles.json."
        ) from error
