"""Open 3D Engine's motion-matching takes: neutral locomotion, crouching, jumps onto a platform."""

from __future__ import annotations

from pathlib import Path

from training.data.record import ClipSource, DataSet, Refusal
from training.data.source_skeletons import SourceSkeleton, same_limbs, same_rest

_O3DE_CONTENT = {
    "Crouching": "crouched walk", "Jumps": "mixed walk jog jump onto a platform", "Run": "run forward",
    "RunPivotTurn": "run turns", "Jog": "jog forward", "JogPivotTurn": "jog turns", "Walk": "walk forward",
}  # fmt: skip
_O3DE_REFUSED = {"Pushes": "pushed by somebody: no movement that one asks for"}


def _list_o3de(folder: Path) -> tuple[list[ClipSource], list[Refusal]]:
    clips: list[ClipSource] = []
    refused: list[Refusal] = []
    for path in sorted(folder.glob("*.bvh")):
        take = path.stem.rstrip("0123456789")
        name = f"o3de_{path.stem}"
        if take in _O3DE_REFUSED:
            refused.append(Refusal(name, "o3de", _O3DE_REFUSED[take]))
            continue
        content = _O3DE_CONTENT.get(take, f"mixed walk jog: {take}")
        terrain = "contacts" if take == "Jumps" else "flat"
        clips.append(ClipSource(path, name, "o3de", "neutral", content, terrain=terrain))
    return clips, refused


def _o3de() -> SourceSkeleton:
    joints = same_rest(
        Hips="Hips", LowerBack="Spine1", Spine="Spine2", Spine1="Spine3", Neck1="Neck", Head="Head"
    )
    joints |= same_limbs()
    return SourceSkeleton(
        "o3de", frozenset({"Spine3", "Neck1", "LeftToeBase"}), joints, has_toe_rotation=False
    )


RECORD = DataSet(
    name="o3de",
    credit="Copyright (c) Contributors to the Open 3D Engine Project (Apache-2.0 or MIT)",
    clips=_list_o3de,
    skeletons=(_o3de(),),
    long_takes=True,
    head_lift_degrees={"o3de": 10.0},
)
