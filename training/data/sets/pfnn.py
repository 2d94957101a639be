"""Holden et al. 2017: two captured takes, and rollouts of the published network on terrain."""

from __future__ import annotations

from pathlib import Path

from runtime.skeleton import SPORT_SKELETON
from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import SIDES, SourceJoint, SourceSkeleton


def _list_pfnn(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips = [
        ClipSource(p, f"pfnn_{p.stem}", "pfnn", "neutral_rough", "mixed locomotion")
        for p in sorted(folder.glob("*.bvh"))
    ]
    return clips, []


def _list_rollouts(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips = [
        ClipSource(
            p,
            f"rollout_{p.stem}",
            "pfnn_rollouts",
            "neutral_rough",
            "mixed locomotion on terrain",
            terrain="rollout",
        )
        for p in sorted(folder.glob("*.bvh"))
    ]
    return clips, []


def _pfnn() -> SourceSkeleton:
    same = [n for n in SPORT_SKELETON.names if not n.startswith(("LeftUpLeg", "RightUpLeg"))]
    joints = {name: SourceJoint(name) for name in same}
    for side in SIDES:
        joints[side + "UpLeg"] = SourceJoint(side + "UpLeg", along=side + "Leg")
        joints[side + "Leg"] = SourceJoint(side + "Leg", along=side + "Foot")
    return SourceSkeleton("pfnn", frozenset({"LHipJoint", "LowerBack"}), joints)


RECORD = DataSet(
    name="pfnn",
    credit="Holden et al. 2017, Phase-Functioned Neural Networks (academic, non-commercial)",
    clips=_list_pfnn,
    skeletons=(_pfnn(),),
    free=False,
    head_lift_degrees={"pfnn": 20.0},
)
ROLLOUTS = DataSet(
    name="pfnn_rollouts",
    credit="Rollouts of the published PFNN, Holden et al. 2017 (academic, non-commercial)",
    clips=_list_rollouts,
    skeletons=(),  # that of pfnn
    free=False,
    metres_per_unit=0.01,  # its terrain is in centimetres
)
