"""One-button export of takes as BVH, and which files of this run contain which take."""

import os
import re
import unicodedata
from dataclasses import dataclass, field
from pathlib import Path

from runtime.errors import SportError, UsageError
from runtime.safe_read import expanded, printable
from runtime.session.session import Session, Take
from runtime.session.session_file import SessionFile
from viewer.jobs import Slot
from viewer.session.takes import Takes
from viewer.settings import under_home

MAX_STEM_BYTES = 120  # of a file name, which systems limit to 255 including its ending
EXPORT_ALL = Slot("export", "all takes")


@dataclass
class ExportField:
    """The path for exporting the current take: a free name is proposed until the user types one."""

    takes: Takes
    path: str = field(default="", init=False)  # text of the field
    _proposed: str | None = field(
        default=None, init=False
    )  # the proposed text; None once something was typed
    _target: Path = field(
        default=Path(), init=False
    )  # its path: a name may contain characters that a field cannot show

    @property
    def suffix(self) -> str:
        return ".bvh"

    def propose(self) -> None:
        """Propose a free name in the field."""
        take = self.takes.session.current
        if take is None:
            self.path, self._proposed = "", None
            return
        folder = Path(self.takes.settings.export_folder)
        proposal = folder / free_path(expanded(folder) / f"{file_stem(take.title)}{self.suffix}").name
        self._target = expanded(proposal)
        self.path = self._proposed = printable(proposal)

    @property
    def typed(self) -> bool:
        return self.path != self._proposed

    def target(self) -> Path:
        """Return the path to write to; UsageError if the typed text is not a file name."""
        if self.typed:
            self._proposed = None  # anything typed from now on is intended
            return export_target(self.path, self.suffix)
        self.propose()  # another program may have taken the name since
        return self._target


@dataclass
class BvhExport(ExportField):
    # files of this run by take number, with their content; None if the take was exported differently
    _files: dict[Path, tuple[int, object]] = field(default_factory=dict)
    _session: SessionFile | None = None  # session of these numbers

    def __post_init__(self) -> None:
        self._session = self.takes.editor.file
        self.takes.editor.followers.append(self.follow)

    def follow(self, before: Session, now: Session) -> None:
        """Propose a name for the newly selected take; forget the exported files when another session is opened."""
        if self.takes.editor.file is not self._session:
            self._session = self.takes.editor.file
            self._files.clear()
        if now.selected != before.selected or now.current != before.current:
            self.propose()

    def saved(self, take: Take) -> Path | None:
        """Return an existing BVH of this run with the take's current content, or None."""
        content = _content(take)
        found = (path for path, (_, held) in reversed(self._files.items()) if held == content)
        return next((path for path in found if os.path.isfile(path)), None)

    def exported(self, take: Take) -> Path | None:
        """Return the file last written for the take in this run, whatever its content."""
        return next((path for path, (by, _) in reversed(self._files.items()) if by == take.number), None)

    def export(self) -> None:
        """Export the current take to the path in the field; only a typed path may replace a file."""
        takes, take = self.takes, self.takes.session.current
        if take is None:
            return
        new = not self.typed
        try:
            path = self.target()
        except SportError as error:
            takes.messages.error(error)
            return
        from runtime.formats.bvh_clip import save_bvh

        fps, unit = takes.settings.export_fps, takes.settings.export_unit
        takes.jobs.submit(
            Slot("export", take.number),
            lambda: save_bvh(take.exported, path, fps, unit, new=new),
            lambda done: self._exported(take, done),
            writing=f"the export of {take.title}",
        )

    def _exported(self, take: Take, path: Path) -> None:
        self.note_file(path, take.number, take)
        # "~/clips" stays as typed
        self.takes.settings.export_folder = under_home(path.parent)
        self.takes.messages.note(f"Saved {path}", path)
        if self._proposed is not None:
            self.propose()

    def note_file(self, path: Path, number: int, held: Take | None) -> None:
        """Remember the file written for a take, with its content `held`, or None for another format."""
        self._files.pop(path, None)
        self._files[path] = number, None if held is None else _content(held)

    def export_all(self) -> None:
        """Export all takes that match the search as BVH under their own names, replacing no file."""
        takes, found = self.takes, self.takes.found
        folder = expanded(takes.settings.export_folder)
        fps, unit = takes.settings.export_fps, takes.settings.export_unit

        def work() -> list[Path]:
            from runtime.formats.bvh_clip import save_bvh

            return [
                save_bvh(take.exported, folder / f"{file_stem(take.title)}.bvh", fps, unit, new=True)
                for take in found
            ]

        def done(paths: list[Path]) -> None:
            for take, path in zip(found, paths, strict=True):
                self.note_file(path, take.number, take)
            takes.messages.note(f"Saved {len(paths)} takes in {folder}", folder)

        takes.jobs.submit(EXPORT_ALL, work, done, writing="the export of all takes")


def _content(take: Take) -> tuple[object, ...]:
    """Return a key of the content of a take's file, equal for takes with equal files."""
    return take.motion, take.mirrored, take.poses, take.range


def export_target(text: str, suffix: str = ".bvh") -> Path:
    """Return the typed path, with an ending added if missing; UsageError if it is not a file name."""
    text = text.strip().strip('"')
    if not text or "\0" in text:
        raise UsageError("Export: the path is empty.", f"Write a path such as ~/sport-clips/walk{suffix}.")
    path = expanded(text)
    if os.path.isdir(path):
        raise UsageError(f"Export: {path} is a folder.", f"Add a file name, for example walk{suffix}.")
    return path if path.suffix.lower() == suffix else path.with_name(path.name + suffix)


def file_stem(name: str) -> str:
    """Return a file name for a take's name, in any script: lower case, words joined by dashes."""
    stem = re.sub(r"[\W_]+", "-", unicodedata.normalize("NFC", name).lower()).strip("-")
    return stem.encode()[:MAX_STEM_BYTES].decode(errors="ignore").strip("-") or "clip"


def free_path(path: Path) -> Path:
    """Return `path`, or the first of path-2, path-3, … that does not exist."""
    candidate, number = path, 2
    while os.path.lexists(candidate):  # unlike Path.exists, no error in an unreadable folder
        candidate = path.with_stem(f"{path.stem}-{number}")
        number += 1
    return candidate
