"""Swings of what is shown: amplified about their means, over feet that stay; only in a walk, and only as measured."""

from math import asin, pi
from pathlib import Path

import numpy as np
import pytest

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import ModelError
from runtime.motion.swing import PLAIN, SWINGS, MeasuredSwings, Swings
from runtime.skeleton import SPORT_SKELETON

FRAMES = 240
FEET = [SPORT_SKELETON.index(name) for name in ("LeftFoot", "RightFoot")]
ROLLED = (1.0, 2.0, 1.0, 1.0, 1.0)


def rolling(degrees: float) -> tuple[Array, Array]:
    """Hips `(3,)` and local rotations `(31, 4)` of a standing body whose pelvis is rolled, in every frame of a second's swing."""
    hips, local = np.array([0.0, 0.9, 0.0]), rotations.identity((FRAMES, 31)).astype(np.float64)
    angle = np.radians(degrees) * np.sin(2.0 * pi * np.arange(FRAMES) / 60.0)
    local[:, 0] = rotations.from_rotation_vector(angle[:, None] * np.array([0.0, 0.0, 1.0]))
    return hips, local


def shown(gains: tuple[float, ...], walking: bool = True) -> tuple[Array, Array]:
    """Rolls of the pelvis in degrees `(FRAMES,)`, and how far the feet are from where they were, metres `(FRAMES, 2)`."""
    hips, local = rolling(3.0)
    swings, rolls, moved = Swings(), [], []
    for frame in local:
        before = SPORT_SKELETON.forward_kinematics(hips, frame)[0]
        place, pose = swings.apply(hips[None], frame[None], np.ones((1, 4)), [gains], [walking])
        after = SPORT_SKELETON.forward_kinematics(place[0], pose[0])[0]
        side = rotations.rotate(pose[0, 0], np.array([1.0, 0.0, 0.0]))
        rolls.append(np.degrees(asin(side[1])))
        moved.append(np.linalg.norm(after[FEET] - before[FEET], axis=-1))
    return np.array(rolls), np.array(moved)


def test_a_roll_is_amplified_over_feet_that_stay() -> None:
    rolls, moved = shown(ROLLED)
    assert rolls[:30].max() < 4.5  # comes into force slowly
    assert rolls[-60:].max() == pytest.approx(6.0, abs=0.4)
    assert moved.max() < 0.012


def test_nothing_changes_without_a_walk_or_a_gain() -> None:
    for gains, walking in ((ROLLED, False), (PLAIN, True)):
        rolls, moved = shown(gains, walking)
        assert rolls.max() == pytest.approx(3.0, abs=1e-6)
        assert moved.max() == 0.0


def test_gains_are_those_of_a_style_at_its_code_and_one_elsewhere() -> None:
    codes = np.random.default_rng(0).standard_normal((2, 6, 64))
    measured = MeasuredSwings(codes, np.array([ROLLED, PLAIN]))
    assert measured.of(codes[0]) == pytest.approx(ROLLED, rel=0.01)
    assert measured.of(codes[0] + 3.0) == pytest.approx(PLAIN)
    other_arms = codes[0].copy()
    other_arms[:2] += 3.0
    assert measured.of(other_arms)[SWINGS.index("pelvis_roll")] == pytest.approx(2.0, rel=0.01)


def test_what_no_model_measures_is_refused() -> None:
    row = {"style": "angry", "gains": list(ROLLED), "code": " ".join(["0.5"] * 384)}
    read = MeasuredSwings.read(Path("m"), {"swings": [row]}, (6, 64))
    assert read.of(read.codes[0]) == pytest.approx(ROLLED, rel=0.01)
    for wrong in ({"gains": [9.0] * 5}, {"code": "0.5 nan"}, {"gains": [1.0]}):
        with pytest.raises(ModelError, match="swings"):
            MeasuredSwings.read(Path("m"), {"swings": [row | wrong]}, (6, 64))
