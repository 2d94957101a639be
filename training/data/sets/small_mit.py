"""Idles and loops: ProAnimationBank (arms crossed, a twitching stand, cycles), AnimatedDrawings (a wave, a dab)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.formats.bvh import BvhMotion, read_bvh
from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import LIMBS, SIDES, SourceJoint, SourceSkeleton, same_rest

_SHOWN = {
    "crackhead": ("twitching", "idle"),
    "wave_hello": ("wave_right_hand", "wave right hand"),
}
_ON_THE_SPOT = "a cycle on the spot: its feet slide"
_REFUSED = {
    "dab": "a gesture that no words ask for",
    "crossarms": "shows arms crossed, which training holds out",
} | dict.fromkeys(("walk", "jog", "run"), _ON_THE_SPOT)
_OF_DRAWINGS = ("wave_hello", "dab")  # their skeleton is that of fair_zombie


_WORDS = (
    {
        "left_arm": "left arm bent, twitching and fidgeting",
        "right_arm": "right arm bent, twitching and fidgeting",
        "left_leg": "left leg standing restlessly, knee bent",
        "right_leg": "right leg standing restlessly, knee bent",
        "torso": "torso hunched, jerking and swaying",
        "head": "head twitching, looking about",
    },
    {
        "left_arm": "left hand fidgeting before the body",
        "right_arm": "right hand fidgeting before the body",
        "left_leg": "left leg shifting nervously on the spot",
        "right_leg": "right leg shifting nervously on the spot",
        "torso": "torso bent over, swaying restlessly",
        "head": "head jerking from side to side",
    },
    {
        "left_arm": "left arm jerking nervously",
        "right_arm": "right arm jerking nervously",
        "left_leg": "left leg standing with a bent knee, trembling",
        "right_leg": "right leg standing with a bent knee, trembling",
        "torso": "torso stooped, twitching",
        "head": "head bobbing nervously",
    },
    {
        "left_arm": "left arm restless, elbow bent",
        "right_arm": "right arm restless, elbow bent",
        "left_leg": "left leg bouncing a little on the spot",
        "right_leg": "right leg bouncing a little on the spot",
        "torso": "torso slouched, moving restlessly",
        "head": "head unsteady, turning in small jerks",
    },
)


def _list(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for path in sorted(folder.glob("*.bvh")):
        name = f"small_{path.stem}"
        if path.stem in _SHOWN:
            capture = "fair_zombie" if path.stem in _OF_DRAWINGS else "small_mit"
            clips.append(ClipSource(path, name, "small_mit", *_SHOWN[path.stem], capture=capture))
        else:
            refused.append(Refusal(name, "small_mit", _REFUSED.get(path.stem, "unknown take")))
    return clips, refused


def read_z_up(path: Path) -> BvhMotion:
    """A take whose Z is up, turned so that Y is."""
    motion = read_bvh(path)
    upright = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(-0.5 * np.pi))
    positions, local = motion.positions.copy(), motion.local_rotations.copy()
    positions[:, 0] = rotations.rotate(upright, positions[:, 0])
    local[:, 0] = rotations.multiply(np.broadcast_to(upright, local[:, 0].shape), local[:, 0])
    return replace(motion, positions=positions, local_rotations=local)


def _biped() -> SourceSkeleton:
    names = {"Hips": "Pelvis", "LowerBack": "Spine1", "Spine": "Spine2", "Spine1": "Spine3", "Neck1": "Neck"}
    joints = same_rest(**names, Head="Head")
    for side in SIDES:
        joints |= {side + limb: SourceJoint(side + limb) for limb in LIMBS if limb != "ToeBase"}
        joints[side + "ToeBase"] = SourceJoint(side + "FootThumb1")
    joints["LeftHand"] = SourceJoint("Lefthand")  # as the files spell it
    return SourceSkeleton(
        "biped", frozenset({"Lefthand", "LeftFootThumb1"}), joints, has_toe_rotation=False, reference=""
    )


RECORD = DataSet(
    name="small_mit",
    credit="ProAnimationBank (MIT); waving: Copyright (c) Meta Platforms, Inc. and affiliates (MIT)",
    clips=_list,
    skeletons=(_biped(),),
    read=read_z_up,
    descriptions={"twitching": _WORDS},
    references={"small_mit": "crossarms.bvh"},
)
