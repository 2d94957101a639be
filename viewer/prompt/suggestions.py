"""Suggestions while a prompt is typed: word matches at once, nearest in meaning from a worker thread."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from runtime.errors import SportError
from viewer.jobs import Jobs, Slot
from viewer.settings import Settings

MAX_HISTORY = 50
MAX_SUGGESTIONS = 7
MAX_RECENT = 2  # of the user's own prompts among the suggestions
MIN_NEAR = 2  # lines reserved for prompts similar in meaning
MIN_SIMILARITY = 0.3  # cosine below which a prompt is not suggested
MIN_CHARACTERS = 3  # typed before similar meanings are looked up
_SLOT = Slot("suggestions")

Nearest = Callable[[str], tuple[tuple[str, float], ...]]


@dataclass
class PromptText:
    """The text of a prompt field, and the state of its suggestion list."""

    text: str = ""
    focus_requested: bool = False
    suggesting: bool = False  # the list is open
    picked: int = -1  # line selected with the arrow keys
    recalled: int = -1  # index of the recalled prompt in the field
    near: tuple[tuple[str, float], ...] = ()  # the library's prompts nearest to `near_to`
    near_to: str = ""


@dataclass(frozen=True)
class Suggestion:
    """A suggestion; `similarity` is the cosine if it was found by meaning."""

    text: str
    recent: bool = False
    similarity: float | None = None


@dataclass
class Suggester:
    """Suggests prompts: known matches at once, matches by meaning some frames later from a worker."""

    settings: Settings
    jobs: Jobs
    ready: tuple[str, ...] = ()  # prompts to choose from
    library: tuple[str, ...] = ()  # prompts to suggest
    nearest: Nearest | None = None  # of the loaded library; takes milliseconds
    _key: object = None
    _found: tuple[Suggestion, ...] = ()

    def load_library(self, prompts: Callable[[], tuple[tuple[str, ...], tuple[str, ...]]]) -> None:
        """Load the prompts to choose from and to suggest."""
        self.jobs.submit(Slot("library"), prompts, self._take_library)

    def _take_library(self, prompts: tuple[tuple[str, ...], tuple[str, ...]]) -> None:
        self.ready, self.library = prompts

    def suggestions(self, box: PromptText) -> tuple[Suggestion, ...]:
        typed, history = box.text, self.settings.prompt_history
        self._look_up(box, typed)
        # earlier results stay useful while more is typed or deleted
        goes_on = typed.startswith(box.near_to) or box.near_to.startswith(typed)
        near = box.near if box.near_to and goes_on else ()
        key = (typed, near, tuple(history))
        if key != self._key:
            self._key = key
            self._found = suggest(typed, self.library, history, near)
        return self._found

    def _look_up(self, box: PromptText, typed: str) -> None:
        nearest = self.nearest
        if nearest is None or box.near_to == typed or len(typed.strip()) < MIN_CHARACTERS:
            return
        if self.jobs.busy(_SLOT):
            return  # the newest text is looked up when it is done

        def work() -> tuple[tuple[str, float], ...]:
            try:
                return nearest(typed)
            except SportError:  # invalid text; `Apply` reports it
                return ()

        def done(near: tuple[tuple[str, float], ...]) -> None:
            box.near, box.near_to = near, typed

        self.jobs.submit(_SLOT, work, done)


def suggest(
    typed: str, prompts: Sequence[str], history: Sequence[str] = (), near: Iterable[tuple[str, float]] = ()
) -> tuple[Suggestion, ...]:
    """Return suggestions for typed text: own prompts, then prompts that start with it, contain its words, or have a similar meaning.

    Without text, the latest own prompts.
    """
    if not typed.strip():
        return tuple(Suggestion(text, recent=True) for text in history[:MAX_SUGGESTIONS])
    found: dict[str, Suggestion] = {}

    def add(suggestion: Suggestion) -> None:
        key = _folded(suggestion.text)
        if key != _folded(typed):
            found.setdefault(key, suggestion)

    alike = [pair for pair in sorted(near, key=lambda pair: -pair[1]) if pair[1] >= MIN_SIMILARITY]
    for text in matching(typed, history)[:MAX_RECENT]:
        add(Suggestion(text, recent=True))
    for text in matching(typed, prompts)[: MAX_SUGGESTIONS - min(len(alike), MIN_NEAR)]:
        add(Suggestion(text))
    for text, similarity in alike:
        add(Suggestion(text, similarity=similarity))
    return tuple(found.values())[:MAX_SUGGESTIONS]


def matching(typed: str, prompts: Iterable[str]) -> list[str]:
    """Return the prompts that start with the typed text, then those in which each typed word begins a word."""
    start, words = _folded(typed), _folded(typed).split()
    begin, within = [], []
    for prompt in prompts:
        folded = _folded(prompt)
        if folded.startswith(start):
            begin.append(prompt)
        elif words and all(f" {word}" in f" {folded}" for word in words):
            within.append(prompt)
    return begin + within


def remember(history: Sequence[str], prompt: str) -> list[str]:
    """Return the history with a prompt moved to the front, limited to `MAX_HISTORY`."""
    prompt = " ".join(prompt.split())
    if not prompt:
        return list(history)
    others = [text for text in history if _folded(text) != _folded(prompt)]
    return [prompt, *others][:MAX_HISTORY]


def _folded(text: str) -> str:
    return " ".join(text.casefold().split())
