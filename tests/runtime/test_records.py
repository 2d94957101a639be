"""State as data: copies that are apart, many records joined and taken apart, files that are checked by the annotations."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.arrays import Array
from runtime.controls import Controls
from runtime.errors import FileError
from runtime.motion.controller import Controller
from runtime.records import copied, joined, part, read_record, write_record
from runtime.terrain.height_map import Terrain
from tests.helpers.walker import WalkerModel

PLACE = st.floats(-1e6, 1e6)


@dataclass
class Foot:
    height: float = 0.0
    hold: str = field(default="", metadata={"choices": ("", "toe")})
    yaw: float | None = None


@dataclass
class Walker:
    place: Array = field(metadata={"shape": (2,)})
    feet: tuple[Foot, ...] = (Foot(), Foot())
    steps: tuple[int, int] = (0, 0)


def walker(x: float = 0.0, feet: tuple[Foot, ...] | None = None) -> Walker:
    return Walker(np.array([[x, 1.0]]), feet or (Foot(), Foot()))


@given(PLACE, PLACE, st.none() | PLACE, st.sampled_from(["", "toe"]))
def test_a_record_comes_back_from_its_file(x: float, height: float, yaw: float | None, hold: str) -> None:
    one = walker(x, (Foot(height, hold, yaw), Foot()))
    arrays: list[np.ndarray] = []
    again = read_record(Walker, write_record(one, arrays), arrays, "file")
    assert np.array_equal(again.place, one.place)
    assert (again.feet, again.steps) == (one.feet, one.steps)


def test_a_copy_is_apart_down_to_its_last_record() -> None:
    one = walker()
    other = copied(one)
    other.feet[0].height, other.steps = 1.0, (3, 4)
    assert one.feet[0].height == 0.0
    assert one.steps == (0, 0)
    assert other.place is one.place  # arrays of a state are never written to


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda tree: tree.pop("steps"), "not the fields of a Walker"),
        (
            lambda tree: tree["feet"][1].update(hold="heel"),
            r"file\.feet\[1\]\.hold: expected one of '', 'toe'",
        ),
        (lambda tree: tree["feet"][0].update(yaw=float("nan")), r"\.yaw: a number out of range"),
        (lambda tree: tree["feet"][0].update(height=True), r"\.height: expected a number"),
        (lambda tree: tree.update(steps=[1.5, 2]), r"\.steps\[0\]: expected a whole number"),
        (lambda tree: tree.update(steps=[1, 2, 3]), r"\.steps: expected 2 values"),
        (lambda tree: tree.update(place=7), r"\.place: refers to no array"),
        (lambda tree: tree.update(feet={}), r"\.feet: expected a list"),
    ],
)
def test_what_is_no_such_record_is_refused_by_name(change, says: str) -> None:
    arrays: list[np.ndarray] = []
    tree = write_record(walker(), arrays)
    change(tree)
    with pytest.raises(FileError, match=says):
        read_record(Walker, tree, arrays, "file")


def test_a_step_leaves_the_state_before_it_as_it_was() -> None:
    controller = Controller(WalkerModel(), Terrain.flat(), seed=2)
    for _ in range(20):
        controller.step(Controls((0.3, 1.0)))
    before: list[np.ndarray] = []
    state = copied(controller.state)
    state.styles = ()
    tree = write_record(state, before)
    before = [array.copy() for array in before]
    controller.step(Controls((0.3, 1.0)))
    after: list[np.ndarray] = []
    assert write_record(state, after) == tree
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


def test_records_are_joined_and_taken_apart() -> None:
    many = joined([walker(float(k), (Foot(float(k)), Foot())) for k in range(3)])
    assert many.place.shape == (3, 2)
    assert [foot.height for foot in many.feet] == [0.0, 0.0, 1.0, 0.0, 2.0, 0.0]
    assert np.array_equal(part(many, 2).place, [[2.0, 1.0]])
