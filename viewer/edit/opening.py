"""Opens files that are dropped, chosen or typed, by their ending."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from runtime.character.read import MOTIONS, SUFFIXES
from runtime.safe_read import expanded
from runtime.session.sqlite_file import SUFFIX
from viewer.edit.reference import References
from viewer.edit.video import SUFFIXES as VIDEOS
from viewer.gui.dialogs import DialogKind
from viewer.jobs import Slot
from viewer.scene.scene import Scene
from viewer.session.opening import open_file
from viewer.session.sessions import Sessions
from viewer.session.takes import Takes


@dataclass
class FileOpener:
    scene: Scene
    takes: Takes
    references: References
    sessions: Sessions

    @property
    def by_ending(self) -> dict[str, Callable[[Path], None]]:
        """The function that opens a file, by ending."""
        films = dict.fromkeys(VIDEOS, self.references.open_video)
        takes = dict.fromkeys(MOTIONS, partial(open_file, self.takes))
        models = dict.fromkeys(SUFFIXES, self._open_gltf)
        return {**self.scene.files, **takes, **models, **films, SUFFIX: self.sessions.open}

    def open(self, paths: Sequence[Path]) -> None:
        """Open files according to their endings."""
        table = self.by_ending
        for path in paths:
            suffix = path.suffix.lower()
            if suffix in table:
                table[suffix](path)
            else:
                self.sessions.messages.error(
                    f"{path.name}: {suffix or 'a file without an ending'} cannot be opened."
                    " Drop a session, a BVH clip, a GLB, FBX or VRM character or animation, or a PNG, NPY or mesh ground."
                )

    def _open_gltf(self, path: Path) -> None:
        """Open a skin as a character, an animation as a take, and a file that has neither as a ground."""
        from runtime.formats.gltf_motion import contents

        jobs = self.sessions.jobs

        def opened(found: tuple[bool, bool]) -> None:
            skinned, animated = found
            with jobs.together():  # report an error of the file only once
                if skinned or not animated:
                    (self.scene.open_character if skinned else self.scene.load_terrain)(path)
                if animated:
                    open_file(self.takes, path)

        jobs.submit(Slot("open", path), lambda: contents(path), opened, reading=path.name)

    def browse(self) -> None:
        """Show a dialog to choose any file that can be opened."""
        self.ask("Open a file", sorted(self.by_ending), lambda path: self.open([path]))

    def ask(self, title: str, endings: Sequence[str], done: Callable[[Path], None]) -> None:
        """Show a dialog for files with the given endings."""
        start = expanded(self.takes.settings.export_folder)
        filters = [title, " ".join(f"*{ending}" for ending in endings), "All files", "*"]
        start = start if os.path.isdir(start) else Path.home()
        self.sessions.dialogs.ask(DialogKind.OPEN, title, start, done, filters)
