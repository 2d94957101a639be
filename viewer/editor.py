"""All edits of the session go through here: each is an undo step, saved at once. Nothing else can undo."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from runtime.session.history import History
from runtime.session.session import Session
from runtime.session.session_file import SessionFile
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages

Change = Callable[[Session], Session]
Follower = Callable[[Session, Session], None]  # receives the session before and after


@dataclass
class Editor:
    """The editor of the open session: every change of it goes through here.

    Tools read `session` and change it with `do` or `drag`; they register in `followers` to be called after every
    change, including undo, redo and opening files.
    """

    messages: Messages
    file: SessionFile
    history: History = field(default_factory=History)
    followers: list[Follower] = field(default_factory=list)
    # called before undo: cancels unfinished work, such as an unanswered prompt, with a message
    withdraw: list[Callable[[], bool]] = field(default_factory=list)
    opened: Session = field(init=False)  # as it was when its file was opened
    session: Session = field(init=False)  # the current one, including a drag in progress
    dragger: object = None  # the tool whose mouse drag is in progress
    _draft: Session | None = None
    _draft_label: str = ""
    # the job by the number of the step that it computes
    _running: dict[int, tuple[Jobs, Slot]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.opened = self.session = self.history.present.session

    @property
    def dragging(self) -> bool:
        """Whether a drag is in progress."""
        return self._draft is not None

    def do(self, label: str, change: Change) -> bool:
        """Apply a change as a step of undo, labelled in the user's words; return whether anything changed."""
        self.finish_drag()
        before = self.session
        after = change(before)
        if after is before or after == before:
            return False
        self.history.push(label, after)
        self._changed(before)
        return True

    def run(
        self,
        jobs: Jobs,
        label: str,
        slot: Slot,
        work: Callable[[], Any],
        change: Callable[[Any, Session], Session],
        begin: Change = lambda session: session,
        done: Callable[[Any], None] = lambda _: None,
        **about: Any,
    ) -> None:
        """Add a step whose result a background job computes; undoing it cancels the job.

        `change(result, session)` is applied to the step and every later one, so it must check that the session still
        has its object. `begin` is applied at once. `about` are further arguments of `Jobs.submit`.
        """
        self.finish_drag()
        for older in [number for number, (_, of) in self._running.items() if of == slot]:
            self._abandon(older)  # its job makes room for this one
        before = self.session
        number = self.history.push(label, begin(before), awaited=True).number
        self._running[number] = jobs, slot
        self._tell(before)

        def land(result: Any) -> None:
            if self._running.pop(number, None) is not None:
                self._land(number, partial(change, result))
                done(result)

        jobs.submit(slot, work, land, failed=lambda _: self._abandon(number), **about)

    def _land(self, number: int, change: Change) -> None:
        before = self.session
        self.history.land(number, change)
        self._draft = None if self._draft is None else change(self._draft)
        self._changed(before)

    def _abandon(self, number: int) -> None:
        """Drop a step whose job is not finished, and end the job."""
        running, before = self._running.pop(number, None), self.session
        if running is not None:
            jobs, slot = running
            jobs.end_slot(slot)
            self.history.drop(number)
            self._changed(before)

    def end_running(self) -> None:
        """Cancel every job that computes a step."""
        for number in sorted(self._running, reverse=True):
            self._abandon(number)

    def begin_drag(self, dragger: object) -> None:
        """Begin a tool's mouse drag; it ends with any step, undo or redo, after which what it holds may be gone."""
        self.finish_drag()
        self.dragger = dragger

    def drag(self, label: str, change: Change) -> None:
        """Change the session during a mouse drag; it is shown at once, and all calls of a drag with one label are one step of undo."""
        if self._draft is not None and label != self._draft_label:
            self.finish_drag()
        before = self.session
        after = change(before)
        if after is not before and after != before:
            self._draft, self._draft_label = after, label
            self._tell(before)

    def drop_drag(self) -> None:
        """Revert the drag in progress."""
        before, self._draft = self.session, None
        self._tell(before)

    def put(self, label: str, number: int, held: bool = False, **values: Any) -> None:
        """Set fields of a take or the live character; `held` during a drag."""
        (self.drag if held else self.do)(label, lambda session: session.with_take(number, **values))

    def finish_drag(self) -> None:
        """Make the finished drag a step of undo."""
        draft, self._draft, self.dragger = self._draft, None, None
        if draft is None or draft == self.history.present.session:
            return
        before = self.history.present.session
        self.history.push(self._draft_label, draft)
        self._changed(before)

    def amend(self, change: Change) -> None:
        """Change the present step itself, without a new one: a selection, a better answer."""
        before = self.session
        if self._draft is not None:
            self._draft = change(self._draft)
        present = self.history.present.session
        self.history.replace(change(present))
        if self.opened is present:  # the first ground and the first answer belong to the opened session
            self.opened = self.history.present.session
        if (self._draft or self.history.present.session) is not before:
            self._changed(before)

    def revise(self, change: Change) -> None:
        """Change the session of every step, such as when a better answer replaces the first one."""
        before = self.session
        self.history.revise(change)
        self.opened = change(self.opened)
        self._draft = None if self._draft is None else change(self._draft)
        self._changed(before)

    # --- undo

    @property
    def undo_label(self) -> str:
        """Label of the change that undo would revert, or ""."""
        return self._draft_label if self._draft is not None else self.history.undo_label

    @property
    def redo_label(self) -> str:
        """Label of the change that redo would restore, or ""."""
        return "" if self._draft is not None else self.history.redo_label

    def undo(self) -> None:
        self.finish_drag()
        if any([take_back() for take_back in self.withdraw]):
            return
        label, present = self.history.undo_label, self.history.present
        if present.awaited:
            self._abandon(present.number)
            self.messages.note(f"Undone: {label}, before it had finished.")
        elif self._go(-1):
            self.messages.note(f"Undone: {label}. Ctrl+Y redoes it.")
        else:
            self.messages.note("Nothing to undo.")

    def redo(self) -> None:
        """Redo the last undone step."""
        self.finish_drag()
        label = self.history.redo_label
        if self._go(1):
            self.messages.note(f"Redone: {label}. Ctrl+Z undoes it.")
        else:
            self.messages.note("Nothing to redo.")

    def _go(self, by: int) -> bool:
        before = self.session
        gone = self.history.go(by)
        if gone:
            self._changed(before)
        return gone

    # --- the session as a whole

    def use(self, file: SessionFile, history: History) -> None:
        """Switch to another session and its file; the caller closes the old file."""
        before = self.session
        self._draft, self.dragger, self.file, self.history = None, None, file, history
        self.opened = history.present.session
        self._tell(before)

    def _changed(self, before: Session) -> None:
        self.file.write(self.history.settled)
        self._tell(before)

    def _tell(self, before: Session) -> None:
        now = self.session = self._draft or self.history.present.session
        for follow in self.followers:
            follow(before, now)
