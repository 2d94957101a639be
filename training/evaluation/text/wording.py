"""Finds wordings that a model follows, by walking every sentence: `assets/prompts/wording.json`, by `training.export.words`.

Each sentence is walked with neutral words for other parts, and its claims (`training.text.claims`) are measured; each arm
separately, because some edits are held out on one side. A sentence with less than `WEAK_FRACTION` of its claims is replaced
by the sentence with the same claimed measures that meets the claims with the least other change; for an arm, by its own
beginning, or a sentence that ends with the same position. Descriptions of captured styles are not replaced, because the
model was trained on them.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from math import inf
from operator import itemgetter

from runtime.arrays import Array
from runtime.assets import asset_path
from runtime.measures.table import BodyMeasures
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.prompts.phrasing import as_left_limb
from runtime.prompts.prompter import Prompter
from training.evaluation.text.walks import PLAIN_PROMPT, Walker
from training.text.claims import claims, sentence_fraction, unclaimed_change

WEAK_FRACTION = 0.6  # of a sentence's claims, below which it is replaced
MIN_GAIN_FRACTION = 0.3  # by which the replacement must be better
UNCLAIMED_CHANGE_WEIGHT = 0.12  # cost of one step of unclaimed change, in fractions
LIKENESS_WEIGHT = 0.8  # value of textual similarity
# parts to walk, by group of the table
PARTS = {
    "torso": "torso",
    "head": "head",
    "leg": "left_leg",
    "left_arm": "left_arm",
    "right_arm": "right_arm",
}
ARMS = ("left_arm", "right_arm")
Key = tuple[str, str]  # group and words; limbs as left ones
NEUTRAL: Key = ("", "")
Likeness = Callable[[Sequence[str]], Array]


def walk_all(walker: Walker, prompter: Prompter, keys: Sequence[Key]) -> dict[Key, BodyMeasures]:
    """Measure a walk for each sentence, and for `NEUTRAL`."""
    plain = prompter.expand(PLAIN_PROMPT).descriptions
    said = [plain, *(_said(plain, *key) for key in keys)]
    made = walker.make(map(prompter, said))
    return {key: walked.body for key, walked in zip([NEUTRAL, *keys], made, strict=True)}


def _said(plain: PartDescriptions, group: str, words: str) -> PartDescriptions:
    part = PARTS[group]
    return plain.replace(part, mirror_text(words) if part.startswith("right") else words)


def better_wordings(
    walks: Mapping[Key, BodyMeasures], captured: frozenset[Key], likeness: Likeness
) -> dict[str, dict[str, str]]:
    """Return replacements of weakly followed sentences by group; `captured` sentences are not replaced.

    `likeness` maps sentences to unit vectors.
    """
    table = {}
    for group in PARTS:
        bodies = {words: body for (own, words), body in walks.items() if own == group}
        own = _better_of(group, bodies, walks[NEUTRAL], likeness)
        limb = as_left_limb("", PARTS[group])[0]
        own = {words: best for words, best in own.items() if (limb, words) not in captured}
        if own:
            table[group] = own
    return table


def _better_of(
    group: str, bodies: Mapping[str, BodyMeasures], neutral: BodyMeasures, likeness: Likeness
) -> dict[str, str]:
    """Return replacements of weakly followed sentences of a group; `bodies` are measures by sentence."""
    part = PARTS[group]
    shown = {words: sentence_fraction(part, words, neutral, body) for words, body in bodies.items()}
    weak = {w: f for w, f in shown.items() if f is not None and f < WEAK_FRACTION}
    if not weak:
        return {}
    vectors = dict(zip(bodies, likeness(list(bodies)), strict=True))

    def best(words: str) -> tuple[float, str]:
        """Return the highest worth and its sentence; minus infinity if none is better."""
        others = (w for w in bodies if w not in weak and _stands_for(group, part, w, words))
        worths = {w: _worth(part, words, weak[words] + MIN_GAIN_FRACTION, neutral, bodies[w]) for w in others}
        alike = {w: LIKENESS_WEIGHT * float(vectors[words] @ vectors[w]) for w in worths}
        return max(
            ((value + alike[w], w) for w, value in worths.items()), key=itemgetter(0), default=(-inf, "")
        )

    found = {words: best(words) for words in weak}
    return {words: other for words, (value, other) in found.items() if value > -inf}


def _worth(part: str, words: str, least: float, neutral: BodyMeasures, body: BodyMeasures) -> float:
    """Return the fraction of a sentence in a walk minus the cost of other changes; minus infinity below `least`."""
    fraction = sentence_fraction(part, words, neutral, body)
    if fraction is None or fraction < least:
        return -inf
    return fraction - UNCLAIMED_CHANGE_WEIGHT * unclaimed_change(part, words, neutral, body)


_PLACE = re.compile(r" (?:behind|of|on|at) the \w+$")
Meaning = tuple[frozenset[tuple[str, str]], frozenset[str]]


@cache
def _meaning(part: str, words: str) -> Meaning:
    """Return the measures claimed by a sentence, and the sides that it names."""
    return claims(part, words), frozenset(re.findall(r"\b(?:left|right)\b", words.partition(" ")[2]))


def _stands_for(group: str, part: str, other: str, words: str) -> bool:
    """Return whether sentence `other` can replace `words`: it has the same claims; for an arm, whose claims are coarse,
    it also ends with the same position ("behind the back"), or it is the beginning of `words`."""
    meaning, wanted = _meaning(part, other), _meaning(part, words)
    if group in ARMS:
        begins = bool(meaning[0]) and meaning[0] <= wanted[0] and words.startswith(f"{other},")
        place = _PLACE.search(other)
        return begins or (meaning == wanted and place is not None and words.endswith(place[0]))
    return meaning == wanted


def measure_wording(
    walker: Walker, prompter: Prompter, sentences: Iterable[Key]
) -> dict[str, dict[str, str]]:
    """Measure a model's table for `sentences`, by groups of prompt adherence; the prompter must not replace words."""
    keys = sorted({key for group, words in sentences for key in _walked(group, words)})
    walks = walk_all(walker, prompter, keys)
    return better_wordings(walks, _captured(), lambda words: prompter.text_encoder.encode(list(words)))


def _walked(group: str, words: str) -> list[Key]:
    """Return the keys for walking a sentence: for an arm one per side, for legs one for both."""
    if group == "arm":
        return [("left_arm", words), ("right_arm", words)]
    return [("leg" if group.endswith("_leg") else group, words)]


def _captured() -> frozenset[Key]:
    library = json.loads(asset_path("prompts/styles.json").read_text("utf-8"))
    said = (mapping for style in library.values() for mapping in style["descriptions"])
    return frozenset(as_left_limb(words, part) for mapping in said for part, words in mapping.items())
