"""Part edits by words: direction and amount of the change of motion, and unwanted changes of other parts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES, SPORT_SKELETON
from training.augmentation.catalogue import catalogue, part_edits
from training.augmentation.measured_edits import Summary, Target, rotation_change, value

# of the described change; less than a tenth is no change
RIGHT_WAY_FRACTION, ENOUGH_FRACTION = 0.1, 0.5
MIN_RIGHT_WAY_FRACTION, MIN_ENOUGH_FRACTION = 0.8, 0.5  # of held-out edits and pairs
MIN_RHYTHM_RIGHT_WAY_FRACTION, MIN_RHYTHM_ENOUGH_FRACTION = 0.9, 0.7  # of edits of rhythm and weight
HELD_OUT_RHYTHM, TRAINED_RHYTHM = "held-out rhythm", "trained rhythm"
SEEDS = 3
DATA = Path(__file__).parent / "data"


@dataclass(frozen=True)
class Case:
    """A request: `variants` are descriptions that all request `edits`."""

    name: str
    kind: str  # "held out", "pair", "trained", "held-out rhythm", "trained rhythm" or "free words"
    edits: tuple[str, ...]
    variants: tuple[PartDescriptions, ...]
    seeds: tuple[int, ...]  # of the walk of each variant

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts that the edits describe."""
        described = {part for name in self.edits for part in part_edits()[name].phrases}
        return tuple(p for p in PART_NAMES if p in described)


# --- requests ---------------------------------------------------------------------------------------------------------


def catalogue_cases(neutral: PartDescriptions, trained: bool = True) -> list[Case]:
    """Return cases of held-out edits and pairs with all phrases, at least three walks; trained edits with their first."""
    every = {name: (name,) for name in part_edits()}
    held_out = {name: edits for name, edits in every.items() if name in catalogue().held_out}
    requested = held_out | catalogue().held_out_pairs | (every if trained else {})
    return [_case(name, edits, neutral) for name, edits in requested.items()]


def _kind(edits: Sequence[str]) -> str:
    if len(edits) > 1:
        return "pair"
    rhythm = part_edits()[edits[0]].rhythm
    if edits[0] in catalogue().held_out:
        return HELD_OUT_RHYTHM if rhythm else "held out"
    return TRAINED_RHYTHM if rhythm else "trained"


def _case(name: str, edits: tuple[str, ...], neutral: PartDescriptions) -> Case:
    """Make a case whose variant k has the k-th phrase of every part, modulo their number."""
    kind = _kind(edits)
    phrases = {part: texts for e in edits for part, texts in part_edits()[e].phrases.items()}
    count = 1 if kind in ("trained", TRAINED_RHYTHM) else max(SEEDS, *(len(t) for t in phrases.values()))
    variants = tuple(phrased(neutral, phrases, k) for k in range(count))
    return Case(name, kind, edits, variants, tuple(k % SEEDS for k in range(count)))


def phrased(neutral: PartDescriptions, phrases: Mapping[str, Sequence[str]], k: int) -> PartDescriptions:
    """Return `neutral` with the k-th phrase of every part."""
    for part, texts in phrases.items():
        neutral = neutral.replace(part, texts[k % len(texts)])
    return neutral


def free_prompts() -> dict[str, tuple[str, ...]]:
    """Read free prompts, with the edits whose measures show whether they were followed."""
    lines = (DATA / "free_prompts.txt").read_text("utf-8").splitlines()
    return {prompt: tuple(names) for prompt, *names in (line.split(" | ") for line in lines[1:])}


# --- results ----------------------------------------------------------------------------------------------------------


def score(
    case: Case, summaries: Sequence[Summary], neutral: dict[int, Summary], described: dict[Target, float]
) -> dict[str, Any]:
    """Score a case: median fraction of the described change of each measure, and whether all are sufficient.

    `summaries` are the walks of the variants, `neutral` the neutral walks by seed.
    """
    fractions, changes = {}, {}
    for target, amount in described.items():
        walks = zip(summaries, case.seeds, strict=True)
        found = np.array([value(s, target) - value(neutral[seed], target) for s, seed in walks])
        changes[".".join(target)] = float(np.median(found))
        fractions[".".join(target)] = found / amount
    median = {k: float(np.median(v)) for k, v in fractions.items()}
    worst = min(median.values())
    runs = np.min(list(fractions.values()), axis=0)
    return {
        "name": case.name,
        "kind": case.kind,
        "edits": list(case.edits),
        "described": {".".join(t): v for t, v in described.items()},
        "change": changes,
        "fraction": median,
        "worst_fraction": worst,
        "right_way": bool(worst >= RIGHT_WAY_FRACTION),
        "enough": bool(worst >= ENOUGH_FRACTION),
        "runs_right_way": float((runs >= RIGHT_WAY_FRACTION).mean()),
        "runs_enough": float((runs >= ENOUGH_FRACTION).mean()),
    }


def totals(results: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return the fractions of cases with right direction and sufficient amount, and the median fraction of change."""
    means = ("right_way", "enough", "runs_right_way", "runs_enough")
    return {
        "cases": len(results),
        "median_fraction": float(np.median([r["worst_fraction"] for r in results])),
        **{name: float(np.mean([r[name] for r in results])) for name in means},
    }


MAX_OTHERS_FRACTION = 0.25  # of the part's own change

_AT = SPORT_SKELETON.index
# rotating joints; fingers, and hip joints and neck bases without own degrees of freedom, would dilute the means
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
    """Return the mean change of joint motion of each part, degrees."""
    change = np.degrees(rotation_change(before, after))
    return {part: float(change[list(joints)].mean()) for part, joints in JOINTS.items()}


def own_and_others(changes: dict[str, float], parts: Sequence[str]) -> tuple[float, float, float]:
    """Return the mean change of the described parts, of all other joints, and of the other part that changes most, degrees.

    The last shows a single other part that changes fully, which the mean over all other joints would hide.
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
    """Return a case's changes relative to the neutral walk of the same seed, and those of the edit on captured walks."""
    walks = [part_changes(neutral[seed], s) for s, seed in zip(summaries, case.seeds, strict=True)]
    row: dict[str, Any] = {
        "name": case.name,
        "kind": case.kind,
        "slot": RHYTHM if "rhythm" in case.kind else case.edits[0].split(".")[0],
        "parts": {p: float(np.mean([w[p] for w in walks])) for p in PART_NAMES},
    }
    edits = [part_changes(before, after) for before, after in reference]
    for prefix, changes in (("", walks), ("edit_", edits), ("seed_", [seed_changes(neutral)])):
        means = np.mean([own_and_others(c, case.parts) for c in changes], axis=0)
        row |= {prefix + name: float(v) for name, v in zip(("own", "others", "most"), means, strict=True)}
    return row


def by_slot(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return mean changes per slot and of "all", their ratio, the ratio of the edits, and how many edits meet the limit.

    Rhythm has a separate row and is not part of "all", because another step changes the motion of every part.
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
        "within": float(
            np.mean([r["own"] > 0.0 and r["others"] <= MAX_OTHERS_FRACTION * r["own"] for r in rows])
        ),
    }


def seed_changes(neutral: dict[int, Summary]) -> dict[str, float]:
    """Return the change of each part between neutral walks of two seeds, degrees, mean over pairs: the baseline."""
    pairs = list(combinations(neutral.values(), 2))
    found = [part_changes(a, b) for a, b in pairs]
    return {part: float(np.mean([f[part] for f in found])) if found else 0.0 for part in PART_NAMES}
