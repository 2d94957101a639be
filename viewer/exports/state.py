"""The exports room's slice of the state: what the export window shows, as it is chosen there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from runtime.formats.options import ALL, BODIES, FILMS, SCENES, ExportOptions, option
from runtime.formats.table import FORMATS, Format
from runtime.options import spec_of

GROUNDS = {"": "No ground", "inside": "Ground inside", ".obj": "OBJ beside", ".glb": "GLB beside"}


@dataclass(frozen=True)
class ExportForm(ExportOptions):
    """What is chosen in the window: the options of an export (0 frames a second: as the take), and what only it has."""

    fps: float = field(default=0.0, metadata=ExportOptions.__dataclass_fields__["fps"].metadata)
    suffix: str = option(".glb", ALL, label="Format", choices={f.suffix: f.name for f in FORMATS.values()})
    ground: str = option(
        "", SCENES | {".bvh"}, label="Ground", choices=GROUNDS,
        hint="As a second node of the file, or as a file beside it, in the same coordinates",
    )  # fmt: skip
    trimmed: bool = option(
        True, ALL, label="Trimmed range", hint="Only what lies between the trim marks of the timeline"
    )
    own_character: bool = option(True, BODIES | FILMS, label="My character")  # where one is on the stage

    @property
    def format(self) -> Format:
        """What is written."""
        return FORMATS[self.suffix]

    def has(self, name: str) -> bool:
        """Whether the format has an option of the form."""
        return self.suffix in spec_of(self, name).formats


def form_to_json(form: ExportForm) -> dict[str, Any]:
    """What the window shows of a form, as plain values; see `form_from_json`."""
    return {name: getattr(form, name) for name in _shown()}


def form_from_json(value: Mapping[str, Any]) -> ExportForm:
    """A form of untrusted values: one that is missing or cannot be used has its default."""
    usual = ExportForm()
    read = {name: spec_of(usual, name).read(value.get(name), getattr(usual, name)) for name in _shown()}
    return ExportForm(**read)


def _shown() -> list[str]:
    """The fields that the window shows."""
    specs = {entry.name: spec_of(ExportForm, entry.name) for entry in fields(ExportForm)}
    return [name for name, spec in specs.items() if spec.label and spec.formats]


@dataclass
class ExportState:
    """The export window."""

    open: bool = False
    form: ExportForm = ExportForm()
    path: str = ""  # the field
    missing: str = ""  # what the format needs and is not installed, and how to get it
    writing: str = ""  # the file that is written
    progress: tuple[int, int] = (0, 0)  # frames of film done, and in all
    report: str = ""  # what became of the last export
    shown_report: str = ""  # the one of the frame before
    report_good: bool = True

    def choose(self, **values: Any) -> None:
        """Change options of the form."""
        self.form = replace(self.form, **values)
