"""Arms that are edited towards their description: places of hands, elbows and swing; and what is left alone."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.arrays import Array
from runtime.edits.body import BodyEdits
from runtime.edits.request import ARM, FRAMES, PLACE, ROW_ARMS, SHAPE, EditRequest
from runtime.prompts.edit_targets import edit_targets, edited_parts
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import SPORT_SKELETON, J

AT, STEPS = SPORT_SKELETON.index, 150
PLAIN = dict.fromkeys(("left_arm", "right_arm", "left_leg", "right_leg", "torso", "head"), "at rest")
HIPS = np.array([0.3, 0.98, -0.2])


def said(words: str) -> Array:
    """What both arms are asked for by a sentence, "{s}" the side."""
    sides = {f"{side}_arm": words.format(s=side) for side in ("left", "right")}
    return edit_targets(PartDescriptions(**(PLAIN | sides)))[0]


@cache
def incoming(frame: int, swing: float, bend: float, yaw: float) -> Array:
    """A body that walks on the spot, its arms hanging: legs and arms swing against each other."""
    local, wave = np.tile([1.0, 0.0, 0.0, 0.0], (J, 1)), np.sin(2.0 * np.pi * frame / 60.0)
    about = rotations.from_axis_angle
    x, y, z = np.eye(3)
    local[0] = rotations.from_yaw(np.array(yaw))
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        hang = about(z, np.array(-sign * np.radians(84.0)))
        local[AT(f"{side}Arm")] = rotations.multiply(about(x, np.array(-sign * wave * swing)), hang)
        local[AT(f"{side}ForeArm")] = about(y, np.array(-sign * np.radians(bend)))
        local[AT(f"{side}UpLeg")] = about(x, np.array(sign * wave * 0.4))
    return local


def move(targets: list[Array], swing: float = 0.25, bend: float = 8.0, yaw: float = 0.7) -> Array:
    """Joints `(T, 31, 3)` relative to hips that face +Z, of one frame for each of `targets`."""
    return poses(targets, swing, bend, yaw)[0]


def poses(
    targets: list[Array], swing: float = 0.25, bend: float = 8.0, yaw: float = 0.7
) -> tuple[Array, Array]:
    """The same with the joints' rotations `(T, 31, 4)`."""
    edits, found, turned = BodyEdits(), [], []
    for k, asked in enumerate(targets):
        local = incoming(k % 60, swing, bend, yaw)
        if asked.any() or edits.active:
            request = EditRequest(asked.tolist(), yaw, (0.0, 0.0), 0.0)
            local = edits.apply(HIPS, local, np.zeros(4), request).local
        positions, world = SPORT_SKELETON.forward_kinematics(np.zeros(3), local)
        found.append(positions)
        turned.append(world)
    back = rotations.from_yaw(np.array(-yaw))
    return rotations.rotate(back, np.array(found)), rotations.multiply(back, np.array(turned))


def bends(positions: Array, side: str = "Left") -> Array:
    shoulder, elbow, hand = (positions[:, AT(f"{side}{name}")] for name in ("Arm", "ForeArm", "Hand"))
    cosine = np.sum(rotations.normalize(elbow - shoulder) * rotations.normalize(hand - elbow), axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def swings(positions: Array, side: str = "Left") -> float:
    return float(np.ptp(positions[-60:, AT(f"{side}Hand"), 2] - positions[-60:, AT(f"{side}Arm"), 2]))


PLACES = [
    ("{s} hand on the hip, elbow out to the side", (0.2, 0.04, -0.09)),
    ("{s} hand clasped behind the back", (0.03, 0.1, -0.17)),
    ("{s} hand in the pocket", (0.2, -0.09, 0.06)),
    ("{s} hand on the head", (0.07, 0.62, 0.02)),
    ("{s} hand behind the head", (0.06, 0.49, -0.13)),
    ("{s} arm folded across the chest", (-0.1, 0.16, 0.18)),
    ("{s} arm raised overhead", (0.22, 0.76, 0.03)),
    ("{s} arm held out sideways at shoulder height", (0.65, 0.3, 0.0)),
]


@pytest.mark.parametrize(("words", "place"), PLACES)
def test_hands_come_to_their_place_on_both_sides(words: str, place: tuple[float, ...]) -> None:
    positions = move([said(words)] * STEPS)
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        hands = positions[-60:, AT(f"{side}Hand")]
        assert np.linalg.norm(hands - np.array(place) * [sign, 1.0, 1.0], axis=-1).max() < 0.13
    # the bones keep their lengths
    fore = np.linalg.norm(positions[:, AT("LeftHand")] - positions[:, AT("LeftForeArm")], axis=-1)
    np.testing.assert_allclose(fore, fore[0], atol=1e-6)


def test_hands_on_hips_are_at_the_sides_with_the_elbows_out() -> None:
    positions = move([said("{s} hand on the hip")] * STEPS)[-60:]
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        hand, elbow = positions[:, AT(f"{side}Hand")], positions[:, AT(f"{side}ForeArm")]
        assert (sign * hand[:, 0]).min() > 0.15
        assert np.abs(hand[:, 2]).max() < 0.14
        assert (sign * elbow[:, 0]).min() > 0.25


@pytest.mark.parametrize(
    ("words", "towards"),
    [
        ("{s} hand on the hip, elbow out to the side", (-1.0, 0.0, 0.0)),
        ("{s} hand pressed on the stomach", (0.0, 0.0, -1.0)),
        ("{s} hand on the chest", (0.0, 0.0, -1.0)),
        ("{s} hand on the head", (0.0, -1.0, 0.0)),
    ],
)
def test_a_palm_lies_on_what_the_hand_is_at(words: str, towards: tuple[float, ...]) -> None:
    _, turned = poses([said(words)] * STEPS)
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        palm = rotations.rotate(turned[-60:, AT(f"{side}Hand")], np.array([0.0, -1.0, 0.0]))
        assert (palm @ np.multiply(towards, (sign, 1.0, 1.0))).min() > 0.5


def test_a_hand_passes_round_the_trunk() -> None:
    """From crossed arms to clasped hands behind the back: no wrist goes through the body."""
    front, back = said("{s} arm folded across the chest"), said("{s} hand behind the back")
    ramp = [(1.0 - t) * front + t * back for t in np.clip((np.arange(240) - 100) / 60.0, 0.0, 1.0)]
    hands = move(ramp)[60:, AT("LeftHand")]
    inside = (hands[:, 0] / 0.165) ** 2 + (hands[:, 2] / 0.13) ** 2
    assert inside[(hands[:, 1] > -0.05) & (hands[:, 1] < 0.25)].min() > 0.85


def test_nothing_stays_of_a_place_that_is_no_longer_asked_for() -> None:
    targets = [said("{s} hand on the hip")] * 90 + [np.zeros(SHAPE[1:])] * 330
    positions, plain = move(targets), move([np.zeros(SHAPE[1:])] * len(targets))
    np.testing.assert_allclose(positions[-60:], plain[-60:], atol=1e-6)
    assert np.abs(np.diff(positions[88:, AT("LeftHand")], n=2, axis=0)[4:]).max() < 0.02


@pytest.mark.parametrize(
    ("words", "low", "high"),
    [
        ("{s} elbow bent at a right angle", 72.0, 95.0),
        ("{s} elbow straight", 0.0, 15.0),
        ("{s} arm at rest", 29.0, 31.0),
    ],
)
def test_elbows_bend_as_is_said(words: str, low: float, high: float) -> None:
    assert low <= bends(move([said(words)] * STEPS, bend=30.0))[-60:].mean() <= high


def test_an_elbow_within_what_is_said_stays() -> None:
    shown = bends(move([said("{s} elbow bent at a right angle")] * STEPS, bend=94.0))[-60:]
    assert shown.mean() == pytest.approx(94.0, abs=1.0)


@pytest.mark.parametrize(("swing", "least"), [(0.25, 0.38), (0.0, 0.38)])
def test_arms_swing_widely_whatever_they_did(swing: float, least: float) -> None:
    """An arm without a swing of its own takes that of the other side's leg."""
    positions = move([said("{s} arm swinging widely by the body")] * 240, swing=swing)
    for side, other in (("Left", "Right"), ("Right", "Left")):
        assert least < swings(positions, side) < 0.62
        hand, foot = positions[-60:, AT(f"{side}Hand"), 2], positions[-60:, AT(f"{other}Foot"), 2]
        assert np.corrcoef(hand, foot)[0, 1] > 0.9


def test_arms_that_do_not_swing_hang_still() -> None:
    assert swings(move([said("{s} arm by the body, not swinging")] * 240)) < 0.12
    assert swings(move([said("{s} arm at rest")] * 240)) > 0.2


def test_one_arm_alone_is_edited_and_a_side_is_the_others_mirror_image() -> None:
    words = PLAIN | {"right_arm": "right hand on the hip"}
    targets = edit_targets(PartDescriptions(**words))[0]
    assert edited_parts(PartDescriptions(**words)) == {"right_arm"}
    positions, plain = move([targets] * STEPS), move([np.zeros(SHAPE[1:])] * STEPS)
    np.testing.assert_allclose(positions[:, AT("LeftHand")], plain[:, AT("LeftHand")], atol=1e-9)
    both = move([said("{s} hand on the hip")] * STEPS, swing=0.0)
    np.testing.assert_allclose(both[-1, AT("LeftHand")] * [-1, 1, 1], both[-1, AT("RightHand")], atol=1e-6)


@settings(max_examples=10)
@given(
    st.sampled_from(range(len(FRAMES))),
    st.lists(st.floats(-0.7, 0.7), min_size=6, max_size=6),
    st.lists(st.floats(-1.0, 1.0), min_size=len(ARM), max_size=len(ARM)),
    st.floats(0.1, 1.0),
)
def test_whatever_is_asked_arms_stay_whole(
    frame: int, place: list[float], values: list[float], weight: float
) -> None:
    targets = np.zeros(SHAPE[1:])
    first = len(ARM) + frame * len(PLACE)
    targets[ROW_ARMS:, : len(ARM), 0] = targets[ROW_ARMS:, first : first + len(PLACE), 0] = weight
    targets[ROW_ARMS:, : len(ARM), 1:] = weight * (np.array(values) * [90.0, 0.25, 0.6])[:, None]
    targets[ROW_ARMS:, first : first + len(PLACE), 1:] = weight * np.array([*place, 0.05])[:, None]
    positions = move([targets] * 120)
    assert np.isfinite(positions).all()
    assert np.abs(np.diff(positions, axis=0)).max() * 60.0 < 12.0  # m/s
