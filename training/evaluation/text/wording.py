"""Walk every sentence once and find the wording that a model follows: `assets/prompts/wording.json`, by `training.export.words`.

A sentence is walked with everything else as in neutral, and what it claims (`training.text.claims`) is compared with what the
body does; each arm is walked on its own, for some of its edits are held out on one side. Where the model shows less than `WEAK_FRACTION` of it,
the sentence gets the wording, out of all that were walked and claim the same measures, whose walk keeps the claims and changes
as little else as possible; a sentence of an arm gets its own beginning, or one that ends with the same place. Descriptions of captured styles stay as they are: the model
learnt them by heart.
"""

from __future__ import annotations

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

WEAK_FRACTION = 0.6  # fraction of a sentence's claims under which it gets another wording
MIN_GAIN_FRACTION = 0.3  # by which the other wording has to be better
UNCLAIMED_CHANGE_WEIGHT = 0.12  # what a unit of change that was not claimed costs, in fractions
LIKENESS_WEIGHT = 0.8  # what likeness of words is worth
# what is walked, by the group of the table
PARTS = {
    "torso": "torso",
    "head": "head",
    "leg": "left_leg",
    "left_arm": "left_arm",
    "right_arm": "right_arm",
}
ARMS = ("left_arm", "right_arm")
Key = tuple[str, str]  # group and words, of a limb as of the left one
NEUTRAL: Key = ("", "")
Likeness = Callable[[Sequence[str]], Array]


def walk_all(walker: Walker, prompter: Prompter, keys: Sequence[Key]) -> dict[Key, BodyMeasures]:
    """Measure walks under each sentence, and under `NEUTRAL`."""
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
    """By group, each weakly shown sentence with the one in its place; `captured` sentences keep their words.

    `likeness` gives unit vectors of sentences.
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
    """Each weakly shown sentence of a group with the one in its place; `bodies` are what is walked by each sentence."""
    part = PARTS[group]
    shown = {words: sentence_fraction(part, words, neutral, body) for words, body in bodies.items()}
    weak = {w: f for w, f in shown.items() if f is not None and f < WEAK_FRACTION}
    if not weak:
        return {}
    vectors = dict(zip(bodies, likeness(list(bodies)), strict=True))

    def best(words: str) -> tuple[float, str]:
        """The first of the sentences of most worth, and this; minus infinity where none shows more."""
        others = (w for w in bodies if w not in weak and _stands_for(group, part, w, words))
        worths = {w: _worth(part, words, weak[words] + MIN_GAIN_FRACTION, neutral, bodies[w]) for w in others}
        alike = {w: LIKENESS_WEIGHT * float(vectors[words] @ vectors[w]) for w in worths}
        return max(
            ((value + alike[w], w) for w, value in worths.items()), key=itemgetter(0), default=(-inf, "")
        )

    found = {words: best(words) for words in weak}
    return {words: other for words, (value, other) in found.items() if value > -inf}


def _worth(part: str, words: str, least: float, neutral: BodyMeasures, body: BodyMeasures) -> float:
    """What a walk shows of a sentence less what else it changes; minus infinity where it shows less than `least`."""
    fraction = sentence_fraction(part, words, neutral, body)
    if fraction is None or fraction < least:
        return -inf
    return fraction - UNCLAIMED_CHANGE_WEIGHT * unclaimed_change(part, words, neutral, body)


_PLACE = re.compile(r" (?:behind|of|on|at) the \w+$")
Meaning = tuple[frozenset[tuple[str, str]], frozenset[str]]


@cache
def _meaning(part: str, words: str) -> Meaning:
    """The measures that a sentence makes claims of, and the sides that it names."""
    return claims(part, words), frozenset(re.findall(r"\b(?:left|right)\b", words.partition(" ")[2]))


def _stands_for(group: str, part: str, other: str, words: str) -> bool:
    """Whether a sentence may be said for another: it claims the same; of an arm, of which claims say little, it is also
    the beginning of the other, or ends with the same place ("behind the back")."""
    meaning, wanted = _meaning(part, other), _meaning(part, words)
    if group in ARMS:
        begins = bool(meaning[0]) and meaning[0] <= wanted[0] and words.startswith(f"{other},")
        place = _PLACE.search(other)
        return begins or (meaning == wanted and place is not None and words.endswith(place[0]))
    return meaning == wanted


def measure_wording(
    walker: Walker, prompter: Prompter, sentences: Iterable[Key]
) -> dict[str, dict[str, str]]:
    """The table of a model, of `sentences` by the groups of prompt adherence; the prompter keeps the words as they are."""
    keys = sorted({key for group, words in sentences for key in _walked(group, words)})
    walks = walk_all(walker, prompter, keys)
    return better_wordings(walks, _captured(), lambda words: prompter.text_encoder.encode(list(words)))


def _walked(group: str, words: str) -> list[Key]:
    """The keys under which a sentence of the fractions is walked: of an arm one for each side, of legs one for both."""
    if group == "arm":
        return [("left_arm", words), ("right_arm", words)]
    return [("leg" if group.endswith("_leg") else group, words)]


def _captured() -> frozenset[Key]:
    library = json.loads(asset_path("prompts/styles.json").read_text("utf-8"))
    said = (mapping for style in library.values() for mapping in style["descriptions"])
    return frozenset(as_left_limb(words, part) for mapping in said for part, words in mapping.items())
