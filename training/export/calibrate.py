"""On which side a model shows each of the catalogue's edits better (`runtime.motion.calibration`).

The first sentence of every edit is walked once, on each side where it has two, and compared with what the edit does to the
model's own neutral walk. Edits that are held out are not looked at: a side that training never saw is taken to be the
weaker one. Sentences that rules make of a prompt beyond these have no side.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.motion.features import C
from runtime.motion.model import MotionModel, load_model
from runtime.motion.model_files import read_metadata, write_metadata
from runtime.prompts.english.grammar import grammar
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.prompts.phrasing import ModelPhrasing, phrasing_of
from runtime.prompts.prompter import Prompter
from runtime.skeleton import PART_NAMES
from training.augmentation.catalogue import catalogue, part_edits
from training.evaluation.text.prompt_adherence import PHRASE_S, described_edits, edit_fraction, neutral_motion
from training.evaluation.text.walks import PLAIN_PROMPT, Walker
from training.frames import FrameTable
from training.text.claims import claims

log = logging.getLogger("sport.train")

EQUAL_FRACTION = 0.05  # fractions of two sides that differ by less are the same
UNTRAINED_FRACTION = 0.4  # by which a side that training never saw is taken to be shown worse
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


def calibrated(
    model: MotionModel, prompter: Prompter, walker: Walker, phrasing: ModelPhrasing
) -> list[dict[str, Any]]:
    """The codes of what a model shows with their leads, as its metadata have them; `phrasing` is its own wording."""
    plain = prompter.expand(PLAIN_PROMPT).descriptions
    neutral = prompter(plain)
    examples = described_edits(neutral_motion(model, neutral))
    pairs = _trained()
    names = sorted({name for pair in pairs for name in pair})
    codes = [prompter(_within(plain, part_edits()[name].phrases)) for name in names]
    walked, *made = walker.make([neutral, *codes])
    shown = {
        name: edit_fraction(name, examples[name], walked, one) for name, one in zip(names, made, strict=True)
    }
    rows: list[dict[str, Any]] = []
    for left, right in pairs:
        edit, lead = part_edits()[left], _lead(left, right, shown[left] - shown[right])
        rows += _rows(edit.phrases, edit.slot, lead, prompter, plain)
    for words in _rule_sentences(phrasing):
        rows += _rows(words, "legs", 0.0, prompter, plain)
    return rows


def _within(among: PartDescriptions, words: Mapping[str, Sequence[str]], number: int = 0) -> PartDescriptions:
    """Other words with those of some parts, in one of their sentences."""
    for part, texts in words.items():
        among = among.replace(part, texts[number % len(texts)])
    return among


def _rule_sentences(phrasing: ModelPhrasing) -> Iterable[Mapping[str, Sequence[str]]]:
    """What rules make of legs, torso and head beyond the catalogue, in the phrasing of a model."""
    edited = {text for edit in part_edits().values() for texts in edit.phrases.values() for text in texts}
    for part, group in (("left_leg", "leg"), ("torso", "torso"), ("head", "head")):
        written = {phrasing.of(text.replace("{s}", "left"), part) for text in _sentences(group)}
        for text in sorted(written - edited):
            if claims(part, text):
                yield {part: (text,)} | ({"right_leg": (mirror_text(text),)} if group == "leg" else {})


def _sentences(group: str) -> set[str]:
    """What the rules of a group of parts can write."""
    rules, found = grammar().groups[group], set[str]()
    for _, sentences in (*rules.actions, *rules.denied):
        found.update((sentences,) if isinstance(sentences, str) else sentences)
    return found - {""}


def _trained() -> list[tuple[str, str]]:
    """Left and right of every edit that training saw, on one side at least; twice the same name for one without sides."""
    pairs = [(name, name.replace("left", "right")) for name in part_edits() if "right" not in name]
    pairs = [(left, right if right in part_edits() else left) for left, right in pairs]
    return [pair for pair in pairs if not set(pair) <= catalogue().held_out]


def _lead(left: str, right: str, measured: float) -> float:
    """The lead of a left side: the measured one, or that of the only side that training saw."""
    if (left in catalogue().held_out) != (right in catalogue().held_out):
        return -UNTRAINED_FRACTION if left in catalogue().held_out else UNTRAINED_FRACTION
    return round(measured, 2) if abs(measured) >= EQUAL_FRACTION else 0.0


def _rows(
    words: Mapping[str, Sequence[str]], slot: str, lead: float, prompter: Prompter, plain: PartDescriptions
) -> Iterable[dict[str, Any]]:
    """A row for each part of the words, but not for the right leg where both do the same; `lead` is of the `slot`."""
    count = max(map(len, words.values()))
    codes = np.array([prompter(_within(plain, words, k)) for k in range(count)], np.float32)
    for part in words:
        if part == "right_leg" and slot == "legs":
            continue
        mean = codes[:, PART_NAMES.index(part)].mean(0)
        yield {
            "part": part.replace("right", "left"),
            "lead": lead if part == slot else 0.0,
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
