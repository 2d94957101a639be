"""Saving what was never exported when the program ends: each take by itself, and elsewhere where it has to be."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.errors import SportError
from runtime.safe_read import printable
from viewer.messages import Messages

if TYPE_CHECKING:
    from viewer.takes.state import ClipItem

_LOG = logging.getLogger("sport.viewer")


@dataclass
class Rescue:
    """Writes takes into the first of three folders that takes them: the one asked for, the state's, a temporary one."""

    messages: Messages
    asked: Callable[[], Path]  # the folder of exports
    state_folder: Path
    save: Callable[[ClipItem, Path], Path]  # writes under a free name in a folder; the path
    incomplete: bool = False  # a take was lost, or went elsewhere than asked
    written: list[Path] = field(default_factory=list)

    def keep(self, item: ClipItem) -> None:
        """Write one take; whatever goes wrong is reported and costs no other take."""
        reason = ""
        folders = (self.asked, lambda: self.state_folder / "takes", _temporary)
        for number, folder in enumerate(folders):
            try:
                path = self.save(item, folder())
            except SportError as error:
                reason = reason or str(error)
            except Exception as error:  # a defect in writing one take must not cost the others
                _LOG.exception("saving %s failed", printable(item.name))
                reason = reason or f"{type(error).__name__}: {error}. Please report this defect."
            else:
                self.written.append(path)
                if number:
                    self.incomplete = True
                    self.messages.error(f"{item.name} is in {path}, not where it was asked for: {reason}")
                return
        self.incomplete = True
        kept = "" if item.journal is None else " What its journal holds is offered at the next start."
        self.messages.error(f"{item.name} could not be saved: {reason}{kept}")


def _temporary() -> Path:
    return Path(tempfile.gettempdir()) / "sport-clips"
