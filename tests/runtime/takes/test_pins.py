"""Pins and plants: what is pinned is there, the rest is as it was, nothing jumps, and text and projects keep them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import UsageError
from runtime.session.history import History
from runtime.session.motion import Motion
from runtime.session.session import Session, Take
from runtime.session.session_file import SessionFile
from runtime.skeleton import ANKLE_HEIGHT, REST_HIPS_HEIGHT, SPORT_SKELETON
from runtime.takes import pose_layer
from runtime.takes.clip import Clip
from runtime.takes.footplants import FootplantEdit, fitted_footplant, footplants, replanted, unfitted
from runtime.takes.pinned import along_with, farthest, pinned
from runtime.takes.pins import parse_pins
from runtime.takes.pose_edits import PoseEdits
from runtime.takes.pose_layer import Curve, PoseKey, PoseLayer, added

FRAMES, SPEED_M_PER_S = 180, 0.6  # of `walk`
LEFT_HAND, HEAD, LEFT_FOOT = (SPORT_SKELETON.index(name) for name in ("LeftHand", "Head", "LeftFoot"))


def largest_step(clip: Clip) -> float:
    """Degrees that the fastest joint turns in a frame."""
    turned = rotations.angle_between(clip.local_rotations[1:], clip.local_rotations[:-1])
    return float(np.degrees(turned).max())


@pytest.mark.parametrize(
    "text",
    [
        "left hand 0.25 1.2 0.4 along from 1 to 2",
        "right hand -0.4 1.1 0 rail -0.4 1.1 3 from 1 to 2",
        "right hand -0.25 0.6 0.3 along from 1 to 2",  # the spine leans
        "left foot 0.15 0.1 0.75 from 1 to 1.2",
    ],
)
def test_a_hand_or_foot_is_where_it_is_pinned_and_nothing_jumps(walk: Clip, text: str) -> None:
    (pin,) = parse_pins(text)
    made = pinned(walk, [pin])
    assert farthest(walk, pin) > 0.1
    assert farthest(made, pin) < 0.02
    free = pin.weights(np.arange(FRAMES) / 60.0) == 0.0
    assert 0 < free.sum() < FRAMES
    for name in ("hips_positions", "local_rotations", "contacts"):
        assert np.array_equal(getattr(made, name)[free], getattr(walk, name)[free])
    assert largest_step(made) < 14.0  # an arm's way in 0.3 s


def test_one_frame_alone_is_as_in_the_whole_take_and_costs_one(
    walk: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    layer = PoseLayer((PoseKey(1.0).with_value(Curve.TURN, HEAD, np.array([0.0, 0.4, 0.0])),), keeps=True)
    text = "left hand 0.3 1.2 1 from 1 to 2; look 2 1.2 4 from 0.5 to 1.5; pose 1.5 from 0.2 to 0.8"
    take = Take(1, Motion.of(walk), poses=PoseEdits(parse_pins(text), layer=layer))
    whole, posed = take.clip, list[int]()

    def count(hips: Array, *given: Any) -> Any:
        posed.append(len(hips))
        return added(hips, *given)

    monkeypatch.setattr(pose_layer, "added", count)
    for number in (0, 20, 75, 100, FRAMES - 1):
        assert np.allclose(take.frame(number).local_rotations[0], whole.local_rotations[number], atol=1e-5)
    assert set(posed) == {1}


def test_the_head_looks_at_its_point_and_not_behind(walk: Clip) -> None:
    ahead, behind = parse_pins("look 2 1.2 4 from 0.5 to 1.5; look 0 1.4 -5 from 0.5 to 1.5")
    positions, world = pinned(walk, [ahead]).world()
    wanted = rotations.normalize(np.array(ahead.point) - positions[60, HEAD])
    facing = rotations.rotate(world[60, HEAD], np.array([0.0, 0.0, 1.0]))
    assert np.degrees(np.arccos(facing @ wanted)) < 3.0
    assert np.allclose(pinned(walk, [behind]).local_rotations, walk.local_rotations, atol=1e-6)


def test_what_is_out_of_reach_is_let_go(walk: Clip) -> None:
    (pin,) = parse_pins("left hand 30 1 0 from 1 to 2")
    assert np.allclose(pinned(walk, [pin]).local_rotations, walk.local_rotations, atol=1e-5)
    assert farthest(pinned(walk, [pin]), pin) > 25.0


def test_a_pose_stays_while_the_legs_walk_on(walk: Clip) -> None:
    (pin,) = parse_pins("pose 0.25 from 1 to 2")
    made = pinned(walk, [pin])
    arm = SPORT_SKELETON.index("LeftArm")
    assert np.allclose(made.local_rotations[60:120, arm], walk.local_rotations[15, arm], atol=1e-5)
    assert np.array_equal(made.local_rotations[:, :11], walk.local_rotations[:, :11])


def test_a_foot_on_a_mark_bears_and_stands_flat(walk: Clip) -> None:
    (pin,) = parse_pins("left foot 0.15 0.05 0.75 from 1 to 1.2")
    made = pinned(walk, [pin])
    positions, world = made.world()
    assert positions[66, LEFT_FOOT, 1] == pytest.approx(0.05 + ANKLE_HEIGHT, abs=0.01)
    assert rotations.rotate(world[66, LEFT_FOOT], np.array([0.0, 1.0, 0.0]))[1] > 0.999
    assert (made.contacts[60:73, :2] == 1.0).all()


def test_a_point_beside_a_character_turns_with_it() -> None:
    turn = rotations.from_yaw(np.pi / 2)
    beside = along_with(np.array([5.0, 1.0, 1.0]), np.array([4.0, REST_HIPS_HEIGHT, 1.0]), turn)
    assert np.allclose(beside, [0.0, 1.0, 1.0], atol=1e-6)  # one metre ahead of who looks towards +X


@pytest.mark.parametrize(
    "text",
    ["nose 0 1 2", "left hand", "left hand 0 1", "pose 0 1 2", "look 0 1 2 from 3 to 2", "left hand 1e9 0 0"],
)
def test_what_is_no_pin_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="pin"):
        parse_pins(text)


# --- plants
def test_a_plant_is_longer_moved_removed_and_added(walk: Clip) -> None:
    bearing = footplants(walk.contacts[:, :2])
    old = bearing[1]
    toe = SPORT_SKELETON.index("LeftToeBase")
    longer = fitted_footplant(footplants(walk.contacts[:, :2]), len(walk), old, old[0] - 4, old[1] + 4)
    made = replanted(walk, [FootplantEdit(0, old, longer)])
    assert footplants(made.contacts[:, :2]) == [bearing[0], longer, *bearing[2:]]
    moved = fitted_footplant(footplants(walk.contacts[:, :2]), len(walk), old, old[0] + 6, old[1] + 6)
    made = replanted(walk, [FootplantEdit(0, old, moved)])
    place, before = made.world()[0][:, toe], walk.world()[0][:, toe]
    assert np.allclose(place[moved[0] : moved[1]], before[old[0] : old[1]], atol=0.01)  # where it was, later
    made = replanted(walk, [FootplantEdit(0, old, None)])
    assert unfitted(walk, [FootplantEdit(0, old, None)]) == 0
    assert unfitted(made, [FootplantEdit(0, old, None)]) == 1
    middle = sum(old) // 2
    assert made.world()[0][middle, toe, 1] > before[middle, 1] + 0.05
    assert not (made.contacts[old[0] : old[1], :2]).any()
    swing = (old[1] + bearing[2][0]) // 2
    added = fitted_footplant(footplants(walk.contacts[:, :2]), len(walk), None, swing - 4, swing + 4)
    made = replanted(walk, [FootplantEdit(0, None, added)])
    assert np.abs(np.diff(made.world()[0][added[0] : added[1], toe], axis=0)).max() < 0.001
    assert added in footplants(made.contacts[:, :2])


def test_a_plant_does_not_run_into_its_neighbours(walk: Clip) -> None:
    bearing = footplants(walk.contacts[:, :2])
    first, end = fitted_footplant(footplants(walk.contacts[:, :2]), len(walk), bearing[1], -100, 1000)
    assert bearing[0][1] < first < end < bearing[2][0]
    begun = bearing[1][0]
    with pytest.raises(UsageError, match="already planted"):
        fitted_footplant(footplants(walk.contacts[:, :2]), len(walk), None, begun + 1, begun + 3)


@settings(max_examples=15)
@given(st.integers(0, 1), st.integers(0, 2), st.integers(-40, 40), st.integers(-40, 40))
def test_any_plant_leaves_poses_of_rigid_bones(
    walk: Clip, foot: int, which: int, by: int, longer: int
) -> None:
    bearing = footplants(walk.contacts[:, 2 * foot : 2 * foot + 2])
    old = bearing[min(which, len(bearing) - 1)]
    known, begin = footplants(walk.contacts[:, 2 * foot : 2 * foot + 2]), old[0] + by
    new = fitted_footplant(known, len(walk), old, begin, max(old[1] + by + longer, begin + 1))
    made = replanted(walk, [FootplantEdit(foot, old, new)])
    assert new in footplants(made.contacts[:, 2 * foot : 2 * foot + 2])
    assert np.allclose(np.linalg.norm(made.local_rotations, axis=-1), 1.0, atol=1e-4)
    other = 7 - 5 * foot
    hips = np.abs(made.hips_positions - walk.hips_positions).max(axis=1)
    same = hips < 1e-6  # the other leg bends only where the hips sink
    assert np.allclose(made.local_rotations[same][:, other], walk.local_rotations[same][:, other], atol=1e-4)


def test_a_session_keeps_the_motion_under_its_edits(walk: Clip, tmp_path: Path) -> None:
    gone = FootplantEdit(1, footplants(walk.contacts[:, 2:])[0], None)
    edits = PoseEdits(parse_pins("left hand 0.3 1.2 1 from 1 to 2"), (gone,))
    made, history = Take(1, Motion.of(walk), poses=edits), History()
    history.push("take", Session((made,), counter=1))
    file = SessionFile.create(tmp_path / "a.sport", tmp_path)
    file.write(history)
    assert file.close(60.0)
    file, history = SessionFile.open(tmp_path / "a.sport", tmp_path)
    (found,) = history.present.session.takes
    assert found.poses == edits
    assert np.allclose(found.base_clip.local_rotations, walk.local_rotations, atol=1e-4)
    assert np.allclose(found.clip.local_rotations, edits.apply(walk).local_rotations, atol=1e-3)
    file.close(1.0)
