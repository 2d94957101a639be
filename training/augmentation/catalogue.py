"""The catalogue of part edits, read from `edits.toml`: parameters of each edit and the sentences that describe it."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from runtime.errors import FileError
from runtime.measures.table import Measure, measures_of
from training.augmentation.edits import KINDS, Kind
from training.augmentation.motion import Edit

_PATH = Path(__file__).with_name("edits.toml")
_OTHER_LEG = {"left_leg": "right_leg", "right_leg": "left_leg"}


@dataclass(frozen=True)
class PartEdit(Edit):
    """One edit. `phrases` `{part: sentences}` describe every part it changes.

    Two edits of one clip never describe the same part. `measure` (part, name in `runtime.measures.table`) quantifies it.
    """

    name: str
    phrases: dict[str, tuple[str, ...]]
    measure: tuple[str, str]

    @property
    def shown_by(self) -> Measure:
        """The table row of `measure`."""
        part, name = self.measure
        return measures_of(part)[name]

    @property
    def does(self) -> Kind:
        """The properties of its kind."""
        return KINDS[self.kind]

    @property
    def rhythm(self) -> bool:
        """True if the evaluation counts it as rhythm and weight, and not as posture."""
        return self.does.of_steps or self.kind == "swing"


@dataclass(frozen=True)
class Catalogue:
    """Edits by name, the held-out ones, and further words for the text network.

    `held_out_pairs` are pairs of edits that are trained separately but never together. `clauses` `{when: {part kind:
    clauses}}` do not change the meaning of a sentence; `other_words` `{(edit, part): sentences}` are synonyms.
    """

    edits: dict[str, PartEdit]
    held_out: frozenset[str]
    held_out_pairs: dict[str, tuple[str, str]]
    clauses: dict[str, dict[str, tuple[str, ...]]]
    other_words: dict[tuple[str, str], tuple[str, ...]]

    @property
    def trained(self) -> list[PartEdit]:
        """Return all edits that are not held out."""
        return [edit for name, edit in self.edits.items() if name not in self.held_out]


@cache
def catalogue() -> Catalogue:
    """Return the catalogue of the project."""
    return load_catalogue(_PATH)


def part_edits() -> dict[str, PartEdit]:
    """Return the edits of the project's catalogue by name."""
    return catalogue().edits


def edits_of_key(key: str) -> list[PartEdit]:
    """Return the edits in a key, whose names may end with the described part; none for a style."""
    names = [".".join(name.split(".")[:2]) for name in key.split("+")]
    return [part_edits()[name] for name in names if name in part_edits()]


def load_catalogue(path: Path) -> Catalogue:
    """Read a catalogue; FileError names the entry that is wrong."""
    try:
        return _catalogue(tomllib.loads(path.read_text("utf-8")))
    except KeyError as error:
        raise FileError(f"{path}: {error.args[0]} is missing.", "Add it.") from error
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise FileError(f"{path}: {error}.", "Correct the file, or restore it.") from error


def _catalogue(table: dict[str, Any]) -> Catalogue:
    edits = {edit.name: edit for edit in _edits(table)}
    held_out = frozenset(table["held_out"])
    pairs = {words: (one, other) for words, (one, other) in table["held_out_pairs"].items()}
    clauses = {when: {part: tuple(c) for part, c in by.items()} for when, by in table["clauses"].items()}
    other_words = dict(_other_words(table["other_words"]))
    named = held_out.union(*pairs.values(), (name for name, _ in other_words))
    if unknown := named - edits.keys():
        raise ValueError(f"{min(unknown)} is no edit")
    other_words = {key: words for key, words in other_words.items() if key[0] not in held_out}
    return Catalogue(edits, held_out, pairs, clauses, other_words)


def _edits(table: dict[str, Any]) -> Iterator[PartEdit]:
    for side in ("left", "right"):
        for limb in ("arm", "leg"):
            for name, entry in table[limb].items():
                yield _edit(f"{side}_{limb}", name, entry)
    for slot in ("torso", "head", "legs"):
        for name, entry in table[slot].items():
            yield _edit(slot, name, entry)


def _edit(slot: str, name: str, entry: dict[str, Any]) -> PartEdit:
    parts = {slot: "sentences", _OTHER_LEG.get(slot, ""): "other_leg"}
    if slot == "legs":
        parts = {"left_leg": "sentences", "right_leg": "sentences", "torso": "torso"}
    kind, parameters = entry["kind"], entry["parameters"]
    if unknown := parameters.keys() - KINDS[kind].parameters:
        raise ValueError(f"{slot}.{name}: {kind} has no {min(unknown)}")
    if unknown := entry.keys() - {"kind", "parameters", "measure", *parts.values()}:
        raise ValueError(f"{slot}.{name}: {min(unknown)} is unknown")
    phrases = {part: _sided(entry[key], part) for part, key in parts.items() if key in entry}
    part, _, field = entry["measure"].rpartition(".")
    part = part or ("left_leg" if slot == "legs" else slot)
    if field not in measures_of(part):
        raise ValueError(f"{slot}.{name}: {part} has no measure {field}")
    return PartEdit(slot, kind, parameters, f"{slot}.{name}", phrases, (part, field))


def _other_words(table: dict[str, list[str]]) -> Iterator[tuple[tuple[str, str], tuple[str, ...]]]:
    """Yield alternative words of head and torso, then of the legs for either side."""
    for name, sentences in table.items():
        slot = name.split(".")[0]
        if slot in ("head", "torso"):
            yield (name, slot), tuple(sentences)
    for part in ("left_leg", "right_leg"):
        for name, sentences in table.items():
            slot, _, rest = name.partition(".")
            if slot in ("leg", "legs"):
                yield (f"{part}.{rest}" if slot == "leg" else name, part), _sided(sentences, part)


def _sided(sentences: list[str], part: str) -> tuple[str, ...]:
    return tuple(text.replace("{s}", part.split("_")[0]) for text in sentences)
