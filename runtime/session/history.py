"""The undo history of a session: a list of sessions, each with the edit that led to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from runtime.session.session import Session

MAX_STEPS = 200


@dataclass(frozen=True)
class Step:
    """A step of the history: a session and the label of the edit that led to it; `number` counts all steps ever made.

    An `awaited` step was begun, and a job is still computing its result.
    """

    number: int
    label: str
    session: Session
    awaited: bool = False


@dataclass
class History:
    """The undo history: steps from oldest to newest, and the index of the present one."""

    steps: list[Step] = field(default_factory=lambda: [Step(0, "", Session())])
    at: int = 0  # index of the present step

    @property
    def present(self) -> Step:
        return self.steps[self.at]

    @property
    def undo_label(self) -> str:
        """Label of the step that undo would revert, or ""."""
        return self.present.label if self.at > 0 else ""

    @property
    def redo_label(self) -> str:
        """Label of the step that redo would restore, or ""."""
        return self.steps[self.at + 1].label if self.at + 1 < len(self.steps) else ""

    @property
    def settled(self) -> History:
        """The history without awaited steps, as it is saved."""
        steps = [step for step in self.steps if not step.awaited]
        return History(steps, sum(not step.awaited for step in self.steps[: self.at + 1]) - 1)

    def push(self, label: str, session: Session, awaited: bool = False) -> Step:
        """Append a step after the present one and return it; redo steps and the oldest beyond `MAX_STEPS` are dropped."""
        del self.steps[self.at + 1 :]
        self.steps.append(Step(self.present.number + 1, label, session, awaited))
        excess = len(self.steps) - MAX_STEPS - 1
        if excess > 0:  # the oldest step kept must not be an awaited one
            kept = [i for i, step in enumerate(self.steps) if not step.awaited]
            del self.steps[: next((i for i in kept if i >= excess), kept[-1])]
        self.at = len(self.steps) - 1
        return self.steps[-1]

    def land(self, number: int, change: Callable[[Session], Session]) -> None:
        """Apply the result of an awaited step to it and to every later step."""
        self.steps = [
            replace(s, session=change(s.session), awaited=s.awaited and s.number != number)
            if s.number >= number
            else s
            for s in self.steps
        ]

    def drop(self, number: int) -> None:
        """Remove an awaited step whose job gave no result."""
        at = next((i for i, s in enumerate(self.steps) if s.number == number and s.awaited), -1)
        if at > 0:
            del self.steps[at]
            self.at -= self.at >= at

    def replace(self, session: Session) -> None:
        """Replace the session of the present step."""
        self.steps[self.at] = replace(self.present, session=session)

    def revise(self, change: Callable[[Session], Session]) -> None:
        """Replace the session of every step by `change` of it."""
        self.steps = [replace(step, session=change(step.session)) for step in self.steps]

    def go(self, by: int) -> bool:
        """Undo (-1) or redo (1) a step; return whether there was one."""
        if not 0 <= self.at + by < len(self.steps):
            return False
        self.at += by
        return True
