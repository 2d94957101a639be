"""Applies prompts, edited words, locks and blends to the session and the character's style."""

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from runtime.errors import PromptError, SportError
from runtime.motion.controller import Controller
from runtime.motion.style import LINEAR, Shares, mixes
from runtime.prompts.answer import Request
from runtime.prompts.blend import ALL_A, Weights
from runtime.prompts.expander import DEFAULT_PROMPT, Expander
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.service import PromptWorker
from runtime.session.prompt_blend import Answer, PromptBlend, Side
from runtime.session.session import LIVE, NO_PROMPT, Session
from runtime.session.session_file import SessionFile
from runtime.skeleton import PART_NAMES
from runtime.takes.recorder import LIVE_SECONDS
from viewer.editor import Change, Editor
from viewer.jobs import Jobs, Slot
from viewer.messages import Messages
from viewer.prompt.questions import (
    Codes,
    Question,
    answer_message,
    quoted,
    same_answers,
    with_better_answer,
    with_codes,
    with_first_answer,
    words_of_all,
)
from viewer.prompt.suggestions import PromptText, remember
from viewer.settings import Settings

Measure = Callable[[Any, Any], Shares]  # of the codes of two prompts
CLOSE_SECONDS = 30.0
FIRST_STYLE_SECONDS = 1.0  # limit of the first transition, from neutral: slow enough that no hand flies
BLOCKING_SECONDS = 60.0  # an offscreen run's time limit for an answer


@dataclass
class PromptController:
    """Edits the live character's prompt and applies the resulting style. Pairs are indexed by `Side`."""

    editor: Editor
    settings: Settings
    messages: Messages
    jobs: Jobs
    character: Callable[[], Controller | None]  # the one in use
    mark: Callable[[PromptBlend, float], None]  # receives the blend that takes effect, for the recorder
    blocking: bool = False  # offscreen: an answer arrives in the same frame
    boxes: tuple[PromptText, PromptText] = field(default_factory=lambda: (PromptText(), PromptText()))
    parts: dict[str, str] = field(default_factory=lambda: dict.fromkeys(PART_NAMES, ""))  # the six fields
    questions: list[Question | None] = field(default_factory=lambda: [None, None])
    workers: tuple[PromptWorker, PromptWorker] | None = None  # of the model in use
    available: bool = True  # False when the model could not be loaded
    loading: bool = True
    language_model: str = ""  # "model at host" of the one in use, "" when the library answers alone
    first_error: SportError | None = None
    measure: Measure | None = None  # of the model in use; None: blends stay linear
    _measured: tuple[Any, Any] | None = None  # codes of the pair of prompts measured last
    _shown: PromptBlend = NO_PROMPT  # in the fields and in use by the character
    _file: SessionFile | None = None  # of the session shown
    _exact_legs: bool = True  # setting with which the current style was made
    _due_seconds: float | None = None  # transition time of a style waiting for the character
    _styled: bool = False  # the character has received a style
    _coding: bool = False  # codes for another model are being computed
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def __post_init__(self) -> None:
        self._file = self.editor.file
        self.editor.withdraw.append(self.withdraw_unanswered)
        self.editor.followers.append(self.follow)

    @property
    def prompt(self) -> PromptBlend:
        return self.editor.session.live.prompt

    @property
    def pending(self) -> set[Side]:
        """Sides that wait for an answer."""
        return {side for side in Side if self.questions[side] is not None}

    @property
    def texts(self) -> list[str]:
        return [*(box.text for box in self.boxes), *self.parts.values()]

    def applied(self, part: str) -> str:
        """Return the words in force for a part; "" before the first answer."""
        return part_words(self.prompt)[part]

    # --- words

    def begin(self, prompt: str | None, blend: str | None = None, weights: Weights = ALL_A) -> None:
        """Request the prompts of the program's start; None is the default walk."""
        self.submit_prompt(DEFAULT_PROMPT if prompt is None else prompt, remembered=prompt is not None)
        if blend is not None:
            self.editor.amend(_with_prompt(lambda b: dataclasses.replace(b, weights=weights)))
            self.submit_prompt(blend, Side.B)

    def submit_prompt(self, text: str, side: Side = Side.A, remembered: bool = True) -> None:
        """Expand a prompt and blend to it; locked and edited parts keep their words. An empty prompt shows a hint."""
        self.boxes[side].text = text
        label = f"prompt {quoted(text)}" if side is Side.A else f"prompt B {quoted(text)}"
        self._ask(side, Question(text, label, remembered))

    def submit_part(self, part: str, label: str = "") -> None:
        """Encode a part's edited words and lock it; an empty field restores the expander's words."""
        if not self.parts[part].strip():
            self.reset_part(part)
            return
        try:
            words = PartDescriptions.from_mapping(self.parts)
        except SportError as error:
            self.messages.error(error)
            return
        self.parts = dict(words.to_mapping())
        if self.prompt.a is None or words != self.prompt.a.words:
            self._ask(Side.A, Question(words, label or f"words of the {named(part)}"))

    def reset_part(self, part: str) -> None:
        """Restore the expander's words of a part and unlock it."""
        answer = self.prompt.a
        if answer is not None:
            self.parts[part] = getattr(answer.said, part)
            self.submit_part(part, f"reset of the {named(part)}")

    def toggle_lock(self, part: str) -> None:
        """Lock or unlock a part: a locked part ignores new prompts and weight changes."""
        self._do(f"lock of the {named(part)}", lambda b: dataclasses.replace(b, locked=b.locked ^ {part}))

    # --- blending

    def set_weight(self, part: str, weight: float) -> None:
        """Set the weight of prompt B in an unlocked part, during a drag."""
        if part not in self.prompt.locked:
            change = _with_prompt(lambda b: b.with_weight(part, weight))
            self.editor.drag(f"blend of the {named(part)}", change)

    def set_all_weights(self, weight: float) -> None:
        """Set the weight of prompt B in all unlocked parts, during a drag."""
        self.editor.drag("blend of all parts", _with_prompt(lambda b: b.with_all_weights(weight)))

    def swap(self) -> None:
        """Swap prompts A and B; the motion stays the same, and B's words become editable."""
        if self.prompt.b is not None and not self.pending:
            self._do("swap of A and B", PromptBlend.turned_round)

    def drop_blend(self) -> None:
        """Return to prompt A alone; locked parts keep their weight of prompt B."""
        self._withdraw(Side.B)
        held = self.prompt.locked_on(Side.B)
        if held and self.prompt.b is not None:
            self._do("end of the blend", lambda b: b.with_all_weights(0.0))
            names = ", ".join(map(named, sorted(held)))
            self.messages.note(f"Locked parts keep their weight of prompt B: {names}.")
        elif self.prompt.b is not None:
            self._do("end of the blend", lambda b: dataclasses.replace(b, answers=(b.a, None), weights=ALL_A))
        self.boxes[Side.B].text = self.prompt.prompt(Side.B)

    def measure_blends(self, measure: Measure | None) -> None:
        """Set the function that measures perceptual blend weights, for a newly loaded model."""
        self.measure, self._measured = measure, None

    def _even_out(self, blend: PromptBlend) -> None:
        """Measure a new pair of prompts on a worker thread, so that equal steps of a slider look equal."""
        if blend.a is None or blend.b is None or blend.shares != LINEAR or not mixes(blend.weights):
            return
        a, b, measure, last = blend.a.z, blend.b.z, self.measure, self._measured
        if measure is None or (last is not None and last[0] is a and last[1] is b):
            return
        self._measured = a, b

        def evened(shares: Shares) -> None:
            def change(other: PromptBlend) -> PromptBlend:
                same = other.a is not None and other.b is not None and other.a.z is a and other.b.z is b
                return dataclasses.replace(other, shares=shares) if same else other

            self._revise(change)

        self.jobs.submit(Slot("blend"), lambda: measure(a, b), evened, lambda _: None)

    def adopt(self, label: str, change: Change) -> None:
        """Apply a change as a step of undo whose style the character has already, so no transition follows."""
        self.editor.do(label, change)
        self.moves_by(self.prompt)

    def moves_by(self, blend: PromptBlend) -> None:
        """Record the blend that the character shows already; if the prompt in force differs, blend to that."""
        self._due_seconds = None
        self._change_style(blend, self.prompt)

    def _do(self, label: str, change: Callable[[PromptBlend], PromptBlend]) -> None:
        self.editor.do(label, _with_prompt(change))

    def _revise(self, change: Callable[[PromptBlend], PromptBlend]) -> None:
        self.editor.revise(_with_prompt(change))

    # --- the session changes

    def follow(self, _: Session, now: Session) -> None:
        """Update the fields and the character's style to the session's prompt."""
        opened, prompt, shown = self.editor.file is not self._file, now.live.prompt, self._shown
        if prompt is shown and not opened:
            return
        self._shown, self._file = prompt, self.editor.file
        for side, question in zip(Side, self.questions, strict=True):
            if question and (opened or (question.answered and not question.held_by(prompt.answers[side]))):
                self._give_up(side)
        self._fill(shown, prompt, every=opened)
        self._change_style(shown, prompt)

    def _change_style(self, old: PromptBlend, new: PromptBlend) -> None:
        """Change the character from one blend to another, immediately if only weights are dragged or measured."""
        same_weights = old.weights == new.weights
        if not same_answers(old, new):
            self._hand_over_within(self.settings.blend_seconds)
        elif not same_weights or old.shares != new.shares:
            at_once = self.editor.dragging or same_weights
            self._hand_over_within(LIVE_SECONDS if at_once else self.settings.blend_seconds)

    def _hand_over_within(self, seconds: float) -> None:
        seconds = seconds if self._styled else min(seconds, FIRST_STYLE_SECONDS)
        self._due_seconds = max(seconds, self._due_seconds or 0.0)

    def _fill(self, old: PromptBlend, new: PromptBlend, every: bool) -> None:
        for side, box in zip(Side, self.boxes, strict=True):
            if every or box.text == old.prompt(side):
                box.text = new.prompt(side)
        before, words = part_words(old), part_words(new)
        self.parts = {
            part: words[part] if every or text == before[part] else text for part, text in self.parts.items()
        }

    # --- questions

    def withdraw_unanswered(self) -> bool:
        """Cancel questions that have no answer yet, with a message; return whether there were any.

        The first prompt of a session is kept, since the character needs one.
        """
        first = self.prompt.a is None
        sides = [side for side, q in zip(Side, self.questions, strict=True) if q and not q.answered]
        sides = [side for side in sides if side is Side.B or not first]
        for side in sides:
            self._withdraw(side)
        return bool(sides)

    def _withdraw(self, side: Side) -> None:
        """Drop a pending question; if still unanswered, it is as if it had never been submitted."""
        question = self.questions[side]
        self._give_up(side)
        if question is None or question.answered:
            return
        if question.prompt:
            self.boxes[side].text = self.prompt.prompt(side)
        else:
            self.parts = part_words(self.prompt)
        self.messages.note(f"Withdrawn: {question.label}.")

    def _give_up(self, side: Side) -> None:
        self.questions[side] = None
        if self.workers is not None:
            self.workers[side].withdraw()

    def _ask(self, side: Side, question: Question) -> None:
        question.number = question.number or next(self._numbers)
        self.questions[side] = question
        if self.workers is None or self._coding:
            return  # it waits: locked parts keep their codes
        self.workers[side].submit(question.request)
        deadline = time.monotonic() + BLOCKING_SECONDS
        while self.blocking and self.questions[side] and time.monotonic() < deadline:
            self.poll()
            time.sleep(0.001)

    def poll(self) -> None:
        """Process new answers and apply the style; call once per frame."""
        if self._exact_legs != self.settings.exact_legs:
            self._exact_legs = self.settings.exact_legs
            self._hand_over_within(self.settings.blend_seconds)
        for side, worker in zip(Side, self.workers or (), strict=False):
            question = self.questions[side]
            try:
                answer, final = worker.poll(), False
            except SportError as error:
                answer, final = None, True
                self._fail(error)
            if question is not None and answer is not None:
                self._take(side, question, dataclasses.replace(answer, question=question.number))
                final = answer.final
            if final and self.questions[side] is question:
                self.questions[side] = None
        self._even_out(self.prompt)
        self._hand_over()

    def _take(self, side: Side, question: Question, answer: Answer) -> None:
        """Apply an answer: the first is an undo step, and a better one replaces it in every step.

        The first prompt of a session is not a step: every step without a prompt of its own uses it.
        """
        followed = question.answered
        if followed:
            self._revise(lambda blend: with_better_answer(blend, side, question, answer))
        elif side is Side.A and self.prompt.a is None:
            self._revise(lambda b: with_first_answer(b, side, question, answer) if b.a is None else b)
        else:
            self._do(question.label, lambda blend: with_first_answer(blend, side, question, answer))
        question.answered = True
        if question.prompt:
            self._report(side, question, answer, followed)

    def _report(self, side: Side, question: Question, answer: Answer, followed: bool) -> None:
        """Report who answered a prompt and which edited words were kept; the first answer is not reported."""
        if question.remembered:
            self.settings.prompt_history = remember(self.settings.prompt_history, question.prompt)
        if self._styled or answer.note:
            in_force = self.prompt.answers[side]
            kept = () if in_force is None else in_force.edited
            model = self.language_model or "the language model"
            self.messages.post(*answer_message(answer, quoted(question.prompt), model, followed, kept))

    def _hand_over(self) -> None:
        """Give the pending style to the character; folding it costs about a millisecond."""
        character = self.character()
        if self._due_seconds is None or character is None or self._coding:
            return
        style = self.prompt.style(self.settings.exact_legs)
        if style is None:
            return
        seconds, self._due_seconds = self._due_seconds, None
        self._styled = True
        try:
            character.set_style(style, seconds)
        except SportError as error:
            self._fail(error)
            return
        self.mark(self.prompt, seconds)

    def _fail(self, error: SportError) -> None:
        self.messages.error(error)
        self.first_error = self.first_error or error

    # --- workers

    def use(self, workers: tuple[PromptWorker, PromptWorker], again: bool = True) -> None:
        """Use the workers of a loaded model; `again`: existing codes are from another model."""
        for worker in self.workers or ():
            worker.close()
        self.workers, self.available, self.loading = workers, True, False
        self._hand_over_within(self.settings.blend_seconds)  # its character has no style yet
        if again:
            self.ask_again()
        else:
            self._ask_waiting()

    def ask_again(self) -> None:
        """Encode the words of all steps anew for the model in use; new questions wait until that is done."""
        words = words_of_all([step.session for step in self.editor.history.steps])
        if self.workers is None:
            return
        worker, self._coding = self.workers[Side.A], True

        def recode(codes: Codes) -> None:
            self._coding = False
            if codes:
                self.editor.revise(lambda session: with_codes(session, codes))
            self._ask_waiting()

        self.jobs.submit(
            Slot("prompts"), lambda: {w: worker.answer(w).z for w in words}, recode, lambda _: recode({})
        )

    def _ask_waiting(self) -> None:
        for side, question in zip(Side, tuple(self.questions), strict=True):
            if question is not None:
                self._ask(side, question)

    def lose_model(self) -> None:
        self.available = self.loading = False

    def use_expander(self, expander: Expander) -> None:
        """Use another expander from the next prompt on."""
        for worker in self.workers or ():
            worker.use(expander)

    def answer(self, request: Request) -> Answer:
        """Return the final answer to a prompt or six descriptions, for a take; blocks, so call it on a worker."""
        if self.workers is None:
            raise PromptError("No model is loaded to read a prompt.", "Wait until it is loaded.")
        return self.workers[Side.A].answer(request)

    def close(self, seconds: float = CLOSE_SECONDS) -> None:
        """Stop the workers within `seconds`, after the text being encoded."""
        end = time.monotonic() + seconds
        for worker in self.workers or ():
            worker.close(max(end - time.monotonic(), 0.0))


def _with_prompt(change: Callable[[PromptBlend], PromptBlend]) -> Change:
    """Convert a change of the live character's prompt to a change of the session; the same session if nothing changes."""

    def changed(session: Session) -> Session:
        prompt = change(session.live.prompt)
        return session if prompt is session.live.prompt else session.with_take(LIVE, prompt=prompt)

    return changed


def part_words(blend: PromptBlend) -> dict[str, str]:
    """Return the words of each part of prompt A; "" before its first answer."""
    return dict.fromkeys(PART_NAMES, "") if blend.a is None else dict(blend.a.words.to_mapping())


def named(part: str) -> str:
    """Return a body part's name in words."""
    return part.replace("_", " ")
