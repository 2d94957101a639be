"""Edits of a session as functions: numbers, selection, trims and labels hold after any of them, and history gives each back."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from runtime.session import edits
from runtime.session.history import MAX_STEPS, History
from runtime.session.motion import Motion
from runtime.session.session import LIVE, MIN_FRAMES, Reference, Session, Take
from runtime.skeleton import J
from runtime.takes.clip import Clip
from runtime.takes.pins import Pin, Pinned
from runtime.takes.pose_edits import PoseEdits

names = st.text("aB7 \n\t,öТ歩", max_size=90)
whole = st.integers(-50, 50)


def motion(frames: int, name: str = "Take") -> Motion:
    """Somebody who stands still."""
    local = np.tile(np.float32([1, 0, 0, 0]), (frames, J, 1))
    return Motion.of(
        Clip(name, 60.0, np.zeros((frames, 3), np.float32), local, np.ones((frames, 4), np.float32))
    )


def session_of(*frames: int) -> Session:
    return reduce(edits.with_new_take, [Take(motion=motion(count)) for count in frames], Session())


class Edits(RuleBasedStateMachine):
    """Any edits, undone and done again in between."""

    def __init__(self) -> None:
        super().__init__()
        self.history = History()
        self.given: set[int] = set()  # numbers that takes of this line of steps have, or had
        self.seen: dict[int, tuple[Session, set[int]]] = {0: (self.history.present.session, set())}

    @property
    def session(self) -> Session:
        return self.history.present.session

    def number(self, which: int) -> int:
        """The number of a take of the list, or one that none has."""
        takes = self.session.takes
        return takes[which % len(takes)].number if takes and which >= 0 else which - 1000

    def step(self, label: str, session: Session) -> None:
        if session == self.session:
            return
        self.history.push(label, session)
        assert self.history.undo_label == label
        assert self.history.redo_label == ""
        self.seen[self.history.present.number] = session, set(self.given)

    @rule(frames=st.integers(2, 40))
    def add(self, frames: int) -> None:
        before = self.session
        session = edits.with_new_take(before, Take(motion=motion(frames)))
        assert session.takes[:-1] == before.takes
        assert session.selected == session.counter not in self.given
        self.given.add(session.counter)
        self.step("recording", session)

    @rule(which=whole)
    def remove(self, which: int) -> None:
        number, before = self.number(which), self.session
        session = edits.without_take(before, number)
        assert session.take(number) is None
        if number != before.selected:
            assert session.selected == before.selected
        if before.reference is not None and before.reference.take == number and before.take(number):
            assert session.reference is None
        else:
            assert session.reference == before.reference
        self.step("removal", session)

    @rule(which=whole)
    def mirror(self, which: int) -> None:
        number = self.number(which)
        session = edits.mirrored_copy(self.session, number)
        take = self.session.take(number)
        if take is not None:
            made = session.takes[-1]
            assert (made.motion, made.mirrored) == (take.motion, not take.mirrored)
            assert made.number not in self.given
            self.given.add(made.number)
        self.step("mirror image", session)

    @rule(which=whole, name=names)
    def rename(self, which: int, name: str) -> None:
        number = self.number(which)
        session = edits.renamed(self.session, number, name)
        take = session.take(number)
        if take is not None:
            assert take.title
            assert len(take.name) <= edits.MAX_NAME
            assert take.title == " ".join(name.split())[: edits.MAX_NAME] or not name.split()
        self.step("name", session)

    @rule(which=whole, first=whole, last=whole)
    def trim(self, which: int, first: int, last: int) -> None:
        self.step("trim", edits.trimmed(self.session, self.number(which), first, last))

    @rule(which=whole, frames=st.integers(2, 40))
    def resimulate(self, which: int, frames: int) -> None:
        number = self.number(which)
        before = self.session.take(number)
        session = edits.resimulated(self.session, number, motion(frames))
        after = session.take(number)
        if before is not None and after is not None and before.range[1] == before.frames - 1:
            assert after.range[1] == frames - 1, "a trim that kept the end keeps the new one"
        self.step("resimulation", session)

    @rule(which=whole, by=st.integers(-3, 3))
    def move(self, which: int, by: int) -> None:
        number, before = self.number(which), self.session
        session = edits.moved(before, number, by)
        at = before.index(number)
        if at >= 0 and 0 <= at + by < len(before.takes):
            assert session.index(number) == at + by
        assert sorted(t.number for t in session.takes) == sorted(t.number for t in before.takes)
        self.step("order", session)

    @rule(which=whole)
    def compare(self, which: int) -> None:
        self.step("reference", replace(self.session, reference=Reference(take=self.number(which))))

    @rule(which=whole)
    def select(self, which: int) -> None:
        """No step of its own: it changes the one that is there."""
        session = edits.selected(self.session, self.number(which))
        self.history.replace(session)
        self.seen[self.history.present.number] = session, set(self.given)

    @precondition(lambda self: self.history.undo_label)
    @rule()
    def undo(self) -> None:
        label, number = self.history.undo_label, self.history.present.number
        assert self.history.go(-1)
        assert self.history.redo_label == label
        assert self.history.present.number == number - 1
        self.same_as_seen()

    @precondition(lambda self: self.history.redo_label)
    @rule()
    def redo(self) -> None:
        label = self.history.redo_label
        assert self.history.go(1)
        assert self.history.undo_label == label
        self.same_as_seen()

    def same_as_seen(self) -> None:
        session, self.given = self.seen[self.history.present.number]
        self.given = set(self.given)
        assert self.session is session

    @invariant()
    def numbers_are_given_once(self) -> None:
        numbers = [take.number for take in self.session.takes]
        assert len(numbers) == len(set(numbers))
        assert all(LIVE < number <= self.session.counter for number in numbers)
        assert set(numbers) <= self.given

    @invariant()
    def the_selected_take_is_there(self) -> None:
        assert self.session.selected == LIVE or self.session.current is not None

    @invariant()
    def trims_keep_frames_of_the_motion(self) -> None:
        for take in self.session.takes:
            first, last = take.range
            assert first >= 0
            assert last < take.frames
            assert last - first + 1 >= MIN_FRAMES
            assert take.trimmed == ((first, last) != (0, take.frames - 1))


TestEdits = Edits.TestCase
TestEdits.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)


@settings(deadline=None)
@given(st.integers(2, 60), whole, whole)
def test_a_trim_is_what_was_asked_for_as_far_as_there_are_frames(frames: int, first: int, last: int) -> None:
    session = edits.trimmed(session_of(frames), 1, first, last)
    begin, end = session.takes[0].range
    if 0 <= first < last < frames:
        assert (begin, end) == (first, last)
    assert len(session.takes[0].exported) == end - begin + 1


def test_a_removed_take_leaves_the_next_one_selected_and_no_number_comes_again() -> None:
    session = edits.selected(session_of(9, 9, 9), 2)
    session = edits.without_take(session, 2)
    assert session.selected == 3
    session = edits.without_take(session, 3)
    assert session.selected == 1
    session = edits.without_take(session, 1)
    assert (session.takes, session.selected) == ((), LIVE)
    assert edits.with_new_take(session, Take(motion=motion(5))).takes[0].number == 4


def test_a_reference_to_a_film_outlives_every_take() -> None:
    film = Reference(take=1, video="/a/walk.mp4")
    session = replace(session_of(9), reference=film)
    assert edits.without_take(session, 1).reference == film


def test_names_of_motion_and_user() -> None:
    session = edits.with_new_take(Session(), Take(motion=motion(9, "Take 1")))
    session = edits.renamed(session, 1, "  A proud \n walk ")
    assert session.takes[0].title == "A proud walk"
    mirrored = edits.mirrored_copy(session, 1).takes[1]
    assert mirrored.title == "A proud walk, mirrored"
    session = edits.renamed(session, 1, "Take 1")
    assert session.takes[0].name == ""
    assert edits.mirrored_copy(session, 1).takes[1].title == "Take 1, mirrored"
    assert edits.renamed(session, 1, "") == session
    assert edits.renamed(session, 9, "nobody") is session


def test_edits_of_a_take_that_is_not_there_and_of_the_live_character_change_nothing() -> None:
    session = session_of(9)
    for number in (LIVE, 7):
        assert edits.trimmed(session, number, 0, 3) is session
        assert edits.resimulated(session, number, motion(5)) is session
        assert edits.mirrored_copy(session, number) is session
        assert edits.without_take(session, number) is session
        assert edits.moved(session, number, 1) is session
    assert edits.selected(session, 7) is session
    assert edits.selected(session, LIVE).current is None


def test_pins_are_over_the_motion_and_a_mirror_image_begins_without_them() -> None:
    pinned = PoseEdits((Pin(Pinned.LEFT_HAND, (0.3, 1.2, 0.3), 0.0, 0.1),))
    session = session_of(12).with_take(1, poses=pinned)
    take = session.takes[0]
    assert not np.array_equal(take.clip.local_rotations, take.base_clip.local_rotations)
    assert take.clip is take.clip, "it is computed once"
    assert not edits.mirrored_copy(session, 1).takes[1].poses


def test_the_oldest_steps_are_forgotten_and_an_undone_one_by_the_next() -> None:
    history = History()
    for count in range(MAX_STEPS + 20):
        history.push(f"step {count}", replace(Session(), counter=count))
    assert len(history.steps) == MAX_STEPS + 1
    assert history.present.number == MAX_STEPS + 20
    undone = 0
    while history.go(-1):
        undone += 1
    assert (undone, history.undo_label) == (MAX_STEPS, "")
    history.push("another", Session())
    assert not history.go(1)
    assert history.present.label == "another"
