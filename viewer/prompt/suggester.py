"""Suggestions while a prompt is typed: matches of words in the frame, nearest by meaning from a worker thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from runtime.errors import SportError
from viewer.jobs import Jobs, Slot
from viewer.prompt.state import FieldState, PromptState
from viewer.prompt.suggestions import Suggestion, suggest
from viewer.settings import Settings

MIN_CHARACTERS = 3  # typed before the meaning is looked up
_SLOT = Slot("suggestions")

Nearest = Callable[[str], tuple[tuple[str, float], ...]]


@dataclass
class Suggester:
    """Answers at once with what is known; what the worker finds is there some frames later."""

    state: PromptState
    settings: Settings
    jobs: Jobs
    nearest: Nearest | None = None  # of the loaded library; takes milliseconds
    _key: object = None
    _found: tuple[Suggestion, ...] = ()

    def suggestions(self, box: FieldState) -> tuple[Suggestion, ...]:
        """The list for what stands in a field now."""
        typed, history = box.text, self.settings.prompt_history
        self._look_up(box, typed)
        near = box.near if box.near_to and _continues(typed, box.near_to) else ()
        key = (typed, near, tuple(history))
        if key != self._key:
            self._key = key
            self._found = suggest(typed, self.state.library, history, near)
        return self._found

    def _look_up(self, box: FieldState, typed: str) -> None:
        nearest = self.nearest
        if nearest is None or box.near_to == typed or len(typed.strip()) < MIN_CHARACTERS:
            return
        if self.jobs.busy(_SLOT):
            return  # the newest words are looked up when it is done

        def work() -> tuple[tuple[str, float], ...]:
            try:
                return nearest(typed)
            except SportError:  # words that no prompt may have; `Apply` says so
                return ()

        def done(near: tuple[tuple[str, float], ...]) -> None:
            box.near, box.near_to = near, typed

        self.jobs.submit(_SLOT, work, done)


def _continues(typed: str, earlier: str) -> bool:
    """Whether what was found for `earlier` is still of use while more is typed or taken away."""
    return typed.startswith(earlier) or earlier.startswith(typed)
