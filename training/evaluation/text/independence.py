"""Part independence: when the words of one body part change, how much do the others change with it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.skeleton import PART_NAMES, SPORT_SKELETON
from training.evaluation.text.part_edits import Case
from training.evaluation.text.walks import Summary, rotation_change

Array = NDArray[np.floating]

BAR = 0.25  # of the part's own change

_AT = SPORT_SKELETON.index
# joints that turn; fingers, and hip joints and neck bases without freedom of their own, would only dilute the means
JOINTS: dict[str, tuple[int, ...]] = {
    "left_arm": tuple(map(_AT, ("LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand"))),
    "right_arm": tuple(map(_AT, ("RightShoulder", "RightArm", "RightForeArm", "RightHand"))),
    "left_leg": tuple(map(_AT, ("LeftUpLeg", "LeftLeg", "LeftFoot"))),
    "right_leg": tuple(map(_AT, ("RightUpLeg", "RightLeg", "RightFoot"))),
    "torso": tuple(map(_AT, ("Hips", "LowerBack", "Spine", "Spine1"))),
    "head": tuple(map(_AT, ("Neck", "Neck1", "Head"))),
}


RHYTHM = "rhythm"  # slot of edits of rhythm and weight


def part_changes(before: Summary, after: Summary) -> dict[str, float]:
    """Degrees by which the joints of each part move differently, their mean."""
    change = np.degrees(rotation_change(before, after))
    return {part: float(change[list(joints)].mean()) for part, joints in JOINTS.items()}


def own_and_others(changes: dict[str, float], parts: Sequence[str]) -> tuple[float, float, float]:
    """Mean over the joints of the described parts, over all other joints, and of the other part that changes most.

    Degrees. One other part of five can follow whole, and the mean over all joints of the others would hide it.
    """

    def mean(names: list[str]) -> float:
        sizes = [len(JOINTS[n]) for n in names]
        return float(np.average([changes[n] for n in names], weights=sizes))

    others = [p for p in PART_NAMES if p not in parts]
    return mean(list(parts)), mean(others), max(changes[p] for p in others)


def independence(
    case: Case,
    summaries: Sequence[Summary],
    neutral: dict[int, Summary],
    reference: Sequence[tuple[Summary, Summary]],
) -> dict[str, Any]:
    """A case's changes against the neutral walk of the same seed, and what the edit itself does on captured walks."""
    walks = [part_changes(neutral[seed], s) for s, seed in zip(summaries, case.seeds, strict=True)]
    edits = [part_changes(before, after) for before, after in reference]
    seed_own, seed_others, _ = own_and_others(seed_changes(neutral), case.parts)
    own, others, most = np.mean([own_and_others(w, case.parts) for w in walks], axis=0)
    edit_own, edit_others, edit_most = np.mean([own_and_others(e, case.parts) for e in edits], axis=0)
    return {
        "name": case.name,
        "kind": case.kind,
        "slot": RHYTHM if "rhythm" in case.kind else case.edits[0].split(".")[0],
        "own": float(own),
        "others": float(others),
        "most": float(most),
        "edit_own": float(edit_own),
        "edit_others": float(edit_others),
        "edit_most": float(edit_most),
        "seed_own": seed_own,
        "seed_others": seed_others,
        "parts": {p: float(np.mean([w[p] for w in walks])) for p in PART_NAMES},
    }


def by_slot(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Of each slot and of "all": mean changes, their ratio, the edits' own ratio, and how many edits keep the bar.

    Rhythm has a row of its own, which "all" does not count: another step changes what every part does in it.
    """
    slots = [*dict.fromkeys(r["slot"] for r in rows), "all"]
    found = {s: [r for r in rows if r["slot"] == s or (s == "all" and r["slot"] != RHYTHM)] for s in slots}
    return {slot: _summary(own) for slot, own in found.items() if own}


def _summary(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    mean = {k: float(np.mean([r[k] for r in rows])) for k in rows[0] if isinstance(rows[0][k], float)}
    own, edit_own = mean["own"] or float("nan"), mean["edit_own"] or float("nan")
    return {
        "edits": len(rows),
        **mean,
        "ratio": mean["others"] / own,
        "most_ratio": mean["most"] / own,
        "edit_ratio": mean["edit_others"] / edit_own,
        "edit_most_ratio": mean["edit_most"] / edit_own,
        "within": float(np.mean([r["own"] > 0.0 and r["others"] <= BAR * r["own"] for r in rows])),
    }


def seed_changes(neutral: dict[int, Summary]) -> dict[str, float]:
    """Degrees of each part between neutral walks of two seeds, mean over the pairs: what comes without any word."""
    pairs = list(combinations(neutral.values(), 2))
    found = [part_changes(a, b) for a, b in pairs]
    return {part: float(np.mean([f[part] for f in found])) if found else 0.0 for part in PART_NAMES}
