"""What a model shows of the catalogue's edits: on which side better, and drawn out how far wholly (`runtime.motion.calibration`).

The first sentence of every edit is walked once, on each side where it has two, and compared with what the edit does to the
model's own neutral walk; what is shown in part is walked again, drawn out farther. The same is done among other edits
on the other parts, where many are shown less. Edits that are held out are not looked at: a side that training never saw
is taken to be the weaker one, and has the gain of the other. Sentences that rules make of a prompt beyond these are
measured by what they claim.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from runtime.arrays import Float32Array
from runtime.motion.features import C
from runtime.motion.model import MotionModel, load_model
from runtime.motion.model_files import read_metadata, write_metadata
from runtime.prompts.edit_targets import targets_of
from runtime.prompts.english.grammar import grammar
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.prompts.phrasing import ModelPhrasing, phrasing_of
from runtime.prompts.prompter import Prompter
from runtime.skeleton import PART_NAMES
from training.augmentation.catalogue import catalogue, part_edits
from training.augmentation.measured_edits import Summary
from training.evaluation.text.prompt_adherence import PHRASE_S, described_edits, edit_fraction, neutral_motion
from training.evaluation.text.walks import PLAIN_PROMPT, Walker
from training.frames import FrameTable
from training.text.claims import claims, sentence_fraction

log = logging.getLogger("sport.train")

CLOSE, WIDE = 0.02, 0.1  # metres of a foot from the middle line: feet close together, and as they usually are
ALIKE = 0.05  # fractions of two sides that differ by less are the same
UNTRAINED = 0.4  # by which a side that training never saw is taken to be shown worse
SHOWN = 0.85  # fraction with which an edit is shown wholly
GAINS = (1.25, 1.5, 1.75, 2.0)
WORTH = 0.15  # of a fraction that a gain must bring
# on all parts but an edit's own, while it is measured among others
COMPANIONS = (
    ("left_arm.on_hip", "right_arm.on_hip", "torso.chest_out", "head.turned_left_little", "legs.short"),
    ("left_arm.folded", "right_arm.folded", "torso.slump", "head.down", "legs.crouch_little"),
)
LEGS = {"left_leg", "right_leg"}
PAIRS = 400  # clips with their mirror images that the signs of the phases are read from
DRAWS = 50  # frames of each


def phase_signs(table: FrameTable, phase: np.ndarray) -> list[int] | None:
    """The sign of every channel's vectors in the mirror image: -1 where it changes, else 1; `phase` is `(N, 5, 2)`.

    None where no clip has its mirror image: such a network has no side to walk on but the one it saw.
    """
    number = {name: i for i, name in enumerate(table.names)}
    pairs = [(i, number[f"{n}_m"]) for n, i in number.items() if f"{n}_m" in number]
    if not pairs:
        return None
    random, total = np.random.default_rng(0), np.zeros(C)
    for k in random.permutation(len(pairs))[:PAIRS]:
        clip, image = pairs[k]
        length = table.start[clip + 1] - table.start[clip]
        at = random.integers(0, length, DRAWS)
        total += (phase[table.start[clip] + at] * phase[table.start[image] + at]).sum((0, 2))
    return [1 if value >= 0 else -1 for value in total]


@dataclass(frozen=True)
class _Claim:
    """Words of some parts, in some sentences each, and the fraction of them that a walk shows against one without them."""

    name: str
    words: Mapping[str, Sequence[str]]
    fraction: Callable[[Summary, Summary], float]
    held: bool = False  # a hand at its place

    @property
    def on_a_line(self) -> bool:
        """True if it sets the feet on a line in any case: drawn out, such a code crosses the legs and leaves the way."""
        said = (text for texts in self.words.values() for text in texts)
        return any(targets_of("left_leg", text).get("outward", (WIDE,))[0] <= CLOSE for text in said)

    def within(self, among: PartDescriptions, number: int = 0) -> PartDescriptions:
        """Other words with these, in one of their sentences."""
        for part, texts in self.words.items():
            among = among.replace(part, texts[number % len(texts)])
        return among


@dataclass(frozen=True)
class _Walks:
    """Walks by words that are drawn out, and what they show; many at once, for walks made together cost less."""

    prompter: Prompter
    walker: Walker
    plain: PartDescriptions
    neutral: Float32Array

    def alone(self, several: Sequence[_Claim], gains: Sequence[float]) -> list[float]:
        """The fraction of each that is shown on a neutral walk."""
        codes = [self._code(each, gain, self.plain) for each, gain in zip(several, gains, strict=True)]
        walked, *made = self.walker.make([self.neutral, *codes])
        return [each.fraction(walked, one) for each, one in zip(several, made, strict=True)]

    def among_others(self, several: Sequence[_Claim], gains: Sequence[float]) -> list[float]:
        """The fraction of each, the mean among the two groups of others."""
        found = []
        for companions in COMPANIONS:
            codes = []
            for each, gain in zip(several, gains, strict=True):
                words = _among(self.plain, each.words, companions)
                codes += [self.prompter(words), self._code(each, gain, words)]
            made = self.walker.make(codes)
            pairs = zip(several, made[::2], made[1::2], strict=True)
            found.append([each.fraction(without, one) for each, without, one in pairs])
        return [float(np.mean(fractions)) for fractions in zip(*found, strict=True)]

    def gains(self, several: Sequence[_Claim]) -> list[tuple[float, float]]:
        """The gains with which each is shown wholly alone, and among others.

        The code of a hand that is held is its place: farther out is another, whatever the others do. A code that sets the
        feet on a line is left alone.
        """
        drawn = [each for each in several if not each.on_a_line]
        alone = self._least(drawn, self.alone, [1.0] * len(drawn))
        found = {each.name: (gain, gain) for each, gain in zip(drawn, alone, strict=True)}
        free = [each for each in drawn if not each.held]
        among = self._least(free, self.among_others, [found[each.name][0] for each in free])
        found |= {each.name: (found[each.name][0], gain) for each, gain in zip(free, among, strict=True)}
        return [found.get(each.name, (1.0, 1.0)) for each in several]

    def _least(
        self,
        several: Sequence[_Claim],
        fractions: Callable[[Sequence[_Claim], Sequence[float]], list[float]],
        gains: Sequence[float],
    ) -> list[float]:
        """The least with which each is shown wholly; that of `gains`, where it is by that or none brings much.

        What farther out is not shown wholly distorts the rest.
        """
        shown, found = fractions(several, gains), list(gains)
        left = {i: _farther(gains[i]) for i, fraction in enumerate(shown) if fraction < SHOWN}
        while left := {i: farther for i, farther in left.items() if farther}:
            tried = {i: farther[len(farther) // 2] for i, farther in left.items()}
            reached = fractions([several[i] for i in tried], list(tried.values()))
            for (i, gain), fraction in zip(tried.items(), reached, strict=True):
                half = left[i].index(gain)
                if fraction >= max(SHOWN, shown[i] + WORTH):
                    log.info("%s: %.2f, drawn out by %.2f", several[i].name, shown[i], gain)
                    found[i], left[i] = gain, left[i][:half]
                else:
                    left[i] = left[i][half + 1 :]
        return found

    def _code(self, claim: _Claim, gain: float, among: PartDescriptions) -> Float32Array:
        code = self.prompter(claim.within(among))
        own = [PART_NAMES.index(part) for part in claim.words]
        code[own] = self.neutral[own] + np.float32(gain) * (code[own] - self.neutral[own])
        return code


def _farther(gain: float) -> list[float]:
    return [each for each in GAINS if each > gain]


def calibrated(
    model: MotionModel, prompter: Prompter, walker: Walker, phrasing: ModelPhrasing
) -> list[dict[str, Any]]:
    """The codes of what a model shows with leads and gains, as its metadata have them; `phrasing` is its own wording."""
    plain = prompter.expand(PLAIN_PROMPT).descriptions
    neutral = prompter(plain)
    walks = _Walks(prompter, walker, plain, neutral)
    examples = described_edits(neutral_motion(model, neutral))
    pairs = _trained()
    edits = {}
    for name in sorted({n for pair in pairs for n in pair}):
        edit, fraction = part_edits()[name], partial(edit_fraction, name, examples[name])
        edits[name] = _Claim(name, edit.phrases, fraction, held=edit.kind == "hand")
    first = dict(zip(edits, walks.alone(list(edits.values()), [1.0] * len(edits)), strict=True))
    leads = [_lead(left, right, first[left] - first[right]) for left, right in pairs]
    better = [edits[left if lead >= 0 else right] for (left, right), lead in zip(pairs, leads, strict=True)]
    rules = list(_rule_sentences(phrasing))
    gains = walks.gains([*better, *rules])
    rows: list[dict[str, Any]] = []
    for (left, _), lead, measured, gain in zip(pairs, leads, better, gains, strict=False):
        # of a pair that has one side only the catalogue has the words of the other
        shown = _Claim(left, part_edits()[left].phrases, measured.fraction)
        rows += _rows(shown, part_edits()[left].slot, lead, gain, walks)
    for rule, gain in zip(rules, gains[len(pairs) :], strict=True):
        rows += _rows(rule, "legs", 0.0, gain, walks)
    return rows


def _rule_sentences(phrasing: ModelPhrasing) -> Iterable[_Claim]:
    """What rules make of legs, torso and head beyond the catalogue, in the phrasing of a model."""
    edited = {text for edit in part_edits().values() for texts in edit.phrases.values() for text in texts}
    for part, group in (("left_leg", "leg"), ("torso", "torso"), ("head", "head")):
        written = {phrasing.of(text.replace("{s}", "left"), part) for text in _sentences(group)}
        for text in sorted(written - edited):
            if claims(part, text):
                words = {part: (text,)}
                if group == "leg":
                    words["right_leg"] = (mirror_text(text),)
                yield _Claim(text, words, partial(_sentence_fraction, part, text))


def _sentences(group: str) -> set[str]:
    """What the rules of a group of parts can write."""
    rules, found = grammar().groups[group], set[str]()
    for _, sentences in (*rules.actions, *rules.denied):
        found.update((sentences,) if isinstance(sentences, str) else sentences)
    return found - {""}


def _sentence_fraction(part: str, text: str, plain: Summary, walked: Summary) -> float:
    """1 where a sentence claims nothing that the other walk does not do."""
    fraction = sentence_fraction(part, text, plain.body, walked.body)
    return 1.0 if fraction is None else fraction


def _among(plain: PartDescriptions, parts: Iterable[str], companions: Iterable[str]) -> PartDescriptions:
    """Words of other edits on the parts that `parts` leave free; who takes a leg has both."""
    taken = set(parts)
    if taken & LEGS:
        taken |= LEGS
    for other in companions:
        phrases = part_edits()[other].phrases
        if not taken & set(phrases):
            for part, texts in phrases.items():
                plain = plain.replace(part, texts[0])
    return plain


def _trained() -> list[tuple[str, str]]:
    """Left and right of every edit that training saw, on one side at least; twice the same name for one without sides."""
    pairs = [(name, name.replace("left", "right")) for name in part_edits() if "right" not in name]
    pairs = [(left, right if right in part_edits() else left) for left, right in pairs]
    return [pair for pair in pairs if not set(pair) <= catalogue().held_out]


def _lead(left: str, right: str, measured: float) -> float:
    """The lead of a left side: the measured one, or that of the only side that training saw."""
    if (left in catalogue().held_out) != (right in catalogue().held_out):
        return -UNTRAINED if left in catalogue().held_out else UNTRAINED
    return round(measured, 2) if abs(measured) >= ALIKE else 0.0


def _rows(
    claim: _Claim, slot: str, lead: float, gains: tuple[float, float], walks: _Walks
) -> Iterable[dict[str, Any]]:
    """A row for each part of the words, but not for the right leg where both do the same; `lead` is of the `slot`."""
    count = max(map(len, claim.words.values()))
    codes = np.array([walks.prompter(claim.within(walks.plain, k)) for k in range(count)], np.float32)
    for part in claim.words:
        if part == "right_leg" and slot == "legs":
            continue
        own, rest = codes[:, PART_NAMES.index(part)], walks.neutral[PART_NAMES.index(part)]
        mean = own.mean(0)
        length = max(float(np.linalg.norm(mean - rest)), 1e-6)
        yield {
            "part": part.replace("right", "left"),
            "lead": lead if part == slot else 0.0,
            "gain": gains[0],
            "gain_beside": gains[1],
            "spread": round(min(1.0, float(np.linalg.norm(own - mean, axis=1).max()) / length), 2),
            "code": [round(float(v), 3) for v in mean],
        }


def calibrate(
    folder: Path,
    signs: Sequence[int],
    phrasing: ModelPhrasing | None = None,
    text_encoder: Path | None = None,
    workers: int = 1,
) -> None:
    """Measure a model folder as it is without calibration, in `workers` processes, and write that into its metadata.

    `phrasing` is by default the shipped one of a model of that name.
    """
    metadata = read_metadata(folder)
    if metadata.pop("calibration", None) is not None:
        write_metadata(folder, metadata)
    model = load_model(folder)
    prompter = Prompter(model, text_encoder=text_encoder, phrasing=ModelPhrasing())
    walker = Walker(folder, workers, PHRASE_S)
    codes = calibrated(model, prompter, walker, phrasing or phrasing_of(model.name))
    write_metadata(folder, metadata | {"calibration": {"phase": list(signs), "codes": codes}})
