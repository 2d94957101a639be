"""CMU motion capture: walks, runs, jumps, stairs, uneven ground; and subject 91, jumps with turns."""

from __future__ import annotations

import json
import re
from pathlib import Path

from runtime.errors import FileError
from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import LIMBS, SIDES, SourceJoint, SourceSkeleton, same_rest

_CMU_STYLES = {"exaggerated stride": "cmu_exaggerated_stride", "hop": "cmu_hop"}
_CMU_REFUSED = ("playground", "dance", "basketball", "soccer", "ladder", "grab", "jumping jacks", "balance")


def _list_cmu(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    index = folder / "index.json"
    try:
        descriptions = json.loads(index.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(f"{index}: {error}.", "Unpack the archive again.") from error
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for path in sorted(folder.glob("*.bvh")):
        text = str(descriptions.get(path.stem, "")).lower()
        name = f"cmu_{path.stem}"
        words = re.findall(r"[a-z]+", text)
        wanted = {"walk", "run", "jog", "jump", "hop", "march", "navigate", "steps"} & set(words)
        if not wanted or any(word in text for word in _CMU_REFUSED):
            refused.append(Refusal(name, "cmu", f"not locomotion: {text or 'no description'}"))
            continue
        style = next((key for word, key in _CMU_STYLES.items() if word in text), "neutral_cmu")
        terrain = "contacts" if "uneven" in text or "steps" in text else "flat"
        capture = "cmu_plain" if path.stem.startswith("131_") else "cmu"
        clips.append(ClipSource(path, name, "cmu", style, text, terrain=terrain, capture=capture))
    return clips, refused


def _list_cmu91(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    paths = sorted(folder.glob("*.bvh"))
    return [ClipSource(p, f"cmu91_{p.stem}", "cmu91", "neutral", "jump and turn") for p in paths], []


def _daz() -> SourceSkeleton:
    joints = same_rest(Hips="hip", Spine="abdomen", Spine1="chest", Neck1="neck", Head="head")
    joints["LowerBack"] = SourceJoint("hip", "abdomen", 0.5)
    for side in SIDES:
        s = side[0].lower()
        joints[side + "UpLeg"] = SourceJoint(s + "Thigh", along=s + "Shin")
        joints[side + "Leg"] = SourceJoint(s + "Shin", along=s + "Foot")
        joints[side + "Foot"] = SourceJoint(s + "Foot")
        joints[side + "Shoulder"] = SourceJoint(s + "Collar")
        joints[side + "Arm"] = SourceJoint(s + "Shldr", along=s + "ForeArm")
        joints[side + "ForeArm"] = SourceJoint(s + "ForeArm", along=s + "Hand")
        joints[side + "Hand"] = SourceJoint(s + "Hand", along=s + "Mid1")
    return SourceSkeleton(
        "cmu_daz",
        frozenset({"abdomen", "lShldr"}),
        joints,
        has_toe_rotation=False,
        toe_is_end_site=True,
        neck_base="neck",
    )


def _cmusame_rest() -> SourceSkeleton:
    joints = same_rest(
        Hips="Hips",
        LowerBack="lowerback",
        Spine="Chest",
        Spine1="Chest2",
        Neck="lowerneck",
        Neck1="Neck",
        Head="Head",
    )
    for side in SIDES:
        joints[side + "UpLeg"] = SourceJoint(side + "Hip", along=side + "Knee")
        joints[side + "Leg"] = SourceJoint(side + "Knee", along=side + "Ankle")
        joints[side + "Foot"] = SourceJoint(side + "Ankle")
        joints[side + "ToeBase"] = SourceJoint(side + "Toe")
        joints[side + "Shoulder"] = SourceJoint(side + "Collar")
        joints[side + "Arm"] = SourceJoint(side + "Shoulder", along=side + "Elbow")
        joints[side + "ForeArm"] = SourceJoint(side + "Elbow", along=side + "Wrist")
        joints[side + "Hand"] = SourceJoint(side + "Wrist", along=side[0] + "Fingers")
    return SourceSkeleton("cmu_plain", frozenset({"lowerback", "LHipJoint"}), joints, neck_base="lowerneck")


def _cmu91() -> SourceSkeleton:
    joints = same_rest(Hips="Hips", Spine="Spine", Spine1="Spine1", Neck1="Neck", Head="Head")
    joints |= {side + limb: SourceJoint(side + limb) for side in SIDES for limb in LIMBS[:-1]}
    return SourceSkeleton(
        "cmu91",
        frozenset({"LeftHipJoint", "Spine1"}),
        joints,
        has_toe_rotation=False,
        toe_is_end_site=True,
        reference="",
    )


RECORD = DataSet(
    name="cmu",
    credit="Data from mocap.cs.cmu.edu, created with funding from NSF EIA-0196217",
    clips=_list_cmu,
    skeletons=(_daz(), _cmusame_rest()),
    first_frame=3,  # frame 0 is a T-pose, smeared over the next two by the resampling to 60 Hz
)
SUBJECT_91 = DataSet(
    name="cmu91",
    credit="CMU subject 91: mocap.cs.cmu.edu, created with funding from NSF EIA-0196217",
    clips=_list_cmu91,
    skeletons=(_cmu91(),),
    first_frame=1,
)
