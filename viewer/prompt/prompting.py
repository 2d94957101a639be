"""Words to motion: prompts, edited fields, locks and blends go to the workers, their answers to the controller."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from sport.runtime.errors import SportError
from sport.runtime.prompts.blend import ALL_A, Weights, write_words
from sport.runtime.prompts.expander import Expander
from sport.runtime.prompts.parts import PartDescriptions
from sport.runtime.takes.clip import LIVE_SECONDS
from sport.viewer.prompt.messages import answer_message
from sport.viewer.prompt.style_edit import Answer, StyleEdit, UndoStack
from sport.viewer.prompt.suggestions import remember
from sport.viewer.services import PromptWorkerLike
from sport.viewer.state import AppState, FieldState

CLOSE_SECONDS = 30.0
BLOCKING_SECONDS = 60.0  # how long an offscreen run waits for an answer
FIRST_BLEND: Weights = (0.5,) * len(ALL_A)  # of a new prompt B: half, so that it shows

Side = Literal["a", "b"]
Request = str | PartDescriptions


@dataclass
class _Question:
    """What one side's worker was asked."""

    worker: PromptWorkerLike | None = None
    asked: Request | None = None  # newest request without a final answer
    label: str = ""  # of the undo step
    remembered: bool = False  # into the history
    answers: tuple[Answer, ...] = ()  # its answer as the steps of undo have it: the first one makes a step
    then: tuple[Request, str, bool] | None = None  # what to ask next: request, label, remembered


@dataclass
class Prompting:
    """Actions of the prompt panel. Side "a" is the prompt, side "b" the one it is blended with."""

    state: AppState
    mark: Callable[[str, float, str], None] = lambda *_: None  # told what comes into force, for the recorder
    blocking: bool = False  # offscreen: an answer arrives in the same frame
    first_error: SportError | None = None
    history: UndoStack = field(default_factory=UndoStack)
    _questions: dict[Side, _Question] = field(default_factory=lambda: {"a": _Question(), "b": _Question()})
    _due_seconds: float | None = None  # a style waits for the controller, with this transition
    _styled: bool = False

    # --- workers

    def use(self, workers: tuple[PromptWorkerLike, PromptWorkerLike]) -> None:
        """Take a model's workers and ask them for what is wanted so far."""
        self.state.prompt.loading = False
        self.history.clear()  # codes of another model
        answers: tuple[tuple[Side, Answer | None], ...] = (
            ("a", self.state.prompt.edit.a),
            ("b", self.state.prompt.edit.b),
        )
        for (side, answer), worker in zip(answers, workers, strict=True):
            question = self._questions[side]
            if question.worker is not None:
                question.worker.close()
            question.worker = worker
            waits = None if question.asked is None else (question.asked, question.label, question.remembered)
            if (
                answer is not None
            ):  # first, because a prompt that waits leaves locked parts the codes in force
                self._ask(side, answer.words, "the model", then=waits)
            elif waits is not None:
                self._ask(side, *waits)

    def use_expander(self, expander: Expander) -> None:
        """Let another expander answer from the next prompt on."""
        for question in self._questions.values():
            if question.worker is not None:
                question.worker.use(expander)

    def close(self) -> None:
        """Stop the workers, after the text they are at: a thread inside a network must not outlive the interpreter."""
        for question in self._questions.values():
            if question.worker is not None:
                question.worker.close(CLOSE_SECONDS)

    # --- words

    def submit_prompt(self, text: str, side: Side = "a", remembered: bool = True) -> None:
        """Expand a prompt and blend to it; locked fields keep their words. An empty one says what is expected."""
        self._field(side).text = text
        self._ask(side, text, f"“{_short(text)}”", remembered)

    def submit_parts(self, label: str = "words") -> None:
        """Encode the six fields as they stand."""
        prompt = self.state.prompt
        try:
            descriptions = PartDescriptions.from_mapping(prompt.parts)
        except SportError as error:
            self.state.messages.error(error)
            return
        if prompt.edit.a is None or descriptions != prompt.edit.a.words:
            self._ask("a", descriptions, label)

    def submit_part(self, part: str) -> None:
        """Encode one field's new words; an emptied field goes back to what the expander said."""
        if not self.state.prompt.parts[part].strip():
            self.reset_part(part)
        else:
            self.submit_parts(_named(part))

    def reset_part(self, part: str) -> None:
        """Give a field the expander's words again."""
        answer = self.state.prompt.edit.a
        if answer is not None:
            self.state.prompt.parts[part] = getattr(answer.said, part)
            self.submit_parts(f"reset of {_named(part)}")

    def toggle_lock(self, part: str) -> None:
        """Lock a field's words against the next prompt and its blend against the master slider, or release them."""
        edit = self.state.prompt.edit
        self.state.prompt.edit = dataclasses.replace(edit, locked=edit.locked ^ {part})
        self.commit(f"lock of {_named(part)}")

    # --- blending

    def set_weight(self, part: str, weight: float) -> None:
        """Share of prompt B in one part, at once; `commit` makes it a step of undo."""
        self._reweigh(self.state.prompt.edit.with_weight(part, weight))

    def set_all_weights(self, weight: float) -> None:
        """Share of prompt B in every part that is not locked, at once; `commit` makes it a step of undo."""
        self._reweigh(self.state.prompt.edit.with_all_weights(weight))

    def swap(self) -> None:
        """Exchange prompts A and B; the character moves on as it did, and B's words become editable."""
        edit = self.state.prompt.edit
        if edit.b is None or self.state.prompt.asked:
            return
        flipped = tuple(1.0 - weight for weight in edit.weights)
        self._show(dataclasses.replace(edit, a=edit.b, b=edit.a, weights=flipped))
        self._due_seconds = LIVE_SECONDS
        self.commit("exchange of A and B")

    def drop_blend(self) -> None:
        """Back to prompt A alone."""
        self._withdraw("b")
        edit = self.state.prompt.edit
        self.state.prompt.other.text = ""
        if edit.b is not None:
            self._show(dataclasses.replace(edit, b=None, weights=ALL_A))
            self._due_seconds = self.state.settings.blend_seconds
            self.commit("end of the blend")

    def _reweigh(self, edit: StyleEdit) -> None:
        if edit.weights != self.state.prompt.edit.weights:
            self.state.prompt.edit = edit
            self._due_seconds = LIVE_SECONDS if self._due_seconds is None else self._due_seconds

    # --- undo

    def commit(self, label: str = "blend") -> None:
        """Make what was changed since the last step a step of undo."""
        edit = self.state.prompt.edit
        if edit is not self.history.top and edit.a is not None:
            self.history.push(label, edit)

    def undo(self) -> None:
        """Take back the last change; a prompt without an answer yet is withdrawn."""
        self.commit()
        unanswered = self._unanswered()
        if not unanswered:
            self._go_to(self.history.undo_label, self.history.undo(), "Undone")
        for side, question in self._questions.items():
            # a prompt that still holds goes on to its better answer
            if side in unanswered or getattr(self.state.prompt.edit, side) not in question.answers:
                self._withdraw(side)

    def redo(self) -> None:
        """Do again what was taken back last."""
        if not self._unanswered():
            self._go_to(self.history.redo_label, self.history.redo(), "Done again")

    def _go_to(self, label: str, edit: StyleEdit | None, verb: str) -> None:
        if edit is None:
            return
        self._show(edit)
        self._due_seconds = self.state.settings.blend_seconds
        self.state.messages.note(f"{verb}: {label}.")

    def _show(self, edit: StyleEdit) -> None:
        """Put an edit into force, and its words into the fields where nothing newer stands."""
        prompt, old = self.state.prompt, self.state.prompt.edit
        for box, before, after in ((prompt.box, old.a, edit.a), (prompt.other, old.b, edit.b)):
            typed_since = before is not None and box.text != before.prompt
            if not typed_since:
                box.text = "" if after is None else after.prompt
        prompt.edit = edit
        if edit.a is not None:
            prompt.parts = dict(edit.a.words.to_mapping())

    def _withdraw(self, side: Side) -> None:
        """Give up a question in hand; without an answer yet it is as if it had never been asked."""
        question, answer = self._questions[side], getattr(self.state.prompt.edit, side)
        if question.asked is None or question.worker is None:
            return
        question.worker.withdraw()
        question.asked = question.then = None
        self._note_asked()
        if not question.answers:
            self._field(side).text = "" if answer is None else answer.prompt
            self.state.messages.note(f"Withdrawn: {question.label}.")

    # --- questions and answers

    def _field(self, side: Side) -> FieldState:
        return self.state.prompt.box if side == "a" else self.state.prompt.other

    def _ask(
        self,
        side: Side,
        request: Request,
        label: str,
        remembered: bool = False,
        then: tuple[Request, str, bool] | None = None,
    ) -> None:
        question = self._questions[side]
        question.asked, question.label, question.remembered = request, label, remembered
        question.answers, question.then = (), then
        self._note_asked()
        if question.worker is None:
            return
        question.worker.submit(request)
        if self.blocking:
            deadline = time.monotonic() + BLOCKING_SECONDS
            while question.asked is not None and time.monotonic() < deadline:
                self.poll()
                time.sleep(0.001)

    def _unanswered(self) -> list[Side]:
        """Sides whose question in hand has no answer at all yet."""
        return [side for side, q in self._questions.items() if q.asked is not None and not q.answers]

    def _note_asked(self) -> None:
        self.state.prompt.asked = frozenset(s for s, q in self._questions.items() if q.asked is not None)

    def poll(self) -> None:
        """Take answers when there are any, and hand the style to the controller once; call once a frame."""
        for side, question in self._questions.items():
            result = question.worker.poll() if question.worker is not None else None
            # an answer to an older request must not overwrite newer words
            if result is not None and result.request == question.asked:
                self._take(side, question, result)
            if question.asked is None and question.then is not None:
                self._ask(side, *question.then)
        self._hand_over()

    def _take(self, side: Side, question: _Question, result: Any) -> None:
        if result.final:
            question.asked = None
            self._note_asked()
        if result.error is not None:
            self._fail(result.error)
            return
        before, answer = getattr(self.state.prompt.edit, side), Answer.of(result)
        prompted, followed = isinstance(result.request, str), bool(question.answers)
        if not prompted:
            known = before or dataclasses.replace(answer, prompt="", said=result.request)
            answer = dataclasses.replace(known, words=result.request, z=result.z, final=True)
        elif before is not None and not followed:
            answer = answer.keeping(_locked(self.state.prompt.edit, side), before)
        if followed:
            self._improve(side, answer, question)
        else:
            self._adopt(side, answer, question)
        in_force = getattr(self.state.prompt.edit, side)
        if side == "a":
            self.state.prompt.parts = dict(in_force.words.to_mapping())
        if not followed or in_force.words != before.words:
            # the first style is there at once
            self._due_seconds = self.state.settings.blend_seconds if self._styled else 0.0
        if question.remembered and prompted:
            settings = self.state.settings
            settings.prompt_history = remember(settings.prompt_history, result.request)
        if prompted and (self._styled or answer.note):  # the first answers without a word
            model = self.state.expander.language_model or "the language model"
            self.state.messages.post(*answer_message(answer, question.label, model, followed))

    def _adopt(self, side: Side, answer: Answer, question: _Question) -> None:
        """Put a question's first answer into force, as a step of undo."""
        edit = self.state.prompt.edit
        changes: dict[str, Any] = {side: answer}
        if side == "b" and not any(edit.weights):
            changes["weights"] = FIRST_BLEND
        self.state.prompt.edit = dataclasses.replace(edit, **changes)
        self.history.push(question.label, self.state.prompt.edit)
        question.answers = (answer,)

    def _improve(self, side: Side, answer: Answer, question: _Question) -> None:
        """Put a better answer in the place of the first one, in the prompt's step and in all that was done to it since.

        Where a part was locked after the first answer, it keeps that answer's words.
        """
        found: list[Answer] = []

        def improved(edit: StyleEdit) -> StyleEdit:
            first = getattr(edit, side)
            if first not in question.answers:
                return edit
            found.append(answer.keeping(_locked(edit, side), first))
            change: dict[str, Any] = {side: found[-1]}
            return dataclasses.replace(edit, **change)

        committed = self.state.prompt.edit is self.history.top
        self.history.revise(improved)
        top = self.history.top
        # what is committed must stay the very same object, by which `commit` knows it
        self.state.prompt.edit = top if committed and top is not None else improved(self.state.prompt.edit)
        question.answers = tuple(found)

    def _hand_over(self) -> None:
        """Give the style that is due to the controller; folding it costs about a millisecond."""
        controller, edit = self.state.simulation.controller, self.state.prompt.edit
        if self._due_seconds is None or controller is None:
            return
        seconds, self._due_seconds = self._due_seconds, None
        style = edit.style()
        if style is None:
            return
        self._styled = True
        try:
            controller.set_style(style, seconds)
        except SportError as error:
            self._fail(error)
            return
        self.mark(write_words(edit.replayable()), seconds, edit.spelled_out())

    def _fail(self, error: SportError) -> None:
        self.state.messages.error(error)
        self.first_error = self.first_error or error


def _locked(edit: StyleEdit, side: Side) -> frozenset[str]:
    """Parts whose words the answers on a side leave alone."""
    return edit.locked if side == "a" else frozenset()


def _named(part: str) -> str:
    return part.replace("_", " ")


def _short(text: str, limit: int = 40) -> str:
    line = " ".join(text.split())
    return line if len(line) <= limit else line[: limit - 1] + "…"
