"""Prompt adherence, measured by walking every phrase once: `assets/prompts/shares.json`, by `training.export.words`.

Every entry of the prompt library and every phrase of the edit catalogue is walked straight ahead on flat ground for some
seconds. A sentence of the catalogue is compared with the effect of its edit on the model's own neutral walk, any other
with its claims (`training.text.claims`).
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from runtime.arrays import Array
from runtime.measures.table import BodyMeasures
from runtime.motion.model import MotionModel
from runtime.prompts.library_data import LibraryStyle
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.phrasing import as_left_limb
from runtime.prompts.prompter import Prompter
from runtime.skeleton import PART_NAMES
from runtime.terrain.height_map import Terrain
from training.augmentation.catalogue import part_edits
from training.augmentation.edits import apply
from training.augmentation.measured_edits import Summary, summarise, targets, value
from training.augmentation.motion import EditedMotion
from training.evaluation import log
from training.evaluation.text.edits import phrased
from training.evaluation.text.walks import PLAIN_PROMPT, Walker, straight_walks
from training.frames import PLAIN
from training.text.claims import clause_fraction, clauses

PHRASE_S = 3.0  # walked and measured for each phrase
_HAND = ("hand_front", "hand_out", "hand_level")
_LEVEL_M = 0.45  # of one unit of hand_level
LIMB_DIFFERENCE_FRACTION = 0.15  # of a limb's fraction from that of both, for a separate entry
UNEVEN = ("neutral_rough",)  # neutral walks on uneven ground


@dataclass
class Found:
    """Measured fractions of sentences and clauses by (group, words), and of single limbs by (part, words), over all walks."""

    sentences: dict[tuple[str, str], list[float]] = field(default_factory=lambda: defaultdict(list))
    clauses: dict[tuple[str, str], list[float]] = field(default_factory=lambda: defaultdict(list))
    limbs: dict[tuple[str, str], list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, part: str, sentence: str, neutral: BodyMeasures, walked: BodyMeasures) -> None:
        """Add the fractions of a sentence and its clauses in a walk, from their claims."""
        fractions: list[tuple[float, bool]] = []
        for clause in clauses(as_left_limb(sentence, part)[1] if "_" in part else sentence.lower()):
            fraction = clause_fraction(part, clause, neutral, walked)
            if fraction is not None:
                fractions.append(fraction)
                self.clauses[as_left_limb(part, part)[0], clause].append(fraction[0])
        if fractions:
            # a sentence is meant to change what neutral does not already do
            shown = [f for f, changes in fractions if changes] or [f for f, _ in fractions]
            self.sentences[as_left_limb(sentence, part)].append(float(np.mean(shown)))

    def add_edit(self, part: str, phrase: str, fraction: float) -> None:
        """Add the fraction of a phrase of the catalogue in a walk."""
        group, words = as_left_limb(phrase, part)
        self.sentences[group, words].append(fraction)
        self.clauses[group, words].append(fraction)
        if group != part:
            self.limbs[part, words].append(fraction)

    def add_plain(self, styles: Mapping[str, LibraryStyle]) -> None:
        """Add fraction 1 for the sentences of plain walks, which request no change."""
        for name in sorted(styles):
            if name.startswith(PLAIN) and name not in UNEVEN:
                for words in styles[name].descriptions:
                    for part in PART_NAMES:
                        self.sentences[as_left_limb(getattr(words, part), part)] = [1.0]

    def table(self) -> dict[str, dict[str, dict[str, float]]]:
        """Return medians over the walks for the file; single limbs only if they differ from both together."""
        result = {}
        for name, both in (("sentences", self.sentences), ("clauses", self.clauses)):
            medians = {key: float(np.median(fractions)) for key, fractions in both.items()}
            for (part, words), fractions in self.limbs.items():
                own = float(np.median(fractions))
                if abs(own - medians[as_left_limb(part, part)[0], words]) > LIMB_DIFFERENCE_FRACTION:
                    medians[part, words] = own
            groups: dict[str, dict[str, float]] = {}
            for (group, words), median in sorted(medians.items()):
                groups.setdefault(group, {})[words] = round(median, 2)
            result[name] = groups
        return result


def measure_adherence(
    model: MotionModel, prompter: Prompter, walker: Walker, entries: Sequence[PartDescriptions]
) -> Found:
    """Walk the library's `entries` and the catalogue's phrases once each, and measure them."""
    neutral = prompter.expand(PLAIN_PROMPT).descriptions
    requested: list[tuple[PartDescriptions, str]] = [(d, "") for d in entries] + list(_phrases(neutral))
    log.info("%d walks", len(requested) + 1)
    plain, *made = walker.make(prompter(d) for d in (neutral, *(d for d, _ in requested)))
    motion = neutral_motion(model, prompter(neutral))
    found, described = Found(), described_edits(motion)
    for (descriptions, edit), walked in zip(requested, made, strict=True):
        if not edit:
            for part in PART_NAMES:
                found.add(part, getattr(descriptions, part), plain.body, walked.body)
            continue
        fraction = edit_fraction(edit, described[edit], plain, walked)
        for part in part_edits()[edit].phrases:
            found.add_edit(part, getattr(descriptions, part), fraction)
    return found


def edit_fraction(edit: str, example: tuple[Summary, Summary], plain: Summary, walked: Summary) -> float:
    """Return the fraction, 0 to 1, of an edit's effect on the neutral walk (`example`: before, after) in a walk.

    For a held hand it is the fraction of the hand's path to its target.
    """
    before, after = example
    if part_edits()[edit].kind == "hand" and "wave" not in part_edits()[edit].parameters:
        part = part_edits()[edit].slot
        place = [hand_place(s, part) for s in (before, after, plain, walked)]
        wanted, moved = place[1] - place[0], place[3] - place[2]
        missed = float(np.linalg.norm(wanted - moved)) / max(float(np.linalg.norm(wanted)), 0.05)
        return float(np.clip(1.0 - missed, 0.0, 1.0))
    fractions = []
    for target in targets((edit,)):
        amount = value(after, target) - value(before, target)
        if abs(amount) > 1e-6:
            fractions.append((value(walked, target) - value(plain, target)) / amount)
    return float(np.clip(min(fractions), 0.0, 1.0)) if fractions else 0.0


def hand_place(summary: Summary, part: str) -> np.ndarray:
    """Return the position of an arm's hand, metres: forward of the shoulder, outward, and up."""
    arm = getattr(summary.body, part)
    place = np.array([getattr(arm, name) for name in _HAND])
    return place * np.array([1.0, 1.0, _LEVEL_M])


def _phrases(neutral: PartDescriptions) -> Iterable[tuple[PartDescriptions, str]]:
    """Yield every phrase of the catalogue on a neutral walk, with its edit."""
    for name, edit in part_edits().items():
        for k in range(max(map(len, edit.phrases.values()))):
            yield phrased(neutral, edit.phrases, k), name


def described_edits(motion: EditedMotion) -> dict[str, tuple[Summary, Summary]]:
    """Summarise the neutral walk before and after every edit."""
    before = summarise(motion.hips, motion.local, motion.contacts)
    found = {}
    for name, edit in part_edits().items():
        changed = apply(motion, edit, np.random.default_rng(0))
        found[name] = before, summarise(changed.hips, changed.local, changed.contacts)
    return found


def neutral_motion(model: MotionModel, z: Array) -> EditedMotion:
    """Generate a neutral walk of the model as input of edits."""
    ((hips, local, contacts),) = straight_walks(model, [z], 2 * PHRASE_S)
    stands = (contacts > 0.5).astype(np.uint8)
    return EditedMotion(hips.astype(np.float64), local.astype(np.float64), stands, Terrain.flat(size_m=200.0))
