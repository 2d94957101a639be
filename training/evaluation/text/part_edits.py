"""Part edits asked for by words: does the measured motion change in the described way, and by how much of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import FileError
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import PART_NAMES
from training.evaluation.text.walks import Summary, summarise
from training.layering.apply import apply
from training.layering.catalog import EDITS, HELD_OUT, HELD_OUT_PAIRS
from training.layering.pool import load_source
from training.layering.pose_edits import Motion
from training.layering.recombine import cut

Target = tuple[str, str]  # part, field of its measures

RIGHT_WAY, ENOUGH = 0.1, 0.5  # shares of the described change; under a tenth is no change
RIGHT_BAR, ENOUGH_BAR = 0.8, 0.5  # shares of the held-out edits and pairs
RHYTHM_RIGHT_BAR, RHYTHM_ENOUGH_BAR = 0.9, 0.7  # of those of rhythm and weight
HELD_OUT_RHYTHM, TRAINED_RHYTHM = "held-out rhythm", "trained rhythm"
SEEDS = 3
REFERENCE_WALKS = 3  # captured neutral walks of each data set
MIN_FRAMES, MAX_FRAMES = 240, 480
_WALKING = ("walk", "walk forward")
# Measures where the catalogue's own goes up on one captured walk and down on another: a fist that punches moves
# forward and back as far as a swinging arm, but it does so high and in front of the chest.
_SHOWN_BY = {"punching": ("hand_level", "hand_front")}
_AGREEMENT = (
    0.75  # share of the captured walks on which an edit moves its measure the same way; else it shows nothing
)


@dataclass(frozen=True)
class Case:
    """What is asked for: `variants` are descriptions that all ask for `edits`."""

    name: str
    kind: str  # "held out", "pair", "trained", "held-out rhythm", "trained rhythm" or "free words"
    edits: tuple[str, ...]
    variants: tuple[PartDescriptions, ...]
    seeds: tuple[int, ...]  # of each variant's walk

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts that the edits describe."""
        described = {part for name in self.edits for part in EDITS[name].phrases}
        return tuple(p for p in PART_NAMES if p in described)


def targets(edits: Iterable[str]) -> list[Target]:
    """The measures that show the edits; what both legs do is measured on both."""
    found = []
    for name in edits:
        edit = EDITS[name]
        part, field = edit.measure
        found += [(part, f) for f in _SHOWN_BY.get(name.split(".")[1], (field,))]
        if edit.slot == "legs":
            found.append((part.replace("left", "right"), field))
    return found


def value(summary: Summary, target: Target) -> float:
    """A measure of a motion."""
    return float(getattr(getattr(summary.body, target[0]), target[1]))


# --- what is asked for ------------------------------------------------------------------------------------------------


def catalogue_cases(neutral: PartDescriptions, trained: bool = True) -> list[Case]:
    """Held-out edits and pairs with every phrase, at least three walks each; trained edits with their first phrase."""
    cases = [_case(name, _kind(name), (name,), neutral, SEEDS) for name in EDITS if name in HELD_OUT]
    cases += [_case(name, "pair", pair, neutral, SEEDS) for name, pair in HELD_OUT_PAIRS.items()]
    if trained:
        cases += [_case(name, _kind(name), (name,), neutral, 1) for name in EDITS if name not in HELD_OUT]
    return cases


def _kind(name: str) -> str:
    rhythm = EDITS[name].rhythm
    if name in HELD_OUT:
        return HELD_OUT_RHYTHM if rhythm else "held out"
    return TRAINED_RHYTHM if rhythm else "trained"


def _case(name: str, kind: str, edits: tuple[str, ...], neutral: PartDescriptions, least: int) -> Case:
    """Variant k takes the k-th phrase of every part; phrases count round where an edit has fewer."""
    phrases = {part: texts for e in edits for part, texts in EDITS[e].phrases.items()}
    count = 1 if kind in ("trained", TRAINED_RHYTHM) else max(least, *(len(t) for t in phrases.values()))
    variants = []
    for k in range(count):
        words = neutral
        for part, texts in phrases.items():
            words = words.replace(part, texts[k % len(texts)])
        variants.append(words)
    return Case(name, kind, edits, tuple(variants), tuple(k % SEEDS for k in range(count)))


def free_case(prompt: str, edits: tuple[str, ...], expanded: PartDescriptions, walks: int = 2) -> Case:
    """A free prompt as it was expanded, with `walks` seeds."""
    return Case(prompt, "free words", edits, (expanded,) * walks, tuple(range(walks)))


# --- what the words describe ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reference:
    """Captured neutral walks and the same walks edited: what an edit is worth on real motion."""

    walks: list[tuple[str, Motion, Summary]]

    def edited(self, edits: Sequence[str]) -> list[tuple[Summary, Summary]]:
        """Each walk before and after the edits, which are varied as in training but always alike."""
        pairs = []
        for number, (_, motion, plain) in enumerate(self.walks):
            random = np.random.default_rng([number, *"+".join(edits).encode()])
            changed = motion
            for name in edits:
                changed = apply(changed, EDITS[name], random)
            pairs.append((plain, summarise(changed.hips, changed.local, changed.contacts)))
        return pairs

    def described(
        self, pairs: Sequence[tuple[Summary, Summary]], edits: Sequence[str]
    ) -> dict[Target, float]:
        """Median change of the measures that show the edits; empty when walks disagree on its direction."""
        found = {}
        for target in targets(edits):
            changes = [value(after, target) - value(before, target) for before, after in pairs]
            found[target] = float(np.median(changes))
            if np.mean(np.sign(changes) == np.sign(found[target])) < _AGREEMENT:
                return {}
        return found


def load_reference(clips: Path) -> Reference:
    """Neutral straight walks of every data set, unmirrored and on their own ground; FileError when there is none."""
    walks: list[tuple[str, Motion, Summary]] = []
    taken: dict[str, int] = {}
    for path in sorted(clips.glob("*.npz")):
        dataset = path.stem.split("_")[0]
        if path.stem.startswith("layer_") or path.stem.endswith(("_m", "_t")):
            continue
        if taken.get(dataset, 0) >= REFERENCE_WALKS or not _is_neutral_walk(path):
            continue
        source = load_source(path)
        length = len(source.gait)
        if length < MIN_FRAMES:
            continue
        first = max(0, (length - MAX_FRAMES) // 2)
        motion = cut(source.motion, first, min(first + MAX_FRAMES, length))
        walks.append((path.stem, motion, summarise(motion.hips, motion.local, motion.contacts)))
        taken[dataset] = taken.get(dataset, 0) + 1
    if not walks:
        raise FileError(
            f"{clips}: no captured neutral walk.", "Run `sport train import --data DIR --out DIR`."
        )
    return Reference(walks)


def _is_neutral_walk(path: Path) -> bool:
    with np.load(path, allow_pickle=False) as clip:
        return str(clip["style"]).startswith("neutral") and str(clip["content"]) in _WALKING


# --- what came of it --------------------------------------------------------------------------------------------------


def score(
    case: Case, summaries: Sequence[Summary], neutral: dict[int, Summary], described: dict[Target, float]
) -> dict[str, Any]:
    """A case's result: of each measure the median share of the described change, and whether all of them suffice.

    `summaries` are the walks of the variants, `neutral` the neutral walks by seed.
    """
    shares: dict[str, list[float]] = {}
    changes: dict[str, float] = {}
    for target, amount in described.items():
        found = [
            value(s, target) - value(neutral[seed], target)
            for s, seed in zip(summaries, case.seeds, strict=True)
        ]
        label = ".".join(target)
        changes[label] = float(np.median(found))
        shares[label] = [f / amount for f in found]
    median = {k: float(np.median(v)) for k, v in shares.items()}
    worst = min(median.values())
    runs = np.min(list(shares.values()), axis=0)
    return {
        "name": case.name,
        "kind": case.kind,
        "edits": list(case.edits),
        "described": {".".join(t): v for t, v in described.items()},
        "change": changes,
        "share": median,
        "worst_share": worst,
        "right_way": bool(worst >= RIGHT_WAY),
        "enough": bool(worst >= ENOUGH),
        "runs": len(summaries),
        "runs_right_way": float((runs >= RIGHT_WAY).mean()),
        "runs_enough": float((runs >= ENOUGH).mean()),
        "words": {part: getattr(case.variants[0], part) for part in case.parts},
    }


def seed_noise(neutral: dict[int, Summary], described: dict[Target, float]) -> float:
    """How much neutral walks of different seeds differ, at most, as a share of the described change."""
    noise = []
    for target, amount in described.items():
        values = [value(s, target) for s in neutral.values()]
        noise.append((max(values) - min(values)) / abs(amount))
    return float(np.max(noise))


def shares(results: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Of several cases: how many go the right way and far enough, and their median share of the described change."""
    return {
        "cases": len(results),
        "right_way": float(np.mean([r["right_way"] for r in results])),
        "enough": float(np.mean([r["enough"] for r in results])),
        "median_share": float(np.median([r["worst_share"] for r in results])),
        "runs_right_way": float(np.mean([r["runs_right_way"] for r in results])),
        "runs_enough": float(np.mean([r["runs_enough"] for r in results])),
    }
