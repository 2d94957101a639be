"""Writes finished frames as PNG files: one requested by a key, or all of them."""

import time
from dataclasses import dataclass
from pathlib import Path

from runtime.safe_read import expanded
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.render.offscreen import save_png
from viewer.settings import Settings
from viewer.window import Window


@dataclass
class Screenshots:
    settings: Settings
    messages: Messages
    jobs: Jobs
    folder: Path | None  # for every frame
    _next: Path | None = None  # target of the next frame

    def ask(self) -> None:
        name = time.strftime("sport-%Y%m%d-%H%M%S.png")  # two of the same second get different names
        self._next = expanded(self.settings.export_folder) / name

    def capture(self, window: Window, number: int) -> None:
        if self.folder is not None:
            save_png(window.read_pixels(), self.folder / f"frame_{number:05d}.png")
        if self._next is not None:
            path, self._next = self._next, None
            pixels = window.read_pixels()
            self.jobs.submit(
                Slot("screenshot"),
                lambda: save_png(pixels, path, new=True),
                lambda p: self.messages.note(f"Saved {p}", p),
                writing="a screenshot",
            )
