"""Conventions of the target programs: unit, root joint, and humanoid bone names."""

from collections.abc import Mapping
from dataclasses import dataclass

from runtime.errors import UsageError


@dataclass(frozen=True)
class Engine:
    """An engine or program: the unit of its FBX files, whether it expects a root joint on the ground, and its joint names."""

    name: str
    fbx_unit: str  # "cm" or "m"
    ground_root: bool
    bones: Mapping[str, str]  # by SPORT joint; `Root` is the joint on the ground


def _sided(names: Mapping[str, str], left: str, right: str) -> dict[str, str]:
    """Return the names of both sides; `{}` stands for the side, in ours ("Left") and in theirs."""
    sided = {}
    for ours, theirs in names.items():
        for our_side, their_side in (("Left", left), ("Right", right)):
            sided[ours.format(our_side)] = theirs.format(their_side)
    return sided


_UNREAL = {
    "Root": "root", "Hips": "pelvis", "LowerBack": "spine_01", "Spine": "spine_02", "Spine1": "spine_03",
    "Neck": "neck_01", "Neck1": "neck_02", "Head": "head",
    **_sided(
        {"{}UpLeg": "thigh_{}", "{}Leg": "calf_{}", "{}Foot": "foot_{}", "{}ToeBase": "ball_{}",
         "{}Shoulder": "clavicle_{}", "{}Arm": "upperarm_{}", "{}ForeArm": "lowerarm_{}", "{}Hand": "hand_{}"},
        "l", "r",
    ),
}  # fmt: skip
_HUMANOID = {  # the names of Unity's Humanoid and of Godot's SkeletonProfileHumanoid
    "Root": "Root", "Hips": "Hips", "LowerBack": "Spine", "Spine": "Chest", "Spine1": "UpperChest",
    "Neck": "Neck", "Head": "Head",
    **_sided(
        {"{}UpLeg": "{}UpperLeg", "{}Leg": "{}LowerLeg", "{}Foot": "{}Foot", "{}ToeBase": "{}Toes",
         "{}Shoulder": "{}Shoulder", "{}Arm": "{}UpperArm", "{}ForeArm": "{}LowerArm", "{}Hand": "{}Hand"},
        "Left", "Right",
    ),
}  # fmt: skip
_HUMAN_IK = {  # Maya's HumanIK
    "Root": "Reference", "Hips": "Hips", "LowerBack": "Spine", "Spine": "Spine1", "Spine1": "Spine2",
    "Neck": "Neck", "Head": "Head",
    **_sided(
        {f"{{}}{part}": f"{{}}{part}" for part in
         ("UpLeg", "Leg", "Foot", "ToeBase", "Shoulder", "Arm", "ForeArm", "Hand")},
        "Left", "Right",
    ),
}  # fmt: skip
_TABLE = (
    Engine("unreal", "cm", True, _UNREAL),
    Engine("unity", "m", True, _HUMANOID),
    Engine("godot", "m", True, _HUMANOID),
    Engine("maya", "cm", False, _HUMAN_IK),
    Engine("blender", "m", False, {}),
)
ENGINES = {engine.name: engine for engine in _TABLE}


def engine_of(name: str) -> Engine:
    """Return the engine with this name; UsageError lists the known names."""
    if name not in ENGINES:
        raise UsageError(f" {name[:40]}: unknown.", f"Choose {', '.join(ENGINES)}.", "engine")
    return ENGINES[name]
