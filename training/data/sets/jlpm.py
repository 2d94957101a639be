"""One long take of walking and jogging, José Luis Pontón."""

from __future__ import annotations

from pathlib import Path

from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import SIDES, SourceJoint, SourceSkeleton


def _list_jlpm(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips = [
        ClipSource(p, f"jlpm_{p.stem}", "jlpm", "neutral_cmu", "mixed walk jog")
        for p in sorted(folder.glob("*.bvh"))
    ]
    return clips, []


def _jlpm() -> SourceSkeleton:
    trunk = "-X +Y -Z"
    names = {
        "Hips": "Hips", "LowerBack": "Spine", "Spine": "Chest", "Spine1": "UpperChest", "Neck1": "Neck", "Head": "Head",
    }  # fmt: skip
    joints = {ours: SourceJoint(theirs, axes=trunk) for ours, theirs in names.items()}
    arm = {"Left": "+Z +X +Y", "Right": "-Z -X +Y"}
    for side in SIDES:
        names = {"Shoulder": "Shoulder", "Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"}
        joints |= {side + o: SourceJoint(side + t, axes=arm[side]) for o, t in names.items()}
        names = {"UpLeg": "UpperLeg", "Leg": "LowerLeg"}
        joints |= {side + o: SourceJoint(side + t, axes="+X -Y -Z") for o, t in names.items()}
        names = {"Foot": "Foot", "ToeBase": "Toes"}
        joints |= {side + o: SourceJoint(side + t, axes="+X +Z -Y") for o, t in names.items()}
    return SourceSkeleton("jlpm", frozenset({"UpperChest", "LeftUpperLeg"}), joints)


RECORD = DataSet(
    name="jlpm",
    credit="José Luis Pontón, locomotion take (MIT)",
    clips=_list_jlpm,
    skeletons=(_jlpm(),),
    long_takes=True,
    slide=2.5,  # inertial capture: feet slide in stance, so contact is granted at higher speeds
    head_lift_degrees={"jlpm": 5.0},
)
