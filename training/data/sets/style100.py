"""100STYLE: six styles walked and run in all directions, idles and transitions; one more style."""

from __future__ import annotations

import re
from pathlib import Path

from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import SIDES, SourceJoint, SourceSkeleton, same_rest

_STYLE100_CONTENT = {
    "FW": "walk forward", "BW": "walk backward", "SW": "walk sideways", "FR": "run forward", "BR": "run backward",
    "SR": "run sideways", "ID": "idle", "TR1": "mixed transitions",
}  # fmt: skip


def _list_100style(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips = []
    for path in sorted(folder.rglob("*.bvh")):
        style, _, code = path.stem.partition("_")
        tier = "estimated_root" if "estimated" in path.parent.name else "exact"
        key = re.sub(r"(?<!^)(?=[A-Z])", "_", style).lower()
        key = "neutral_100style" if key == "neutral" else key
        clips.append(
            ClipSource(
                path, f"100style_{path.stem}", "100style", key, _STYLE100_CONTENT.get(code, code), tier
            )
        )
    return clips, []


def _style100() -> SourceSkeleton:
    joints = same_rest(
        Hips="Hips", LowerBack="Chest", Spine="Chest3", Spine1="Chest4", Neck1="Neck", Head="Head"
    )
    pairs = {
        "UpLeg": "Hip", "Leg": "Knee", "Foot": "Ankle", "ToeBase": "Toe",
        "Shoulder": "Collar", "Arm": "Shoulder", "ForeArm": "Elbow", "Hand": "Wrist",
    }  # fmt: skip
    for side in SIDES:
        joints |= {side + ours: SourceJoint(side + theirs) for ours, theirs in pairs.items()}
    return SourceSkeleton("100style", frozenset({"Chest4", "LeftAnkle"}), joints, has_toe_rotation=False)


_CREDIT = "The 100STYLE Dataset - Ian Mason (CC BY 4.0)"
RECORD = DataSet(
    name="100style",
    credit=_CREDIT,
    clips=_list_100style,
    skeletons=(_style100(),),
    long_takes=True,
    has_tpose=True,
    head_lift_degrees={"100style": 16.0},
)
# one more style, imported as the others: the same capture
MORE = DataSet(name="100style_more", credit=_CREDIT, clips=_list_100style, skeletons=())
