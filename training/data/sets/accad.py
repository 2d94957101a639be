"""ACCAD, Ohio State University: two people; starts, stops, turns, side steps, skipping, crouching, runs."""

from __future__ import annotations

import re
from pathlib import Path

from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import LIMBS, SIDES, SourceJoint, SourceSkeleton, same_rest

# what a take of ACCAD shows, by a part of its name: style and content, or why it is left out
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


def _list_accad(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for path in sorted(folder.glob("*.bvh")):
        name = f"accad_{path.stem}"
        found = next((v for word, v in _ACCAD.items() if word in path.name), None)
        if isinstance(found, str):
            refused.append(Refusal(name, "accad", found))
            continue
        words = re.sub(r"(?<=[a-z])(?=[A-Z0-9])", " ", path.stem.split("_")[2]).lower()
        style, content = found or ("neutral", words.replace("side step", "walk sideways"))
        capture = "_".join(name.lower().split("_")[:2])
        clips.append(ClipSource(path, name, "accad", style, content, capture=capture))
    return clips, refused


def _accad() -> SourceSkeleton:
    joints = same_rest(Hips="Hips", Spine="Spine", Spine1="Spine1", Neck1="Neck", Head="Head")
    joints |= {side + limb: SourceJoint(side + limb) for side in SIDES for limb in LIMBS}
    return SourceSkeleton("accad", frozenset({"ToSpine", "LeftToeBase"}), joints, reference="")


RECORD = DataSet(
    name="accad",
    credit="ACCAD, The Ohio State University (CC BY 3.0)",
    clips=_list_accad,
    skeletons=(_accad(),),
    # a take of each person in which they stand upright at the first frame
    references={"accad_female1": "Female1_A01_Stand.bvh", "accad_male1": "Male1_A1_Stand.bvh"},
    head_lift_degrees={"accad_male1": 8.0},
)
