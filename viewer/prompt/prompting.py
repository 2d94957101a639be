"""Words to motion: prompts, edited fields, locks and blends go to the workers, their answers to the controller."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from runtime.errors import PromptError, SportError
from runtime.prompts.blend import ALL_A
from runtime.prompts.expander import Expander
from runtime.prompts.parts import PartDescriptions
from runtime.takes.recorder import LIVE_SECONDS
from viewer.messages import Messages
from viewer.prompt.even_blends import EvenBlends
from viewer.prompt.messages import answer_message
from viewer.prompt.state import PromptState, Question, Request
from viewer.prompt.style_edit import Answer, Side, StyleEdit, UndoStack
from viewer.prompt.suggestions import remember
from viewer.services import ControllerLike, PromptWorkerLike
from viewer.settings import Settings

CLOSE_SECONDS = 30.0
FIRST_STYLE_SECONDS = 1.0  # of the blend from neutral to the first prompt, at most
BLOCKING_SECONDS = 60.0  # how long an offscreen run waits for an answer
FIRST_SHARE = 0.5  # of a new prompt B in every part that is not locked, so that it shows
MAX_LABEL = 40  # characters of a prompt in the name of its step


@dataclass
class Prompting:
    """Actions of the prompt panel."""

    state: PromptState
    settings: Settings
    messages: Messages
    controller: Callable[[], ControllerLike | None]  # the one in use
    mark: Callable[[StyleEdit, float], None]  # hears what comes into force, for the recorder
    blocking: bool = False  # offscreen: an answer arrives in the same frame
    even_blends: EvenBlends | None = None
    first_error: SportError | None = None
    history: UndoStack = field(default_factory=UndoStack)
    workers: tuple[PromptWorkerLike, PromptWorkerLike] | None = None  # of the model in use, by side
    _due_seconds: float | None = None  # a style waits for the controller, with this transition
    _styled: bool = False
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    # --- workers

    def use(self, workers: tuple[PromptWorkerLike, PromptWorkerLike]) -> None:
        """Take a model's workers and ask them for what was asked so far."""
        self.state.loading = False
        self.history.clear()  # codes of another model
        for worker in self.workers or ():
            worker.close()
        self.workers = workers
        for side in Side:
            waits, answer = self.state.questions[side], self.state.edit.answers[side]
            if answer is not None:
                # first, because a prompt that waits leaves locked parts the codes in force
                self._ask(side, Question(answer.words, "the model", then=waits))
            elif waits is not None:
                self._ask(side, waits)

    def use_expander(self, expander: Expander) -> None:
        """Let another expander answer from the next prompt on."""
        for worker in self.workers or ():
            worker.use(expander)

    def close(self, seconds: float = CLOSE_SECONDS) -> bool:
        """Stop the workers, after the text they are at; whether they have stopped within so many seconds.

        A thread inside a network must not outlive the interpreter.
        """
        end = time.monotonic() + seconds
        return all([worker.close(max(end - time.monotonic(), 0.0)) for worker in self.workers or ()])

    # --- words

    def submit_prompt(self, text: str, side: Side = Side.A, remembered: bool = True) -> None:
        """Expand a prompt and blend to it; locked and edited fields keep their words. An empty one says what is expected."""
        self.state.boxes[side].text = text
        line = " ".join(text.split())
        line = line if len(line) <= MAX_LABEL else line[: MAX_LABEL - 1] + "…"
        self._ask(side, Question(text, f"“{line}”", remembered))

    def submit_part(self, part: str, label: str = "") -> None:
        """Encode one field's new words and lock them; an emptied field goes back to what the expander said."""
        if not self.state.parts[part].strip():
            self.reset_part(part)
            return
        try:
            words = PartDescriptions.from_mapping(self.state.parts)
        except SportError as error:
            self.messages.error(error)
            return
        if self.state.edit.a is None or words != self.state.edit.a.words:
            self._ask(Side.A, Question(words, label or _named(part)))

    def reset_part(self, part: str) -> None:
        """Give a field the expander's words again, and release it."""
        answer = self.state.edit.a
        if answer is not None:
            self.state.parts[part] = getattr(answer.said, part)
            self.submit_part(part, f"reset of {_named(part)}")

    def toggle_lock(self, part: str) -> None:
        """Lock a field's words against the next prompt, and its blend against prompt B and every slider, or release them."""
        edit = self.state.edit
        self.state.edit = dataclasses.replace(edit, locked=edit.locked ^ {part})
        self.commit(f"lock of {_named(part)}")

    # --- blending

    def set_weight(self, part: str, weight: float) -> None:
        """Share of prompt B in one part that is not locked, at once; `commit` makes it a step of undo."""
        if part not in self.state.edit.locked:
            self._reweigh(self.state.edit.with_weight(part, weight))

    def set_all_weights(self, weight: float) -> None:
        """Share of prompt B in every part that is not locked, at once; `commit` makes it a step of undo."""
        self._reweigh(self.state.edit.with_all_weights(weight))

    def swap(self) -> None:
        """Exchange prompts A and B; the character moves on as it did, and B's words become editable."""
        edit = self.state.edit
        if edit.b is None or self.state.asked:
            return
        self._show(edit.turned_round(), LIVE_SECONDS)
        self.commit("exchange of A and B")

    def drop_blend(self) -> None:
        """Back to prompt A alone; parts that are locked with a share of prompt B keep it."""
        self._withdraw(Side.B)
        edit = self.state.edit
        held = edit.locked_on(Side.B)
        if held and edit.b is not None:
            self._show(edit.with_all_weights(0.0), self.settings.blend_seconds)
            self.commit("end of the blend")
            names = ", ".join(map(_named, sorted(held)))
            self.messages.note(f"Locked with a share of prompt B, which they keep: {names}.")
            return
        self.state.boxes[Side.B].text = ""
        if edit.b is not None:
            alone = dataclasses.replace(edit, answers=(edit.a, None), weights=ALL_A)
            self._show(alone, self.settings.blend_seconds)
            self.commit("end of the blend")

    def _reweigh(self, edit: StyleEdit) -> None:
        if edit.weights != self.state.edit.weights:
            self.state.edit = edit
            self._due_seconds = LIVE_SECONDS if self._due_seconds is None else self._due_seconds

    # --- undo

    def commit(self, label: str = "blend") -> None:
        """Make what was changed since the last step a step of undo."""
        if self.state.edit.a is not None and self.state.edit != self.history.top:
            self.history.push(label, self.state.edit)

    def undo(self) -> None:
        """Take back the last change; a prompt without an answer yet is withdrawn."""
        self.commit()
        unanswered = self._unanswered()
        if not unanswered:
            self._go_to(self.history.undo_label, self.history.undo(), "Undone")
        for side in self.state.asked:
            # a prompt that still holds goes on to its better answer
            if side in unanswered or not self._holds(self.state.edit, side):
                self._withdraw(side)

    def redo(self) -> None:
        """Do again what was taken back last."""
        if not self._unanswered():
            self._go_to(self.history.redo_label, self.history.redo(), "Done again")

    def _go_to(self, label: str, edit: StyleEdit | None, verb: str) -> None:
        if edit is not None:
            self._show(edit, self.settings.blend_seconds)
            self.messages.note(f"{verb}: {label}.")

    def adopt(self, edit: StyleEdit, label: str) -> None:
        """Show an edit that the character moves by already, as a step of undo."""
        self._show(edit, 0.0)
        self._due_seconds = None
        self.history.push(label, edit)

    def restore(self, edit: StyleEdit, again: bool = False) -> None:
        """Move by the edit of a project from now on; `again`: its words are asked anew, as another model moves."""
        for side in Side:
            if self.workers is not None:
                self.workers[side].withdraw()
            self.state.questions[side] = None
        self.history.clear()
        self.state.edit = StyleEdit()
        self._show(edit, self.settings.blend_seconds)
        self.history.push("the project", edit)
        for side, answer in zip(Side, edit.answers, strict=True):
            if again and answer is not None:
                self._ask(side, Question(answer.words, "the model"))

    def answer(self, request: Request) -> Answer:
        """The final answer to a prompt or six descriptions, for a take: waits, on a worker thread."""
        if self.workers is None:
            raise PromptError("No model is loaded that could read a prompt.", "Wait until it is there.")
        return self.workers[Side.A].answer(request)

    def _show(self, edit: StyleEdit, seconds: float) -> None:
        """Put an edit into force, and its words into the fields where nothing newer stands."""
        old, self.state.edit = self.state.edit, edit
        for side, box in zip(Side, self.state.boxes, strict=True):
            if old.answers[side] is None or box.text == old.prompt(side):
                box.text = edit.prompt(side)
        if edit.a is not None:
            self.state.parts = dict(edit.a.words.to_mapping())
        self._due_seconds = seconds

    def _withdraw(self, side: Side) -> None:
        """Give up a question in hand; without an answer yet it is as if it had never been asked."""
        question = self.state.questions[side]
        if question is None or self.workers is None:
            return
        self.workers[side].withdraw()
        self.state.questions[side] = None
        if not question.answered:
            self.state.boxes[side].text = self.state.edit.prompt(side)
            self.messages.note(f"Withdrawn: {question.label}.")

    def _unanswered(self) -> set[Side]:
        """Sides whose question in hand has no answer at all yet."""
        return {side for side, q in zip(Side, self.state.questions, strict=True) if q and not q.answered}

    def _holds(self, edit: StyleEdit, side: Side) -> bool:
        """Whether an edit moves by an answer to the question in hand."""
        question, answer = self.state.questions[side], edit.answers[side]
        return question is not None and answer is not None and answer.question == question.number

    # --- questions and answers

    def _ask(self, side: Side, question: Question) -> None:
        question.number, question.answered = next(self._numbers), False
        self.state.questions[side] = question
        if self.workers is None:
            return
        self.workers[side].submit(question.request)
        deadline = time.monotonic() + BLOCKING_SECONDS
        while self.blocking and self.state.questions[side] and time.monotonic() < deadline:
            self.poll()
            time.sleep(0.001)

    def poll(self) -> None:
        """Take answers when there are any, and hand the style to the controller once; call once a frame."""
        for side, worker in zip(Side, self.workers or (), strict=False):
            question = self.state.questions[side]
            try:
                answer, final = worker.poll(), False
            except SportError as error:
                answer, final = None, True
                self._fail(error)
            if question is not None and answer is not None:
                self._take(side, question, dataclasses.replace(answer, question=question.number))
                final = answer.final
            if question is not None and final:
                self.state.questions[side] = None
                if question.then is not None:
                    self._ask(side, question.then)
        if self.even_blends is not None:
            self.even_blends.poll(self.state.edit, self._take_shares)
        self._hand_over()

    def _take_shares(self, change: Callable[[StyleEdit], StyleEdit]) -> None:
        """Take a pair's shares into the edit in force and into the steps of undo."""
        self.history.revise(change)
        self.state.edit = change(self.state.edit)
        self._due_seconds = LIVE_SECONDS if self._due_seconds is None else self._due_seconds

    def _take(self, side: Side, question: Question, answer: Answer) -> None:
        """An answer to a question comes into force: the first as a step of undo, a better one in that step's place."""
        before, first = self.state.edit.answers[side], not question.answered
        if first:
            edit = self._first_answer(side, question, answer)
            self.state.edit, question.answered = edit, True
            self.history.push(question.label, edit)
        else:
            self._improve(side, answer)
        in_force = self.state.edit.answers[side]
        if side is Side.A and in_force is not None:
            self.state.parts = dict(in_force.words.to_mapping())
        if first or before is None or in_force is None or in_force.words != before.words:
            # the first style comes soon, but no hand flies there
            soon = min(self.settings.blend_seconds, FIRST_STYLE_SECONDS)
            self._due_seconds = self.settings.blend_seconds if self._styled else soon
        if question.prompt:
            self._report(side, question, answer, followed=not first)

    def _first_answer(self, side: Side, question: Question, answer: Answer) -> StyleEdit:
        """The edit in force with the first answer to a question; words that were edited are locked with it."""
        edit = self.state.edit
        before = edit.answers[side]
        if question.prompt:
            kept = answer if before is None else answer.keeping(edit.locked_on(side), before)
            edit = edit.with_answer(side, kept)
            return edit.with_all_weights(FIRST_SHARE) if side is Side.B and not any(edit.weights) else edit
        return edit.with_answer(side, answer if before is None else before.with_words(answer)).locking_edits(
            before
        )

    def _improve(self, side: Side, answer: Answer) -> None:
        """Put a better answer in the place of the first one, in the prompt's step and in all that was done to it since.

        Where a part was locked after the first answer, it keeps that answer's words.
        """

        def improved(edit: StyleEdit) -> StyleEdit:
            first = edit.answers[side]
            if first is None or not self._holds(edit, side):
                return edit
            return edit.with_answer(side, answer.keeping(edit.locked_on(side), first))

        self.history.revise(improved)
        self.state.edit = improved(self.state.edit)

    def _report(self, side: Side, question: Question, answer: Answer, followed: bool) -> None:
        """Say who answered a prompt and which edited words it left alone; the first one answers without a word."""
        if question.remembered:
            self.settings.prompt_history = remember(self.settings.prompt_history, question.prompt)
        if self._styled or answer.note:
            model = self.state.expander.language_model or "the language model"
            in_force = self.state.edit.answers[side]
            kept = () if in_force is None else in_force.edited
            self.messages.post(*answer_message(answer, question.label, model, followed, kept))

    def _hand_over(self) -> None:
        """Give the style that is due to the controller; folding it costs about a millisecond."""
        controller, style = self.controller(), self.state.edit.style()
        if self._due_seconds is None or controller is None or style is None:
            return
        seconds, self._due_seconds = self._due_seconds, None
        self._styled = True
        try:
            controller.set_style(style, seconds)
        except SportError as error:
            self._fail(error)
            return
        self.mark(self.state.edit, seconds)

    def _fail(self, error: SportError) -> None:
        self.messages.error(error)
        self.first_error = self.first_error or error


def _named(part: str) -> str:
    return part.replace("_", " ")
