"""A zombie's walk and jumps on the spot, from Meta's AnimatedDrawings."""

from __future__ import annotations

from pathlib import Path

from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import LIMBS, SIDES, SourceJoint, SourceSkeleton


def _list_fair(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    shown = {"zombie": ("zombie", "walk forward"), "jumping": ("neutral", "jump on the spot")}
    paths = [p for p in sorted(folder.glob("*.bvh")) if p.stem in shown]
    return [ClipSource(p, f"fair_{p.stem}", "fair_zombie", *shown[p.stem]) for p in paths], []


def _fair() -> SourceSkeleton:
    axes = "+X -Z +Y"  # lies on its back: the file's Z is up, its -Y ahead
    names = {"Hips": "Hips", "LowerBack": "Spine1", "Spine": "Spine2", "Spine1": "Spine3", "Neck1": "Neck"}
    joints = {ours: SourceJoint(theirs, axes=axes) for ours, theirs in (names | {"Head": "Head"}).items()}
    joints |= {side + limb: SourceJoint(side + limb, axes=axes) for side in SIDES for limb in LIMBS}
    return SourceSkeleton(
        "fair", frozenset({"LeftHandThumb1", "LeftToeBase", "Spine3"}), joints, has_toe_rotation=False
    )


RECORD = DataSet(
    name="fair_zombie",
    credit="Zombie walk: Copyright (c) Meta Platforms, Inc. and affiliates (MIT)",
    clips=_list_fair,
    skeletons=(_fair(),),
)
