"""Trunks that are edited towards their description: lean, twist, sway and rock; feet, and what is left alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.arrays import Array
from runtime.edits.body import BodyEdits
from runtime.edits.request import FOLD, MAX_TARGET, ROW_TRUNK, SHAPE, TRUNK, EditRequest
from runtime.edits.trunk import ASIDE, LEAN, LIMITS_DEG, TWIST
from runtime.feet.foot_lock import FootLock, Support
from runtime.motion.features import DT
from runtime.prompts.edit_targets import edit_targets, edited_parts
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import Terrain

FLAT, STEPS = Terrain.flat(), 300
PLAIN = PartDescriptions(*["at rest"] * 6)


def asked(**values: float) -> Array:
    """A trunk by these targets: exact angles, least swings, the largest fold."""
    targets = np.zeros(SHAPE[1:])
    for name, value in values.items():
        low = -MAX_TARGET if name == "fold" else value
        high = MAX_TARGET if name in ("sway", "rock", "bounce") else value
        targets[ROW_TRUNK, TRUNK.index(name)] = 1.0, low, high
    return targets


def sway(
    targets: Array | None, yaw: float = 0.4, swing: float = 0.02, roll: float = 3.0
) -> tuple[Array, Array]:
    """World positions `(T, 31, 3)` and rotations of a body that stands, its hips swaying and its spine rocking."""
    lock, edits, side = FootLock(), BodyEdits(), np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
    found = []
    for k in range(STEPS):
        wave = np.sin(2.0 * np.pi * k / 60.0)
        local = np.tile([1.0, 0.0, 0.0, 0.0], (J, 1))
        local[0] = rotations.from_yaw(np.array(yaw))
        spine = SPORT_SKELETON.index("LowerBack")
        angle = np.array(np.radians(-roll * wave))
        local[spine] = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), angle)
        hips = np.array([0.0, 0.98, 0.0]) + swing * wave * side
        hips[1] -= 0.015 * np.cos(4.0 * np.pi * k / 60.0)
        posed, legs = (hips, local, np.ones(4)), None
        if targets is not None:
            request = EditRequest(targets.tolist(), yaw, (0.0, 0.0), 0.0)
            *posed, legs = edits.apply(*posed, request)
        result = lock.apply(*posed, FLAT, DT, Support(legs=legs))
        found.append(SPORT_SKELETON.forward_kinematics(result.hips_position, result.local_rotations))
    return np.stack([each[0] for each in found]), np.stack([each[1] for each in found])


def angles(shown: tuple[Array, Array], yaw: float = 0.4) -> Array:
    """Degrees of lean, aside and twist, `(T, 3)`: of the line from hips to neck, and of the chest."""
    positions, turned = shown
    back = rotations.from_yaw(np.array(-yaw))
    line = rotations.rotate(back, positions[:, SPORT_SKELETON.index("Neck")] - positions[:, 0])
    chest = rotations.multiply(back, turned[:, SPORT_SKELETON.index("Spine1")])
    ahead = rotations.rotate(chest, np.array([0.0, 0.0, 1.0]))
    lean, aside = np.arctan2(line[:, 2], line[:, 1]), np.arctan2(line[:, 0], line[:, 1])
    return np.degrees(np.stack([lean, aside, np.arctan2(ahead[:, 0], ahead[:, 2])], axis=1))


@pytest.mark.parametrize(
    ("name", "column", "value"),
    [
        ("lean", LEAN, 15.0),
        ("lean", LEAN, -8.0),
        ("aside", ASIDE, 10.0),
        ("twist", TWIST, 24.0),
        ("twist", TWIST, -24.0),
    ],
)
def test_a_trunk_stands_at_the_angle_that_is_said(name: str, column: int, value: float) -> None:
    shown = angles(sway(asked(**{name: value})))[-60:].mean(axis=0)
    assert shown[column] == pytest.approx(value, abs=1.5)
    assert np.abs(np.delete(shown - angles(sway(None))[-60:].mean(axis=0), column)).max() < 2.0


def test_hips_bounce_as_far_as_is_said_and_rise_no_higher() -> None:
    plain, edited = sway(None), sway(asked(bounce=0.06))
    height, before = edited[0][-60:, 0, 1], plain[0][-60:, 0, 1]
    assert 2.0 * np.ptp(before) < np.ptp(height) < 0.075
    assert height.max() < before.max() + 0.01


def folding(axis: tuple[float, float, float], lean: float, frames: int = 90) -> list[float]:
    """Degrees forward and aside of a standing body that folds within three quarters of a second, and stays so."""
    edits, targets, found = BodyEdits(), asked(fold=20.0), []
    spine = SPORT_SKELETON.index("LowerBack")
    for k in range(frames):
        local = np.tile([1.0, 0.0, 0.0, 0.0], (J, 1))
        angle = np.radians(min(k / 45.0, 1.0) * lean + 5.0)
        local[spine] = rotations.from_axis_angle(np.array(axis), np.array(angle))
        edits.trunk.watch(np.degrees(angle) * axis[0] - 5.0, 0.0, 20.0)
        request = EditRequest(targets.tolist(), 0.0, (0.0, 0.0), 0.0)
        posed = edits.apply(np.array([0.0, 0.98, 0.0]), local, np.ones(4), request)
        shown = SPORT_SKELETON.forward_kinematics(posed.hips, posed.local)
        found.append(angles((shown[0][None], shown[1][None]), 0.0)[0, LEAN if axis[0] else ASIDE])
    return found


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
@pytest.mark.parametrize(("lean", "most"), [(10.0, 10.0), (45.0, 20.0)])
def test_a_trunk_folds_and_tips_no_further_than_its_bound(
    axis: tuple[float, float, float], lean: float, most: float
) -> None:
    """What it leans below the bound stays."""
    found = folding(axis, lean)
    assert max(found[:60]) < most + 6.0
    assert found[40] == pytest.approx(min(lean * 40 / 45.0, most), abs=5.5)
    assert np.abs(np.diff(found, n=2)).max() < 0.6


def test_a_trunk_leans_back_no_further_than_its_bound() -> None:
    found = folding((-1.0, 0.0, 0.0), 45.0)
    assert -22.0 < min(found[:60]) < -12.0
    assert np.abs(np.diff(found, n=2)).max() < 0.6


def test_a_fold_that_goes_on_raises_its_own_bound_slowly() -> None:
    assert folding((1.0, 0.0, 0.0), 70.0, 240)[-1] < 30.0


def test_the_head_looks_where_it_looked() -> None:
    heads = [sway(t)[1][-1, SPORT_SKELETON.index("Head")] for t in (None, asked(twist=24.0))]
    plain, turned = (rotations.rotate(head, np.array([0.0, 0.0, 1.0])) for head in heads)
    assert np.degrees(np.arccos(plain @ turned)) < 12.0


def test_hips_sway_as_far_as_is_said_over_feet_that_stay() -> None:
    positions, _ = sway(asked(sway=0.09))
    last = positions[-60:]
    across = last[:, 0, 0] * np.cos(0.4) - last[:, 0, 2] * np.sin(0.4)
    assert np.ptp(across) == pytest.approx(0.09, abs=0.02)
    for ankle in ("LeftFoot", "RightFoot"):
        assert np.ptp(last[:, SPORT_SKELETON.index(ankle)], axis=0).max() < 0.006


def test_a_trunk_rocks_as_far_as_is_said() -> None:
    assert np.ptp(angles(sway(asked(rock=12.0)))[-60:, ASIDE]) == pytest.approx(12.0, abs=2.5)


def test_shoulders_rise_and_arms_hang_on() -> None:
    plain, edited = sway(None, swing=0.0, roll=0.0), sway(asked(shrug=22.0), swing=0.0, roll=0.0)
    for joint in ("LeftArm", "RightArm", "LeftHand", "RightHand"):
        rises = edited[0][-1] - plain[0][-1]
        assert 0.03 < rises[SPORT_SKELETON.index(joint), 1] < 0.09
    hand = SPORT_SKELETON.index("LeftHand")
    np.testing.assert_allclose(edited[1][-1][hand], plain[1][-1][hand], atol=1e-6)


def test_what_does_more_than_is_said_is_left_alone() -> None:
    plain, edited = sway(None), sway(asked(sway=0.02, rock=4.0))
    np.testing.assert_allclose(edited[0][-60:], plain[0][-60:], atol=2e-3)


@settings(max_examples=6)
@given(st.lists(st.floats(-60.0, 60.0), min_size=len(TRUNK), max_size=len(TRUNK)), st.floats(0.0, 1.0))
def test_whatever_is_asked_a_body_stays_whole(values: list[float], weight: float) -> None:
    targets = asked(**dict(zip(TRUNK, values, strict=True)))
    targets[ROW_TRUNK] *= weight
    positions, turned = sway(targets)
    assert np.isfinite(positions).all()
    assert np.abs(angles((positions, turned))).max() < max(LIMITS_DEG) + 25.0
    assert np.abs(np.diff(positions, axis=0)).max() * 60.0 < 6.0  # m/s


def test_a_trunk_turns_back_without_a_jump() -> None:
    edits, local = BodyEdits(), np.tile([1.0, 0.0, 0.0, 0.0], (J, 1))
    asked_for, heads = asked(twist=24.0, lean=7.0), []  # upright is no longer counted as -5
    for k in range(600):
        targets = asked_for if k < 200 else np.zeros(SHAPE[1:])
        request = EditRequest(targets.tolist(), 0.0, (0.0, 0.0), 0.0)
        posed = edits.apply(np.array([0.0, 0.98, 0.0]), local, np.ones(4), request)
        place, _ = SPORT_SKELETON.forward_kinematics(posed.hips, posed.local)
        heads.append(place[SPORT_SKELETON.index("RightArm")])
    assert not edits.active
    assert np.linalg.norm(heads[-1] - heads[199]) > 0.02
    assert np.abs(np.diff(heads, n=2, axis=0)[2:]).max() < 0.004  # m a frame, from frame to frame


def test_words_of_a_trunk() -> None:
    words = PLAIN.to_mapping() | {"torso": "torso turned to the left, swaying from side to side"}
    assert edit_targets(PartDescriptions(**words))[0, ROW_TRUNK, TWIST, 1] > 0.0
    assert edited_parts(PartDescriptions(**words)) == {"torso"}
    plain = edit_targets(PLAIN)
    assert plain[0][FOLD][2] == 20.0  # of every trunk, so that it is none of its words
    assert np.count_nonzero(plain[0, ..., 0]) == 1
    jog = plain[1, ROW_TRUNK]  # captured runs lean forward, and rise and fall less than a hop
    assert 3.0 < jog[TRUNK.index("lean"), 1] < 12.0
    assert 0.06 < jog[TRUNK.index("bounce"), 2] < 0.14
