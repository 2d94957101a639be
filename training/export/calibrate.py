"""Calibration of sides: on which side a model shows each edit of the catalogue better (`runtime.motion.calibration`).

The first sentence of every edit is walked once per side and compared with the effect of the edit on the model's own
neutral walk. Held-out edits are not measured: a side that training never saw counts as the weaker one. Other sentences
that rules generate from prompts have no preferred side.
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

EQUAL_FRACTION = 0.05  # fractions of two sides that differ by less count as equal
UNTRAINED_FRACTION = 0.4  # assumed deficit of a side that training never saw
PAIRS = 400  # clips with mirror images, from which the signs of the phases are determined
DRAWS = 50  # frames of each


def phase_signs(table: FrameTable, phase: np.ndarray) -> list[int] | None:
    """Return the sign of every channel under mirroring, -1 where it changes, else 1; `phase` is `(N, 5, 2)`.

    None if no clip has a mirror image: such a network cannot walk mirrored.
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
    """Measure codes with their leads for the metadata of a model; `phrasing` is its own wording."""
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
    """Return descriptions `among` with some parts replaced by one of their sentences in `words`."""
    for part, texts in words.items():
        among = among.replace(part, texts[number % len(texts)])
    return among


def _rule_sentences(phrasing: ModelPhrasing) -> Iterable[Mapping[str, Sequence[str]]]:
    """Yield the sentences that rules generate for legs, torso and head beyond the catalogue, in a model's phrasing."""
    edited = {text for edit in part_edits().values() for texts in edit.phrases.values() for text in texts}
    for part, group in (("left_leg", "leg"), ("torso", "torso"), ("head", "head")):
        written = {phrasing.of(text.replace("{s}", "left"), part) for text in _sentences(group)}
        for text in sorted(written - edited):
            if claims(part, text):
                yield {part: (text,)} | ({"right_leg": (mirror_text(text),)} if group == "leg" else {})


def _sentences(group: str) -> set[str]:
    """Return all sentences that the rules of a group of parts can generate."""
    rules, found = grammar().groups[group], set[str]()
    for _, sentences in (*rules.actions, *rules.denied):
        found.update((sentences,) if isinstance(sentences, str) else sentences)
    return found - {""}


def _trained() -> list[tuple[str, str]]:
    """Return left and right name of every edit trained on at least one side; equal names for an edit without sides."""
    pairs = [(name, name.replace("left", "right")) for name in part_edits() if "right" not in name]
    pairs = [(left, right if right in part_edits() else left) for left, right in pairs]
    return [pair for pair in pairs if not set(pair) <= catalogue().held_out]


def _lead(left: str, right: str, measured: float) -> float:
    """Return the lead of the left side: measured, or fixed if training saw only one side."""
    if (left in catalogue().held_out) != (right in catalogue().held_out):
        return -UNTRAINED_FRACTION if left in catalogue().held_out else UNTRAINED_FRACTION
    return round(measured, 2) if abs(measured) >= EQUAL_FRACTION else 0.0


def _rows(
    words: Mapping[str, Sequence[str]], slot: str, lead: float, prompter: Prompter, plain: PartDescriptions
) -> Iterable[dict[str, Any]]:
    """Yield a row per described part, without the right leg for edits of both; `lead` is that of the `slot`."""
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
    store: Path | None = None,
) -> None:
    """Measure a model folder without calibration, in `workers` processes, and write the result into its metadata.

    `phrasing` defaults to the shipped one of a model of that name; `store` keeps the walks for a run that was killed.
    """
    metadata = read_metadata(folder)
    if metadata.pop("calibration", None) is not None:
        write_metadata(folder, metadata)
    model = load_model(folder)
    prompter = Prompter(model, text_encoder=text_encoder, phrasing=ModelPhrasing())
    walker = Walker(folder, workers, PHRASE_S, store)
    codes = calibrated(model, prompter, walker, phrasing or phrasing_of(model.name))
    write_metadata(folder, metadata | {"calibration": {"phase": list(signs), "codes": codes}})
