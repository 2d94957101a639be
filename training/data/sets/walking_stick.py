"""100STYLE's WalkingStickLeft run and walked backwards, as global joint transforms of a non-commercial repository."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from runtime import rotations
from runtime.formats.bvh import BvhMotion
from runtime.safe_read import open_npz
from runtime.skeleton import Skeleton
from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import SourceSkeleton, same_limbs, same_rest

_WORDS = (
    {
        "left_arm": "left arm holding a walking stick beside the body",
        "right_arm": "right arm hanging beside the body",
        "left_leg": "left leg stepping carefully beside the stick",
        "right_leg": "right leg stepping carefully, leaning on the stick",
        "torso": "torso bent slightly over the stick on the left",
        "head": "head bent slightly forward",
    },
    {
        "left_arm": "left hand on a stick, pressing down beside the hip",
        "right_arm": "right arm swinging a little",
        "left_leg": "left leg taking short careful steps",
        "right_leg": "right leg taking short careful steps",
        "torso": "torso leaning onto the stick",
        "head": "head lowered a little, watching the way",
    },
    {
        "left_arm": "left arm stretched down to a stick, elbow nearly straight",
        "right_arm": "right arm relaxed at the side",
        "left_leg": "left leg limping, relieved by the stick",
        "right_leg": "right leg carrying most of the weight",
        "torso": "torso stooped to the left",
        "head": "head forward, looking down",
    },
    {
        "left_arm": "left hand leaning on a cane",
        "right_arm": "right arm hanging loosely",
        "left_leg": "left leg stiff and careful",
        "right_leg": "right leg slow and careful",
        "torso": "torso bent forward a little, weight on the cane",
        "head": "head slightly bowed",
    },
)


def _list(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    style = "walking_stick"
    return [
        ClipSource(path, f"stick_{path.stem}", "walking_stick", style, "run backward")
        for path in sorted(folder.glob("*.npz"))
    ], []


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


def _transforms() -> SourceSkeleton:
    joints = same_rest(
        Hips="Hips", LowerBack="Spine1", Spine="Spine2", Spine1="Spine3", Neck1="Neck", Head="Head"
    )
    joints |= same_limbs()
    return SourceSkeleton("transforms", frozenset({"Spine3", "LeftToeBase"}), joints, has_toe_rotation=False)


RECORD = DataSet(
    name="walking_stick",
    credit="100STYLE WalkingStickLeft - Ian Mason, by way of a CC BY-NC repository (non-commercial)",
    clips=_list,
    skeletons=(_transforms(),),
    free=False,
    read=read_transforms,
    long_takes=True,
    descriptions={"walking_stick": _WORDS},
)
