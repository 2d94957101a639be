"""The prompt room without a window: prompts, locks and blends as steps of the session, and the style that is handed over."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from runtime.prompts.answer import Answer
from runtime.prompts.blend import ALL_A
from runtime.prompts.expander import DEFAULT_PROMPT
from runtime.prompts.parts import PartDescriptions
from runtime.session.history import History, Step
from runtime.session.prompt_blend import PromptBlend, Side
from runtime.session.session import LIVE, Session, Variant
from runtime.skeleton import PART_NAMES
from runtime.takes.recorder import LIVE_SECONDS
from tests.helpers.viewer_fakes import FakeEncoder
from viewer.editor import Editor
from viewer.jobs import Jobs
from viewer.messages import Messages
from viewer.prompt.prompt_controller import FIRST_STYLE_SECONDS, PromptController
from viewer.settings import Settings


class FakeFile:
    """Keeps nothing."""

    problem = ""

    def write(self, history: History) -> None:
        pass


def words(prompt: str, source: str = "library") -> PartDescriptions:
    """What an expander makes of a prompt."""
    return PartDescriptions(*(f"{part} of {prompt} by {source}" for part in PART_NAMES))


class Worker:
    """A worker whose answers the test gives."""

    def __init__(self, sign: float = 1.0) -> None:
        self.sign = sign  # of the codes of its model
        self.request: str | PartDescriptions | None = None
        self.given: Answer | None = None

    def code(self, said: PartDescriptions) -> np.ndarray:
        return self.sign * FakeEncoder().encode(said)

    def submit(self, prompt: str | PartDescriptions) -> None:
        self.request, self.given = prompt, None

    def withdraw(self) -> None:
        self.request = self.given = None

    def give(self, source: str, final: bool) -> None:
        """Answer the request at the next poll."""
        request = self.request
        assert request is not None
        said = words(request, source) if isinstance(request, str) else request
        self.given = dataclasses.replace(self.answer(said), source=source, final=final)
        if isinstance(request, str):
            self.given = dataclasses.replace(self.given, prompt=request)
        self.request = None if final else request

    def answer(self, said: PartDescriptions) -> Answer:
        return Answer("", said, said, self.code(said))

    def poll(self) -> Answer | None:
        given, self.given = self.given, None
        return given

    def close(self, timeout_s: float = 2.0) -> bool:
        return True


class Room:
    """The controller on a session without a file, and a character that remembers its styles."""

    def __init__(self) -> None:
        self.messages, self.settings = Messages(logged=False), Settings(blend_seconds=2.0)
        self.editor = Editor(self.messages, FakeFile())  # type: ignore[arg-type]
        self.styles: list[tuple[Any, float]] = []
        self.marks: list[tuple[PromptBlend, float]] = []
        character: Any = SimpleNamespace(set_style=lambda z, seconds: self.styles.append((z, seconds)))
        self.controller = PromptController(
            self.editor, self.settings, self.messages, Jobs(self.messages, blocking=True), lambda: character,
            lambda blend, seconds: self.marks.append((blend, seconds)),
        )  # fmt: skip
        self.workers = Worker(), Worker()
        self.controller.use(self.workers)  # type: ignore[arg-type]

    @property
    def prompt(self) -> PromptBlend:
        return self.editor.session.live.prompt

    @property
    def labels(self) -> list[str]:
        """Of what can be undone and what can be redone, with a mark between."""
        history = self.editor.history
        names = [step.label for step in history.steps]
        return [*names[1 : history.at + 1], "|", *names[history.at + 1 :]]

    @property
    def message(self) -> str:
        return self.messages.recent[-1].text

    def submit(self, text: str, side: Side = Side.A, final: bool = True) -> None:
        """A prompt that the library answers."""
        self.controller.submit_prompt(text, side)
        self.give(side, "library", final)

    def give(self, side: Side = Side.A, source: str = "library", final: bool = True) -> None:
        self.workers[side].give(source, final)
        self.controller.poll()

    def edit(self, part: str, text: str) -> None:
        self.controller.parts[part] = text
        self.controller.submit_part(part)
        self.give()


@pytest.fixture
def room() -> Room:
    """A character that walks as a king."""
    made = Room()
    made.submit("a king")
    return made


# --- steps
def test_every_edit_is_a_step_in_words_of_the_user(room: Room) -> None:
    controller = room.controller
    room.submit("an old\nking")
    room.edit("left_arm", "hanging")
    controller.toggle_lock("head")
    room.submit("a duck", Side.B)
    controller.set_weight("torso", 0.2)
    controller.set_weight("torso", 0.7)
    controller.set_all_weights(0.9)
    controller.swap()
    controller.drop_blend()
    controller.reset_part("torso")
    assert room.labels[:-1] == [
        "prompt “an old king”",
        "words of the left arm",
        "lock of the head",
        "prompt B “a duck”",
        "blend of the torso",
        "blend of all parts",
        "swap of A and B",
        "end of the blend",
    ]


def test_the_first_prompt_is_no_step_and_holds_in_every_step() -> None:
    room = Room()
    room.controller.begin(None)
    room.controller.toggle_lock("head")
    room.give()
    assert room.labels == ["lock of the head", "|"]
    assert room.settings.prompt_history == []  # nobody typed it
    room.editor.undo()
    assert (room.prompt.prompt(Side.A), room.prompt.locked) == (DEFAULT_PROMPT, frozenset())
    assert room.styles[0][1] == FIRST_STYLE_SECONDS


def test_the_program_begins_with_a_blend() -> None:
    room = Room()
    room.controller.begin("a king", "a duck", (0.25,) * 6)
    room.give()
    room.give(Side.B)
    assert (room.prompt.weights, room.prompt.prompt(Side.B)) == ((0.25,) * 6, "a duck")
    assert room.settings.prompt_history == ["a duck", "a king"]


def test_a_slider_is_one_step_and_follows_the_hand(room: Room) -> None:
    room.submit("a duck", Side.B)
    styles = len(room.styles)
    for weight in (0.1, 0.2, 0.3):
        room.controller.set_weight("torso", weight)
        room.controller.poll()
    assert [seconds for _, seconds in room.styles[styles:]] == [LIVE_SECONDS] * 3
    room.editor.finish_drag()
    room.controller.poll()
    assert len(room.styles) == styles + 3
    assert room.labels[-2] == "blend of the torso"
    room.editor.undo()
    room.controller.poll()
    assert room.prompt.weights == (0.5,) * 6
    assert room.styles[-1][1] == room.settings.blend_seconds


def test_three_changes_in_a_frame_are_one_style(room: Room) -> None:
    room.submit("a duck", Side.B)
    styles = len(room.styles)
    room.controller.set_all_weights(0.0)
    room.controller.set_weight("torso", 1.0)
    room.controller.set_weight("head", 0.25)
    room.controller.poll()
    room.controller.poll()
    assert len(room.styles) == styles + 1
    assert room.marks[-1][0] == room.prompt


def test_a_lock_is_no_new_style(room: Room) -> None:
    styles = len(room.styles)
    room.controller.toggle_lock("head")
    room.controller.poll()
    room.editor.undo()
    room.controller.poll()
    assert len(room.styles) == styles


def test_the_end_of_a_blend_keeps_locked_parts(room: Room) -> None:
    room.submit("a duck", Side.B)
    room.controller.toggle_lock("head")
    room.controller.boxes[Side.B].text = ""  # the field was emptied
    room.controller.drop_blend()
    assert room.prompt.weights == (*ALL_A[:5], 0.5)
    assert room.controller.boxes[Side.B].text == "a duck"
    assert "Locked parts keep their weight of prompt B: head." in room.message
    room.controller.toggle_lock("head")
    room.controller.drop_blend()
    assert (room.prompt.b, room.controller.boxes[Side.B].text) == (None, "")


# --- the session as a whole
def test_another_session_brings_its_prompt_and_drops_questions(room: Room) -> None:
    other = room.prompt
    room.submit("a duck")
    room.controller.boxes[Side.A].text = "typed"
    room.controller.submit_prompt("a goose")
    opened = Session().with_take(LIVE, prompt=other)
    room.editor.use(FakeFile(), History([Step(0, "", opened)]))  # type: ignore[arg-type]
    room.controller.poll()
    assert not room.controller.pending
    assert room.controller.boxes[Side.A].text == "a king"
    assert np.array_equal(room.styles[-1][0].codes, other.style().codes)
    room.editor.undo()
    assert room.prompt is other


def test_another_model_encodes_every_step_before_it_is_asked_anything_new(room: Room) -> None:
    room.submit("a duck")
    room.controller.toggle_lock("head")
    room.editor.amend(lambda s: replace(s, variants=(Variant(1, s.live.prompt),)))
    room.controller.submit_prompt("a goose")
    workers = Worker(-1.0), Worker(-1.0)
    room.controller.use(workers)  # type: ignore[arg-type]
    room.workers = workers
    assert workers[0].request == "a goose"
    room.controller.poll()
    assert np.array_equal(room.styles[-1][0].codes, [workers[0].code(words("a duck"))])
    room.give()
    assert np.array_equal(room.prompt.a.z, workers[0].code(room.prompt.a.words))
    kept = room.editor.session.variants[0].prompt.a
    assert np.array_equal(kept.z, workers[0].code(kept.words))
    for _ in range(3):
        room.editor.undo()
    room.controller.poll()
    assert np.array_equal(room.styles[-1][0].codes, [workers[0].code(words("a king"))])


def test_the_same_model_loaded_again_gets_the_style_it_had(room: Room) -> None:
    before = room.prompt
    room.controller.use((Worker(-1.0), Worker(-1.0)), again=False)  # type: ignore[arg-type]
    room.controller.poll()
    assert room.prompt is before
    assert np.array_equal(room.styles[-1][0].codes, before.style().codes)


def test_what_the_character_does_already_is_not_handed_over(room: Room) -> None:
    king, styles = room.prompt, len(room.styles)
    room.submit("a duck")
    room.controller.adopt("choice of “a king”", lambda s: s.with_take(LIVE, prompt=king))
    room.controller.poll()
    assert len(room.styles) == styles + 1
    assert room.controller.boxes[Side.A].text == "a king"
    room.editor.undo()
    room.controller.poll()
    assert np.array_equal(room.styles[-1][0].codes, [room.workers[0].code(words("a duck"))])


# --- against a model
@dataclass(frozen=True)
class Side_:
    """One side of the model: its prompt, its words by part, what was said, and the question that they answer."""

    prompt: str
    words: tuple[str, ...]
    said: tuple[str, ...]
    number: int


@dataclass(frozen=True)
class Known:
    """A blend in the model."""

    sides: tuple[Side_ | None, Side_ | None] = (None, None)
    weights: tuple[float, ...] = ALL_A
    locked: frozenset[str] = frozenset()

    def put(self, side: Side, value: Side_ | None) -> Known:
        return replace(self, sides=(value, self.sides[1]) if side is Side.A else (self.sides[0], value))

    def holds(self, side: Side, part: str) -> bool:
        at = PART_NAMES.index(part)
        return part in self.locked and (side is Side.A or self.weights[at] > 0.0)


@dataclass
class Asked:
    """A question of the model."""

    number: int
    label: str
    prompt: str  # "" for words
    words: tuple[str, ...] = ()
    answered: bool = False


PROMPTS = st.sampled_from(["king", "duck", "goose"])
PARTS = st.sampled_from(PART_NAMES)
SIDES = st.sampled_from(list(Side))
WEIGHTS = st.sampled_from([0.0, 0.25, 0.5, 1.0])


class Prompts(RuleBasedStateMachine):
    """The room and the editor against a list of blends with a cursor."""

    def __init__(self) -> None:
        super().__init__()
        self.room = Room()
        self.steps: list[tuple[str, Known]] = [("", Known())]
        self.at = 0
        self.draft: tuple[str, Known] | None = None
        self.asked: list[Asked | None] = [None, None]
        self.number = 0
        self.ask(Side.A, "start", "prompt “start”")
        self.room.controller.submit_prompt("start")
        self.answer_on(Side.A, True)

    # the model

    @property
    def now(self) -> Known:
        return self.draft[1] if self.draft else self.steps[self.at][1]

    def do(self, label: str, after: Known) -> None:
        self.finish()
        if after != self.now:
            self.steps = [*self.steps[: self.at + 1], (label, after)]
            self.at += 1

    def finish(self) -> None:
        draft, self.draft = self.draft, None
        if draft and draft[1] != self.steps[self.at][1]:
            self.do(*draft)

    def revise(self, change: Any) -> None:
        self.steps = [(label, change(known)) for label, known in self.steps]
        self.draft = self.draft and (self.draft[0], change(self.draft[1]))

    def ask(self, side: Side, prompt: str, label: str, said: tuple[str, ...] = ()) -> None:
        self.number += 1
        self.asked[side] = Asked(self.number, label, prompt, said)

    def drop_stale(self) -> None:
        for side, asked in zip(Side, tuple(self.asked), strict=True):
            held = self.now.sides[side]
            if asked and asked.answered and (held is None or held.number != asked.number):
                self.asked[side] = None

    def answer_on(self, side: Side, final: bool) -> None:
        asked = self.asked[side]
        source = "gpt" if asked.answered else "library"
        self.room.give(side, source, final or not asked.prompt)
        said = words(asked.prompt, source).as_tuple() if asked.prompt else asked.words

        def kept(known: Known, old: Side_) -> tuple[str, ...]:
            return tuple(
                b if known.holds(side, part) else n
                for part, b, n in zip(PART_NAMES, old.words, said, strict=True)
            )

        def better(known: Known) -> Known:
            old = known.sides[side]
            if old is None or old.number != asked.number:
                return known
            return known.put(side, Side_(asked.prompt, kept(known, old), said, asked.number))

        def first(known: Known) -> Known:
            old = known.sides[side]
            if asked.prompt:
                new = Side_(asked.prompt, kept(known, old) if old else said, said, asked.number)
                known = known.put(side, new)
                if side is Side.B and not any(known.weights):
                    known = self.all_weights(known, 0.5)
                return known
            changed = {p for p, b, n in zip(PART_NAMES, old.words, said, strict=True) if b != n}
            edited = {p for p, s, n in zip(PART_NAMES, old.said, said, strict=True) if s != n}
            known = known.put(side, replace(old, words=said, number=asked.number))
            return replace(known, locked=known.locked - changed | (changed & edited))

        if asked.answered:
            self.revise(better)
        elif side is Side.A and self.now.sides[0] is None:
            self.revise(first)
        else:
            self.do(asked.label, first(self.now))
        asked.answered = True
        if final or not asked.prompt:
            self.asked[side] = None

    @staticmethod
    def all_weights(known: Known, weight: float) -> Known:
        pairs = zip(PART_NAMES, known.weights, strict=True)
        return replace(known, weights=tuple(w if p in known.locked else weight for p, w in pairs))

    # what a user does

    @rule(text=PROMPTS, side=SIDES)
    def submit(self, text: str, side: Side) -> None:
        self.room.controller.submit_prompt(text, side)
        self.ask(side, text, f"prompt {'B ' if side else ''}“{text}”")

    @rule(side=SIDES, final=st.booleans())
    def answer(self, side: Side, final: bool) -> None:
        asked = self.asked[side]
        if asked is not None:
            self.answer_on(side, final or asked.answered)

    @rule(part=PARTS)
    def lock(self, part: str) -> None:
        self.room.controller.toggle_lock(part)
        self.do(f"lock of the {part.replace('_', ' ')}", replace(self.now, locked=self.now.locked ^ {part}))

    @rule(part=PARTS, text=st.sampled_from(["hanging", "shaking"]))
    def edit(self, part: str, text: str) -> None:
        a = self.now.sides[0]
        self.room.controller.parts = dict(zip(PART_NAMES, a.words, strict=True)) | {part: text}
        self.room.controller.submit_part(part)
        said = tuple(self.room.controller.parts.values())
        if said != a.words:
            self.ask(Side.A, "", f"words of the {part.replace('_', ' ')}", said)

    @rule(part=PARTS, weight=WEIGHTS)
    def drag(self, part: str, weight: float) -> None:
        self.room.controller.set_weight(part, weight)
        at, known = PART_NAMES.index(part), self.now
        if part not in known.locked:
            weights = (*known.weights[:at], weight, *known.weights[at + 1 :])
            self.drag_to(f"blend of the {part.replace('_', ' ')}", replace(known, weights=weights))

    @rule(weight=WEIGHTS)
    def drag_all(self, weight: float) -> None:
        self.room.controller.set_all_weights(weight)
        self.drag_to("blend of all parts", self.all_weights(self.now, weight))

    def drag_to(self, label: str, after: Known) -> None:
        if self.draft and self.draft[0] != label:
            self.finish()
        if after != self.now:
            self.draft = label, after

    @rule()
    def let_go(self) -> None:
        self.room.editor.finish_drag()
        self.finish()

    @rule()
    def swap(self) -> None:
        self.room.controller.swap()
        known = self.now
        if known.sides[1] is not None and self.asked == [None, None]:
            flipped = tuple(1.0 - w for w in known.weights)
            self.do("swap of A and B", replace(known, sides=known.sides[::-1], weights=flipped))

    @rule()
    def drop(self) -> None:
        self.room.controller.drop_blend()
        self.asked[Side.B] = None
        known = self.now
        if known.sides[1] is None:
            return
        if any(known.holds(Side.B, part) for part in PART_NAMES):
            self.do("end of the blend", self.all_weights(known, 0.0))
        else:
            self.do("end of the blend", replace(known.put(Side.B, None), weights=ALL_A))

    @rule()
    def undo(self) -> None:
        self.room.editor.undo()
        self.finish()
        unanswered = [side for side in Side if (asked := self.asked[side]) and not asked.answered]
        for side in unanswered:
            self.asked[side] = None
        if not unanswered:
            self.at = max(self.at - 1, 0)

    @rule()
    def redo(self) -> None:
        self.room.editor.redo()
        self.finish()
        self.at = min(self.at + 1, len(self.steps) - 1)

    @precondition(lambda self: self.draft is None)
    @rule()
    def another_model(self) -> None:
        sign = -self.room.workers[0].sign
        self.room.workers = Worker(sign), Worker(sign)
        self.room.controller.use(self.room.workers)  # type: ignore[arg-type]

    # what holds

    @invariant()
    def as_the_model_says(self) -> None:
        if not hasattr(self, "asked"):
            return
        self.drop_stale()
        names = [label for label, _ in self.steps]
        assert self.room.labels == [*names[1 : self.at + 1], "|", *names[self.at + 1 :]]
        blend = self.room.prompt
        for side in Side:
            known, answer = self.now.sides[side], blend.answers[side]
            assert (known is None) == (answer is None)
            if known is not None and answer is not None:
                assert (answer.prompt, answer.words.as_tuple()) == (known.prompt, known.words)
                assert np.array_equal(answer.z, self.room.workers[0].code(answer.words))
        assert (blend.weights, blend.locked) == (self.now.weights, self.now.locked)
        assert self.room.controller.pending == {side for side in Side if self.asked[side]}

    @invariant()
    def the_character_moves_by_the_session(self) -> None:
        if not hasattr(self, "asked"):
            return
        self.room.controller.poll()
        given, wanted = self.room.styles[-1][0], self.room.prompt.style()
        assert given.weights == wanted.weights
        assert all(map(np.array_equal, (*given.codes, given.edits), (*wanted.codes, wanted.edits)))


TestPrompts = Prompts.TestCase
TestPrompts.settings = settings(max_examples=60, stateful_step_count=40, deadline=None, derandomize=True)
