"""The prompt room's slice of the state: what was typed and asked, what the character moves by, and who answers."""

from __future__ import annotations

from dataclasses import dataclass, field

from runtime.prompts.answer import Request as Request
from runtime.prompts.expander import DEFAULT_PROMPT
from runtime.prompts.shares import HARDLY, phrase_share
from runtime.skeleton import PART_NAMES
from viewer.prompt.style_edit import Side, StyleEdit


@dataclass
class FieldState:
    """One text field for a prompt, with its suggestions."""

    text: str = ""
    focus_requested: bool = False
    suggesting: bool = False  # the list is open
    picked: int = -1  # line of the list that the arrow keys chose
    recalled: int = -1  # which prompt of the history stands in the field
    near: tuple[tuple[str, float], ...] = ()  # the library's prompts nearest to `near_to`
    near_to: str = ""


@dataclass
class Question:
    """What was asked on one side, until its final answer."""

    request: Request
    label: str  # of the undo step
    remembered: bool = False  # into the history
    then: Question | None = None  # what to ask next
    number: int = 0
    answered: bool = False  # a better answer is on its way

    @property
    def prompt(self) -> str:
        """The prompt, "" where six descriptions were edited."""
        return self.request if isinstance(self.request, str) else ""


@dataclass
class ExpanderState:
    """Who answers prompts, and the language model's settings that are not remembered."""

    language_model: str = ""  # "model at host" while one is asked, "" when the library answers alone
    key: str = field(default="", repr=False)  # typed here: in memory only, never written
    problem: str = ""  # why no language model can be asked though one was chosen
    testing: bool = False
    report: str = ""  # what the last test said
    report_good: bool = False


@dataclass
class PromptState:
    """The prompt panel. Pairs are indexed by `Side`."""

    boxes: tuple[FieldState, FieldState] = field(default_factory=lambda: (FieldState(), FieldState()))
    parts: dict[str, str] = field(default_factory=lambda: dict.fromkeys(PART_NAMES, ""))  # the six fields
    edit: StyleEdit = field(default_factory=StyleEdit)  # what holds now
    questions: list[Question | None] = field(default_factory=lambda: [None, None])
    expander: ExpanderState = field(default_factory=ExpanderState)
    available: bool = True  # False when the model could not be loaded
    model: str = ""  # the loaded one's name
    loading: bool = True
    tab_requested: str = ""  # "blend": shown from the next frame on
    search: str = ""
    ready: tuple[str, ...] = ()  # prompts to choose from
    library: tuple[str, ...] = ()  # prompts to suggest

    @property
    def texts(self) -> list[str]:
        """All that is typed into the fields."""
        return [*(box.text for box in self.boxes), *self.parts.values()]

    @property
    def asked(self) -> set[Side]:
        """Sides whose answer is on its way."""
        return {side for side in Side if self.questions[side] is not None}

    def weakly_shown(self, part: str) -> float | None:
        """Share (0 to 1) of a part's words that the model shows on a walk, where that is hardly anything.

        None for the words of the walk that the program begins with: nobody asked for anything that is not shown.
        """
        if (
            self.edit.a is not None
            and self.edit.a.prompt == DEFAULT_PROMPT
            and part not in self.edit.a.edited
        ):
            return None
        share = phrase_share(self.applied(part), part, self.model)
        return share if share is not None and share < HARDLY else None

    def applied(self, part: str) -> str:
        """The words that a part moves by; "" before the first answer."""
        return "" if self.edit.a is None else str(getattr(self.edit.a.words, part))
