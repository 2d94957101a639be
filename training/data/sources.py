"""The table of data sets: their files, credits and licences, and the parameters of their import.

Reading, retargeting, labels, cutting, cleaning and ground are the same for all (`training.data.importer`).
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from runtime.errors import FileError
from runtime.formats.bvh import BvhMotion, read_bvh
from training.data import shown
from training.data.readers import read_json, read_transforms, read_z_up
from training.data.shown import ClipSource, Listing, Refusal, Shown
from training.data.source_skeletons import SourceSkeleton, known_skeletons


@dataclass(frozen=True)
class DataSet:
    """One archive. To add one, write a record in `DATA_SETS`, and descriptions of its styles in `styles.json` next to this file."""

    name: str  # of the archive and of its folder
    credit: str
    # returns style and content of a file, or why it is left out
    shows: Callable[[Path], Shown | str]
    free: bool = True  # allows commercial use with the credit
    source: str = ""  # data set to which its clips belong; by default itself
    files: str = "*.bvh"
    clip_name: str | Callable[[str], str] = ""  # prefix of a file's stem, or function of it; by default NAME_
    select: Callable[[list[ClipSource]], Listing] = lambda clips: (clips, [])  # among the usable clips
    read: Callable[[Path], BvhMotion] = read_bvh
    first_frame: int = 0  # earlier frames are a T-pose
    has_tpose: bool = False  # at either end of a take
    long_takes: bool = False  # the only ones of their style and content: their tails are held out
    slide: float = 1.0  # factor on the speed limits of contact
    metres_per_unit: float | None = None  # None: from the ratio of leg lengths
    # Upward tilt of faces, degrees, by capture: the median face pitch (elevation of the head's +Z) over neutral
    # walks after retargeting was -22 in 100STYLE, -12 to -14 in the second Bandai Namco data set, -11 in JLPM, -23 to -29
    # in PFNN, -12 to -22 in O3DE and -12 to -17 of ACCAD's man. The tilt brings it to about -6; others stay at -2 to +3.
    head_lift_degrees: Mapping[str, float] = field(default_factory=dict)
    references: Mapping[str, str] = field(default_factory=dict)  # by capture: a take that starts upright

    def clips(self, folder: Path) -> Listing:
        """List the files of the unpacked folder to import, and those that are left out."""
        source, name = self.source or self.name, self.clip_name or f"{self.name}_"
        clips: list[ClipSource] = []
        refused: list[Refusal] = []
        for path in sorted(folder.glob(self.files)):
            clip = name + path.stem if isinstance(name, str) else name(path.stem)
            found = self.shows(path)
            if isinstance(found, str):
                refused.append(Refusal(clip, source, found))
            else:
                about = vars(found) | {"capture": found.capture or source}
                clips.append(ClipSource(path=path, name=clip, source=source, **about))
        clips, more = self.select(clips)
        return clips, refused + more

    def of_capture(self, skeleton: SourceSkeleton, capture: str) -> SourceSkeleton:
        """Return `skeleton` with the constants of one capture."""
        return replace(
            skeleton,
            reference=self.references.get(capture, skeleton.reference),
            head_lift_degrees=self.head_lift_degrees.get(capture, 0.0),
            fixed_scale=self.metres_per_unit or skeleton.fixed_scale,
        )


_STYLE100_CREDIT = "The 100STYLE Dataset - Ian Mason (CC BY 4.0)"
DATA_SETS: tuple[DataSet, ...] = (
    DataSet(
        "o3de",
        "Copyright (c) Contributors to the Open 3D Engine Project (Apache-2.0 or MIT)",
        shown.o3de,
        long_takes=True,
        head_lift_degrees={"o3de": 10.0},
    ),
    DataSet(
        "accad",
        "ACCAD, The Ohio State University (CC BY 3.0)",
        shown.accad,
        # a take of each person that starts upright
        references={"accad_female1": "Female1_A01_Stand.bvh", "accad_male1": "Male1_A1_Stand.bvh"},
        head_lift_degrees={"accad_male1": 8.0},
    ),
    DataSet(
        "100style",
        _STYLE100_CREDIT,
        shown.style100,
        files="**/*.bvh",
        long_takes=True,
        has_tpose=True,
        head_lift_degrees={"100style": 16.0},
    ),
    # one more style of the same capture
    DataSet(
        "100style_more",
        _STYLE100_CREDIT,
        shown.style100,
        source="100style",
        files="**/*.bvh",
        clip_name="100style_",
    ),
    DataSet(
        "bandai_namco",
        "Bandai Namco Research Motiondataset (CC BY-NC 4.0)",
        shown.bandai,
        free=False,
        files="**/*.bvh",
        clip_name=shown.bandai_name,
        select=shown.longest_gestures,
        head_lift_degrees={"bandai2": 7.0},
    ),
    DataSet(
        "cmu",
        "Data from mocap.cs.cmu.edu, created with funding from NSF EIA-0196217",
        shown.cmu,
        first_frame=3,  # frame 0 is a T-pose, which resampling to 60 Hz spreads over two more frames
    ),
    DataSet(
        "cmu91",
        "CMU subject 91: mocap.cs.cmu.edu, created with funding from NSF EIA-0196217",
        lambda _: Shown("neutral", "jump and turn"),
        first_frame=1,
    ),
    DataSet(
        "fair_zombie",
        "Zombie walk: Copyright (c) Meta Platforms, Inc. and affiliates (MIT)",
        lambda path: shown.FAIR.get(path.stem, "unknown take"),
        clip_name="fair_",
    ),
    DataSet(
        "small_mit",
        "ProAnimationBank (MIT); waving: Copyright (c) Meta Platforms, Inc. and affiliates (MIT)",
        lambda path: shown.SMALL.get(path.stem, "unknown take"),
        clip_name="small_",
        read=read_z_up,
        references={"small_mit": "crossarms.bvh"},
    ),
    DataSet(
        "walking_stick",
        "100STYLE WalkingStickLeft - Ian Mason, by way of a CC BY-NC repository (non-commercial)",
        lambda _: Shown("walking_stick", "run backward"),
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
        long_takes=True,
        slide=2.5,  # inertial capture: feet slide in stance, so contact is allowed at higher speed
        head_lift_degrees={"jlpm": 5.0},
    ),
    DataSet(
        "pfnn",
        "Holden et al. 2017, Phase-Functioned Neural Networks (academic, non-commercial)",
        lambda _: Shown("neutral_rough", "mixed locomotion"),
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
    """List all clips below `data` (one folder per archive) and the files that are left out, in a stable order.

    `free_only` omits archives with a non-commercial licence.
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
    """Return the folder with the unpacked files of `source`: DATA/NAME/NAME or DATA/NAME."""
    for folder in (data / source / source, data / source):
        if folder.is_dir():
            return folder
    return None


def recognise(motion: BvhMotion, file_name: str) -> SourceSkeleton:
    """Return the known skeleton of a motion; FileError with the file name if there is none."""
    names = set(motion.skeleton.names)
    found = next((skeleton for skeleton in known_skeletons() if skeleton.signature <= names), None)
    if found is None:
        raise FileError(
            f"{file_name}: unknown skeleton.",
            "Describe its joints in training/data/skeletons.toml.",
        )
    missing = {joint.name for joint in found.joints.values()} - names
    if missing:
        raise FileError(f"{file_name}: joints {sorted(missing)} are missing.", "Export the clip again.")
    return found


def skeleton_of(clip: ClipSource, motion: BvhMotion) -> SourceSkeleton:
    """Return the skeleton of a clip with the constants of its capture."""
    found = recognise(motion, clip.path.name)
    owner = next(
        (r for r in DATA_SETS if clip.capture in {*r.head_lift_degrees, *r.references}), BY_NAME[clip.source]
    )
    return owner.of_capture(found, clip.capture)


def credits_of(sources: set[str]) -> list[str]:
    """Return the distinct credits of archives in a stable order; KeyError for an unknown one."""
    return list(dict.fromkeys(BY_NAME[name].credit for name in sorted(sources)))


def licence_of(sources: set[str]) -> str:
    """Return the licence of weights trained on these archives."""
    return FREE if all(BY_NAME[name].free for name in sources) else NON_COMMERCIAL


def style_library(path: Path) -> dict[str, Any]:
    """Load the descriptions of all captured styles, by style: `descriptions`, each a mapping from body parts to text.

    The last `measured` of them were measured. Styles of `path` (assets/prompts/styles.json) take precedence over those in
    `styles.json` next to this file. FileError if `path` is damaged.
    """
    own = json.loads(Path(__file__).with_name("styles.json").read_text(encoding="utf-8"))
    return own | dict(read_json(path, "Restore assets/prompts/styles.json."))
