"""Edits of a session as functions: numbers, selection, trims and labels hold after any of them, and history gives each back."""

from dataclasses import replace
from functools import reduce

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.session import edits
from runtime.session.history import MAX_STEPS, History
from runtime.session.motion import Motion
from runtime.session.session import LIVE, Reference, Session, Take
from runtime.skeleton import J
from runtime.takes.clip import Clip
from runtime.takes.pins import Pin, Pinned
from runtime.takes.pose_edits import PoseEdits

whole = st.integers(-50, 50)


def motion(frames: int, name: str = "Take") -> Motion:
    """Somebody who stands still."""
    local = np.tile(np.float32([1, 0, 0, 0]), (frames, J, 1))
    hips, contacts = np.zeros((frames, 3), np.float32), np.ones((frames, 4), np.float32)
    return Motion.of(Clip(name, 60.0, hips, local, contacts))


def session_of(*frames: int) -> Session:
    return reduce(edits.with_new_take, [Take(motion=motion(count)) for count in frames], Session())


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
    assert edits.without_take(replace(session_of(9), reference=film), 1).reference == film


def test_names_of_motion_and_user() -> None:
    session = edits.with_new_take(Session(), Take(motion=motion(9, "Take 1")))
    session = edits.renamed(session, 1, "  A proud \n walk ")
    assert session.takes[0].title == "A proud walk"
    assert edits.mirrored_copy(session, 1).takes[1].title == "A proud walk, mirrored"
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


def test_steps_that_jobs_still_make_are_never_the_oldest_one() -> None:
    history = History()
    for count in range(MAX_STEPS + 20):  # as many files, opened at once
        history.push(f"opening {count}", replace(Session(), counter=count), awaited=True)
    assert not history.steps[0].awaited
    assert history.settled.present.session == Session()
    history.push("another", Session())
    history.push("and another", Session())
    assert not history.steps[0].awaited
