"""Styles of the prompt panel as they are kept in a project: answers with their codes, shares and locks."""

from __future__ import annotations

from typing import Any

from runtime.projects.archive import ArchiveReader, ArchiveWriter
from runtime.projects.project import Notes
from runtime.prompts.parts import PartDescriptions
from runtime.safe_read import is_text
from runtime.skeleton import PART_NAMES
from viewer.prompt.style_edit import Answer, StyleEdit

CODE = (6, 64)
MAX_NEAREST = 20
SOURCES = ("library", "gpt", "explicit")


class StyleNotes(Notes):
    """`StyleEdit` to JSON and back."""

    def pack(self, note: Any, archive: ArchiveWriter) -> Any:
        """JSON of a `StyleEdit`; None for anything else."""
        if not isinstance(note, StyleEdit):
            return None
        answers = [None if answer is None else _packed(answer, archive) for answer in note.answers]
        return {"answers": answers, "weights": list(note.weights), "locked": sorted(note.locked)}

    def unpack(self, value: Any, archive: ArchiveReader) -> StyleEdit:
        """A `StyleEdit` of JSON that nobody vouches for."""
        a, b = (None if entry is None else _unpacked(entry, archive) for entry in value["answers"])
        weights = tuple(float(weight) for weight in value["weights"])
        if len(weights) != len(PART_NAMES) or not all(0.0 <= weight <= 1.0 for weight in weights):
            raise ValueError("shares of a blend that are none")
        locked = frozenset(part for part in value["locked"] if part in PART_NAMES)
        return StyleEdit((a, b), weights, locked)


def _packed(answer: Answer, archive: ArchiveWriter) -> Any:
    return {
        "prompt": answer.prompt,
        "said": answer.said.to_mapping(),
        "words": answer.words.to_mapping(),
        "z": archive.array(answer.z),
        "source": answer.source,
        "nearest": [[text, float(share)] for text, share in answer.nearest],
        "note": answer.note,
    }


def _unpacked(value: Any, archive: ArchiveReader) -> Answer:
    z = archive.array(value["z"], "<f4", CODE)
    texts = (value["prompt"], value["note"], *(text for text, _ in value["nearest"]))
    if not all(map(is_text, texts)) or value["source"] not in SOURCES or not (abs(z) <= 1e6).all():
        raise ValueError("an answer that is none")
    return Answer(
        value["prompt"],
        PartDescriptions.from_mapping(value["said"]),
        PartDescriptions.from_mapping(value["words"]),
        z,
        value["source"],
        tuple((text, float(share)) for text, share in value["nearest"][:MAX_NEAREST]),
        value["note"],
    )
