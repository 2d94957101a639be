"""Bandai Namco Research Motiondataset: twenty styles of walking, running and turning, and gestures."""

from __future__ import annotations

from pathlib import Path

from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import SIDES, SourceJoint, SourceSkeleton

_BANDAI_1_STYLES = {
    "normal": "neutral_bn", "happy": "happy", "sad": "sad", "angry": "angry_bn", "proud": "proud",
    "not-confident": "not_confident", "masculinity": "masculine", "feminine": "feminine", "childish": "childish",
    "old": "old", "tired": "tired", "active": "active", "musical": "musical",
}  # fmt: skip
_BANDAI_2_STYLES = {
    "active": "active2", "elderly": "elderly", "exhausted": "exhausted", "feminine": "feminine2",
    "masculine": "masculine2", "normal": "neutral_bn2", "youthful": "youthful",
}  # fmt: skip
_BANDAI_CONTENT = {
    "walk": "walk forward", "run": "run forward", "dash": "dash forward", "walk-back": "walk backward",
    "walk-left": "walk left", "walk-right": "walk right", "walk-turn-left": "walk turn left",
    "walk-turn-right": "walk turn right",
}  # fmt: skip
_GESTURES = {
    f"{verb}-{hand}": f"{short}_{hand.replace('-', '_')}"
    for verb, short in (("wave", "wave"), ("raise-up", "raise"))
    for hand in ("left-hand", "right-hand", "both-hands")
}
_GESTURE_PERFORMERS = ("normal", "active", "youthful")
GESTURE_CLIPS = 12  # per gesture: standing still needs few examples


def _list_bandai(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    gestures: dict[tuple[str, str], list[Path]] = {}
    for path in sorted(folder.rglob("*.bvh")):
        dataset, content, performer, _ = path.stem.split("_")
        styles = _BANDAI_1_STYLES if dataset == "dataset-1" else _BANDAI_2_STYLES
        name = _bandai_name(path)
        if content in _GESTURES and performer in _GESTURE_PERFORMERS:
            gestures.setdefault((content, performer), []).append(path)
        elif content in _GESTURES:
            refused.append(Refusal(name, "bandai_namco", "gesture of another performer"))
        elif content in _BANDAI_CONTENT:
            clips.append(_clip(path, styles[performer], _BANDAI_CONTENT[content]))
        else:
            refused.append(Refusal(name, "bandai_namco", f"not locomotion: {content}"))
    for (content, _), paths in gestures.items():
        paths.sort(key=lambda p: (-p.stat().st_size, p.name))  # the longest
        style, wanted = _GESTURES[content], GESTURE_CLIPS // len(_GESTURE_PERFORMERS)
        for path in paths[:wanted]:
            clips.append(_clip(path, style, style.replace("_", " ")))
        for path in paths[wanted:]:
            refused.append(
                Refusal(
                    _bandai_name(path), "bandai_namco", f"more than {GESTURE_CLIPS} clips of this gesture"
                )
            )
    return clips, refused


def _clip(path: Path, style: str, content: str) -> ClipSource:
    name = _bandai_name(path)
    return ClipSource(path, name, "bandai_namco", style, content, capture=name.split("_")[0])


def _bandai_name(path: Path) -> str:
    dataset, content, rest = path.stem.split("_", 2)
    return f"bandai{dataset[-1]}_{content}_{rest}"


def _bandai() -> SourceSkeleton:
    trunk = "+Y +Z +X"
    joints = {
        "Hips": SourceJoint("Hips", axes="+Y -X +Z"),
        "Spine": SourceJoint("Spine", axes=trunk),
        "Spine1": SourceJoint("Chest", axes=trunk),
        "Neck1": SourceJoint("Neck", axes=trunk),
        "Head": SourceJoint("Head", axes=trunk),
    }
    arm = {"Left": "+X +Y +Z", "Right": "+X -Y -Z"}
    leg = {"Left": "-Y +X +Z", "Right": "+Y +X -Z"}
    foot = {"Left": "+Z +X +Y", "Right": "-Z +X -Y"}
    for side in SIDES:
        end = "_" + side[0]
        names = {"Shoulder": "Shoulder", "Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand"}
        joints |= {side + o: SourceJoint(t + end, axes=arm[side]) for o, t in names.items()}
        names = {"UpLeg": "UpperLeg", "Leg": "LowerLeg"}
        joints |= {side + o: SourceJoint(t + end, axes=leg[side]) for o, t in names.items()}
        names = {"Foot": "Foot", "ToeBase": "Toes"}
        joints |= {side + o: SourceJoint(t + end, axes=foot[side]) for o, t in names.items()}
    return SourceSkeleton("bandai_namco", frozenset({"joint_Root", "UpperArm_L"}), joints)


RECORD = DataSet(
    name="bandai_namco",
    credit="Bandai Namco Research Motiondataset (CC BY-NC 4.0)",
    clips=_list_bandai,
    skeletons=(_bandai(),),
    free=False,
    head_lift_degrees={"bandai2": 7.0},
)
