"""Snapshots of a controller: what follows from one is the same, bit by bit, from memory and from bytes."""

import io
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from runtime.controls import Controls, Gait
from runtime.errors import FileError
from runtime.motion.controller import Controller
from runtime.motion.model import MotionModel
from runtime.motion.snapshot import Snapshot, take_snapshot
from runtime.pose import Pose
from runtime.terrain.library import make_terrain


def controls(frame: int) -> Controls:
    gait = Gait.JUMP if frame == 130 else Gait.JOG if frame % 100 > 60 else Gait.WALK
    return Controls((float(np.sin(frame / 40)), float(np.cos(frame / 40))), None, gait)


def play(controller: Controller, first: int, last: int) -> list[Pose]:
    return [controller.step(controls(frame)) for frame in range(first, last)]


def same(one: list[Pose], two: list[Pose]) -> bool:
    names = ("local_rotations", "hips_position", "contacts")
    pairs = [(getattr(a, n), getattr(b, n)) for a, b in zip(one, two, strict=True) for n in names]
    return all(np.array_equal(*pair) for pair in pairs)


@pytest.fixture(scope="module")
def middle(model: MotionModel) -> tuple[Controller, Snapshot]:
    """A controller in the middle of a blend on hills, and a snapshot of that moment."""
    controller = Controller(model, make_terrain("hills"), seed=3)
    style = np.random.default_rng(0).normal(size=(6, 64)).astype(np.float32) * 0.5
    play(controller, 0, 80)
    controller.set_style(style, 1.0)
    play(controller, 80, 110)
    return controller, take_snapshot(controller)


@pytest.fixture
def walked(middle: tuple[Controller, Snapshot]) -> Controller:
    """That controller at that moment again."""
    controller, snapshot = middle
    snapshot.restore(controller)
    return controller


def test_the_same_in_another_controller_from_bytes(walked: Controller, model: MotionModel) -> None:
    data = take_snapshot(walked).to_bytes()
    once = play(walked, 110, 170)
    other = Controller(model, make_terrain("hills"), seed=8)
    play(other, 0, 25)
    Snapshot.from_bytes(data).restore(other)
    assert same(play(other, 110, 170), once)


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


def written(snapshot: Snapshot, change: Callable[[dict[str, Any], dict[str, np.ndarray]], None]) -> bytes:
    """The bytes of a snapshot whose JSON and arrays were changed."""
    with np.load(io.BytesIO(snapshot.to_bytes())) as file:
        arrays = dict(file)
    tree = json.loads(arrays.pop("head").tobytes())
    change(tree["state"], arrays)
    buffer = io.BytesIO()
    np.savez(buffer, head=np.frombuffer(json.dumps(tree).encode(), np.uint8), **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda s, a: a.update({f"a{s['joints']}": np.zeros((1, 30, 3))}), r"\.joints: shape \(1, 30, 3\), expected \(1, 31, 3\)"),
        (lambda s, a: np.copyto(a[f"a{s['trajectory']['xz']}"][0, 60], np.nan), r"\.trajectory\.xz: numbers out of range"),
        (lambda s, a: a[f"a{s['trajectory']['xz']}"].fill(4e11), r"\.trajectory\.xz: numbers out of range"),
        (lambda s, a: s.update(wings=2), "not the fields of a CharacterState"),
        (lambda s, a: s["feet"][0]["feet"][1].update(anchor="elbow"), r"\.feet\[0\]\.feet\[1\]\.anchor: expected one of '', 'heel', 'toe'"),
        (lambda s, a: s["feet"][0]["pelvis"].update(offset="high"), r"\.feet\[0\]\.pelvis\.offset: expected a number"),
        (lambda s, a: s["traversals"][0].update(kind="climb"), "not the state"),
        (lambda s, a: s["traversals"][0].update(sight=3.0), "not the state"),
        (lambda s, a: s.update(feet=s["feet"] * 2), "not the state"),
    ],
    ids=["another shape", "not finite", "far away", "another name", "no such hold", "text for a number", "no obstacle",
         "out of sight", "two characters"],
)  # fmt: skip
def test_a_damaged_state_is_refused_by_name(walked: Controller, damage: Any, says: str) -> None:
    with pytest.raises(FileError, match=says):
        Snapshot.from_bytes(written(take_snapshot(walked), damage), "take.state")


def test_a_blend_that_began_within_another_goes_on_alike(walked: Controller, model: MotionModel) -> None:
    walked.set_style(model.neutral, 0.6)
    play(walked, 110, 120)
    data = take_snapshot(walked).to_bytes()
    once = play(walked, 120, 150)
    other = Controller(model, make_terrain("hills"))
    Snapshot.from_bytes(data).restore(other)
    assert same(play(other, 120, 150), once)
