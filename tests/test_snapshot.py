"""Snapshots of a controller: what follows from one is the same, bit by bit, from memory and from bytes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.errors import FileError
from runtime.motion.controller import Controller
from runtime.motion.model import MotionModel, load_model
from runtime.motion.snapshot import Snapshot, take_snapshot
from runtime.pose import Pose
from runtime.terrain.library import make_terrain


@pytest.fixture(scope="module")
def model() -> MotionModel:
    return load_model()


def controls(frame: int) -> Controls:
    gait = Gait.JUMP if frame == 130 else Gait.JOG if frame % 100 > 60 else Gait.WALK
    return Controls((float(np.sin(frame / 40)), float(np.cos(frame / 40))), None, gait)


def play(controller: Controller, first: int, last: int) -> list[Pose]:
    return [controller.step(controls(frame)) for frame in range(first, last)]


def same(one: list[Pose], two: list[Pose]) -> bool:
    return all(
        np.array_equal(a.local_rotations, b.local_rotations)
        and np.array_equal(a.hips_position, b.hips_position)
        and np.array_equal(a.contacts, b.contacts)
        for a, b in zip(one, two, strict=True)
    )


@pytest.fixture
def walked(model: MotionModel) -> Controller:
    """In the middle of a blend on hills."""
    controller = Controller(model, make_terrain("hills"), seed=3)
    style = np.random.default_rng(0).normal(size=(6, 64)).astype(np.float32) * 0.5
    play(controller, 0, 80)
    controller.set_style(style, 1.0)
    play(controller, 80, 110)
    return controller


def test_what_follows_is_the_same_again(walked: Controller) -> None:
    snapshot = take_snapshot(walked)
    once = play(walked, 110, 170)
    snapshot.restore(walked)
    assert same(play(walked, 110, 170), once)


def test_the_same_in_another_controller_from_bytes(walked: Controller, model: MotionModel) -> None:
    data = take_snapshot(walked).to_bytes()
    once = play(walked, 110, 170)
    other = Controller(model, make_terrain("hills"), seed=8)
    play(other, 0, 25)
    Snapshot.from_bytes(data).restore(other)
    assert same(play(other, 110, 170), once)


def test_a_file_with_the_former_name_of_an_attribute_is_read(walked: Controller) -> None:
    state = take_snapshot(walked)
    trajectory = state.tree["_trajectory"]
    former = {
        ("wished_yaw" if name == "requested_yaw" else name): value for name, value in trajectory.items()
    }
    assert former.keys() != trajectory.keys()
    old = dataclasses.replace(state, tree=state.tree | {"_trajectory": former})
    assert Snapshot.from_bytes(old.to_bytes()).tree["_trajectory"].keys() == trajectory.keys()


def test_a_snapshot_holds_what_changes_and_not_what_follows_later(walked: Controller) -> None:
    snapshot = take_snapshot(walked)
    before = snapshot.to_bytes()
    play(walked, 110, 120)
    assert snapshot.to_bytes() == before
    assert take_snapshot(walked).to_bytes() != before


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", b"x" * 100])
def test_other_bytes_are_refused(damage: bytes) -> None:
    with pytest.raises(FileError, match=r"take\.state: not the state"):
        Snapshot.from_bytes(damage, "take.state")


def test_a_state_of_another_shape_is_refused_by_name(walked: Controller) -> None:
    snapshot = take_snapshot(walked)
    tree = snapshot.tree | {"_body": snapshot.tree["_body"] | {"joints": np.zeros((30, 3))}}
    with pytest.raises(FileError, match=r"controller\._body\.joints: shape \(30, 3\)"):
        Snapshot(snapshot.seed, 1.0, tree).restore(walked)
    with pytest.raises(FileError, match="has no 'wings'"):
        Snapshot(snapshot.seed, 1.0, snapshot.tree | {"wings": 2}).restore(walked)
