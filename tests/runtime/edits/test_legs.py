"""Legs that are edited towards their description: line of the feet, hips, heels, toes, knees; and what is left alone."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import rotations
from runtime.arrays import Array
from runtime.edits.body import BodyEdits
from runtime.edits.legs import LegEdit
from runtime.edits.request import LEG, MAX_ADDED_OF_LEG, MAX_TARGET, PACED, SHAPE, EditRequest
from runtime.feet import ik
from runtime.feet.foot_lock import FootLock, Support
from runtime.feet.leg import leg_bones, leg_forward
from runtime.motion.features import DT
from runtime.motion.style import NEUTRAL_M_PER_S, Style
from runtime.prompts.edit_targets import (
    blended_targets,
    edit_targets,
    edited_parts,
    left_to_network,
    targets_of,
)
from runtime.prompts.parts import PartDescriptions
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT, J
from runtime.terrain.height_map import Terrain

STEPS = 210
FLAT = Terrain.flat()
PLAIN = PartDescriptions(*["at rest"] * 6)


def asked(**values: float) -> Array:
    """Both legs by these targets: the largest bends and lifts, and all others exactly."""
    targets = np.zeros(SHAPE[1:])
    for name, value in values.items():
        targets[:2, LEG.index(name)] = 1.0, -MAX_TARGET if name in ("knee", "lift") else value, value
    return targets


def walk(targets: Array, yaw: float = 0.0, width: float = 0.1, height: float = 0.93) -> Array:
    """World positions `(T, 31, 3)` of a figure that walks on the spot over the foot lock, once the edit is in force."""
    lock, edits, (x, z) = FootLock(), BodyEdits(), (np.sin(yaw), np.cos(yaw))
    local = np.tile([1.0, 0.0, 0.0, 0.0], (J, 1))
    local[0] = rotations.from_yaw(np.array(yaw))
    hips, ahead = np.array([0.0, height, 0.0]), np.array([x, 0.0, z])
    side, found = np.array([z, 0.0, -x]), []
    for k in range(STEPS):
        swing = np.sin(2.0 * np.pi * k / 60.0) * np.array([1.0, -1.0])
        lifted = np.maximum(np.cos(2.0 * np.pi * k / 60.0) * np.array([1.0, -1.0]), 0.0)
        feet = 0.25 * swing[:, None] * ahead + 0.5 * width * np.array([1.0, -1.0])[:, None] * side
        feet[:, 1] = ANKLE_HEIGHT + 0.08 * lifted
        posed = ik.solve_legs(hips, local, feet)
        request = EditRequest(targets.tolist(), yaw, (1.2 * x, 1.2 * z), 0.0)
        # no foot is held: what is shown is what is asked for
        *edited, legs = edits.apply(hips, posed, np.zeros(4), request)
        shown = lock.apply(*edited, FLAT, DT, Support(legs=legs))
        found.append(SPORT_SKELETON.forward_kinematics(shown.hips_position, shown.local_rotations)[0])
    return np.array(found)[-61:]


@cache
def plain_walk() -> Array:
    return walk(np.zeros(SHAPE[1:]))


def across(positions: Array, yaw: float = 0.0) -> float:
    apart = positions[:, ik.LEG_FEET[0]] - positions[:, ik.LEG_FEET[1]]
    return float(np.median(apart @ [np.cos(yaw), 0.0, -np.sin(yaw)]))


@pytest.mark.parametrize(("yaw", "width"), [(0.0, 0.3), (1.0, 0.1), (-2.5, -0.2)])
def test_feet_come_onto_a_line_from_wherever_they_were(yaw: float, width: float) -> None:
    assert across(walk(asked(outward=0.01), yaw, width), yaw) == pytest.approx(0.02, abs=0.02)


def test_feet_go_apart() -> None:
    assert across(walk(asked(outward=0.12), 0.5), 0.5) == pytest.approx(0.24, abs=0.02)


def test_a_narrow_foot_lands_before_the_one_that_stands_wherever_the_network_has_it() -> None:
    edit, still = LegEdit(), [(1.0, 0.0, 0.0, 0.0)] * J
    left, right = (leg_forward(leg_bones(k), (0.0, 0.93, 0.0), still) for k in (0, 1))
    stands = (0.04, ANKLE_HEIGHT, 0.4)  # the right foot is held 4 cm to the left of the hips
    request = EditRequest(asked(outward=0.0).tolist(), 0.0, (0.0, 1.2), 0.0, (left.ankle, stands))
    before = abs(left.ankle[0] - stands[0])
    for _ in range(60):
        _, legs = edit.apply(0.93, (left, right), [0.0, 0.0, 1.0, 1.0], request)
    assert abs(legs[0].ankle[0] - stands[0]) < 0.6 * before
    assert legs[1].ankle[0] < 0.04


def test_hips_are_lowered_once_and_feet_stay() -> None:
    plain = plain_walk()
    low = walk(asked(lower=0.15))
    assert np.median(low[:, 0, 1]) == pytest.approx(0.955 - 0.15, abs=0.005)
    np.testing.assert_allclose(low[:, ik.LEG_FEET], plain[:, ik.LEG_FEET], atol=0.015)


def test_hips_that_are_low_already_are_not_raised() -> None:
    assert np.median(walk(asked(lower=0.01))[:, 0, 1]) == pytest.approx(0.93, abs=0.02)


def test_heels_rise_over_the_toes_and_toes_turn() -> None:
    plain = plain_walk()
    tiptoe = walk(asked(pitch=28.0))
    heights = [joints[:, ik.LEG_FEET, 1] - joints[:, ik.LEG_TOES, 1] for joints in (tiptoe, plain)]
    rise = heights[0] - heights[1]
    assert rise.min() > 0.03
    duck = walk(asked(toe_out=25.0))
    toes = duck[:, ik.LEG_TOES] - duck[:, ik.LEG_FEET]
    turned = np.degrees(np.arctan2(toes[..., 0], toes[..., 2])) * [1.0, -1.0]
    assert np.median(turned) == pytest.approx(25.0, abs=2.0)


def test_a_straight_leg_bends_little_more_than_it_is_asked() -> None:
    positions = walk(asked(knee=20.0), height=1.0)
    upper = positions[:, ik.LEG_SHINS] - positions[:, ik.LEG_THIGHS]
    lower = positions[:, ik.LEG_FEET] - positions[:, ik.LEG_SHINS]
    cosine = (upper * lower).sum(-1) / np.linalg.norm(upper, axis=-1) / np.linalg.norm(lower, axis=-1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 35.0


def test_a_straight_leg_that_stands_lifts_the_hips_and_stays_where_it_is() -> None:
    edit, rest = LegEdit(), [(1.0, 0.0, 0.0, 0.0)] * J
    _, thigh, shin, *_ = leg_bones(0).joints
    turns = [(np.cos(a), np.sin(a), 0.0, 0.0) for a in (-0.17, 0.34)]
    rest[thigh], rest[shin] = turns  # a knee of 39 degrees
    bent = leg_forward(leg_bones(0), (0.0, 0.93, 0.0), rest)
    request = EditRequest(asked(knee=33.0).tolist(), 0.0, (0.0, 1.0), 0.0)
    for _ in range(90):
        up, legs = edit.apply(0.93, (bent, bent), [1.0] * 4, request)
    assert up > 0.02
    assert legs[0].ankle == pytest.approx(bent.ankle, abs=1e-3)


def test_a_low_foot_hardly_leaves_the_ground() -> None:
    feet = [walk(targets)[:, ik.LEG_FEET, 1] for targets in (np.zeros(SHAPE[1:]), asked(lift=0.03))]
    lifts = [np.ptp(heights, axis=0).max() for heights in feet]
    assert lifts[0] > 0.07
    assert lifts[1] < 0.045


def test_who_walks_on_the_heels_has_the_toes_up() -> None:
    def pitch(positions: Array) -> float:
        rise = positions[:, ik.LEG_TOES, 1] - positions[:, ik.LEG_FEET, 1] + ANKLE_HEIGHT - TOE_HEIGHT
        return float(np.median(rise))

    assert pitch(walk(asked(pitch=-20.0))) - pitch(plain_walk()) > 0.03
    assert pitch(walk(asked(pitch=-20.0))) > 0.03


def test_an_edit_that_is_no_longer_asked_for_fades() -> None:
    edit, leg = LegEdit(), leg_forward(leg_bones(0), (0.0, 0.93, 0.0), [(1.0, 0.0, 0.0, 0.0)] * J)
    asks = EditRequest(asked(lower=0.15, outward=0.12).tolist(), 0.0, (0.0, 1.0), 0.0)
    for _ in range(60):
        up, _ = edit.apply(0.93, (leg, leg), [0.0] * 4, asks)
    assert up < -0.1
    assert edit.active
    for _ in range(300):
        nothing = asks._replace(targets=np.zeros(SHAPE[1:]).tolist())
        up, legs = edit.apply(0.93, (leg, leg), [0.0] * 4, nothing)
    assert not edit.active
    assert up == pytest.approx(0.0, abs=1e-6)
    assert legs[0].ankle == pytest.approx(leg.ankle, abs=1e-6)


@settings(max_examples=3)
@given(st.lists(st.floats(-1.0, 1.0), min_size=len(LEG), max_size=len(LEG)), st.floats(-3.0, 3.0))
def test_any_targets_give_poses_that_can_be_shown(values: list[float], yaw: float) -> None:
    targets = np.zeros(SHAPE[1:])
    targets[:2, : len(LEG), 0] = 1.0
    targets[:2, : len(LEG), 1:] = (np.array(values) * MAX_ADDED_OF_LEG)[:, None]
    positions = walk(targets, yaw)
    assert np.isfinite(positions).all()
    assert np.abs(np.diff(positions, axis=0)).max() < 0.2


# --- words
@pytest.mark.parametrize(
    ("sentence", "found"),
    [
        ("left foot placed on one line, narrow stance", {"outward": (-0.01, 0.02)}),
        ("left leg crossing in front of the other at every step", {"outward": (-0.06, -0.01)}),
        ("left leg walking with a wide stance, feet apart", {"outward": (0.08, 0.15)}),
        ("left foot on tiptoe, heel raised, left knee bent deeply, crouching low", {"pitch": (20, 35), "lower": (0.1, 0.25)}),
        ("left knee slightly bent", {"lower": (0.01, 0.04)}),
        ("left foot turned outward like a duck", {"toe_out": (15, 30)}),
        ("left toes turned slightly in", {"toe_out": (-15, -5)}),
        ("left leg stiff and straight, foot dragging over the ground", {"knee": (-np.inf, 35), "lift": (-np.inf, 0.09)}),
        ("left leg stepping evenly, foot rolling from heel to toe", {}),
        ("left leg springing off the toes at every step", {}),
    ],
)  # fmt: skip
def test_a_sentence_asks_for_numbers(sentence: str, found: dict[str, tuple[float, float]]) -> None:
    values = targets_of("left_leg", sentence)
    assert values.keys() == found.keys()
    assert all(low <= values[name][0] <= high for name, (low, high) in found.items())
    assert targets_of("right_leg", sentence.replace("left", "right")) == values


def test_the_network_does_not_read_what_the_edit_shows_alone() -> None:
    left, right = "left foot placed on one line, narrow stance", "right foot turned inward, pigeon-toed"
    line = replace(PLAIN, left_leg=left, right_leg=f"{right}, right leg taking short steps")
    read = left_to_network(line)
    assert read.left_leg == "left leg stepping evenly, knee lifting moderately, foot rolling from heel to toe"
    assert read.right_leg == "right leg taking short steps"
    no_sentence = replace(PLAIN, left_leg="left foot placed on one line, narrow stance, slow careful steps")
    assert left_to_network(no_sentence) == no_sentence


def test_legs_of_a_blend_are_between_those_of_its_prompts() -> None:
    legs = {f"{side}_leg": f"{side} leg walking with a wide stance" for side in ("left", "right")}
    wide = replace(PLAIN, **legs)
    line = replace(PLAIN, left_leg="left foot placed on one line", right_leg="right foot placed on one line")
    half = blended_targets(wide, line, (0.0, 0.0, 0.5, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(half[:, 0], 0.5 * (edit_targets(wide) + edit_targets(line))[:, 0])
    np.testing.assert_allclose(half[:, 1], edit_targets(wide)[:, 1])


SENTENCES = {
    "leg stepping slowly, steps of normal length": (0.6, 0.85),
    "leg taking short steps": (0.0, 0.85),
    "leg taking very long slow strides": (0.6, np.inf),
    "leg taking brisk steps of normal length": (1.15, np.inf),
    "leg stepping evenly, knee lifting slowly": (0.0, np.inf),
    "leg taking short quick steps": (0.0, np.inf),
}


@pytest.mark.parametrize("words", SENTENCES)
@given(walk=st.floats(0.3, 2.0), jog=st.floats(0.8, 4.0))
def test_a_full_stick_is_as_slow_or_fast_as_is_said_of_the_legs(words: str, walk: float, jog: float) -> None:
    said = replace(PLAIN, left_leg=f"left {words}", right_leg=f"right {words}")
    style = Style(*[np.zeros((6, 64), np.float32)] * 4, walk, jog, edits=edit_targets(said))
    paces = edit_targets(said)[:2, 0, PACED]  # of walks and jogs: weight, least and most
    for own, found, neutral, pace in zip((walk, jog), style.speeds, NEUTRAL_M_PER_S, paces, strict=True):
        low, high = pace[1:] if pace[0] else (0.0, np.inf)
        assert found == pytest.approx(min(max(own, low * neutral), high * neutral))
    one = replace(style, edits=edit_targets(replace(PLAIN, left_leg=f"left {words}")))
    assert one.speeds == pytest.approx((walk, jog))  # the step of one leg is a limp: no other speed
    assert not style.is_edited[0]
    assert not edited_parts(said)
