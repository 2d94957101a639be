"""Clips of a model's own traversals: made ground, what is rounded off, and which stretches are kept."""

from collections import Counter

import numpy as np
import pytest

from runtime import rotations
from runtime.controls import Gait
from runtime.motion.features import INPUT, INPUT_SIZE
from runtime.motion.model import MotionModel
from runtime.skeleton import REST_HIPS_HEIGHT, SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import ObstacleKind, obstacle_ahead
from tests.helpers.walker import settle_soon
from training import courses as clips
from training.courses import LevelSight, kept, random_course, smoothed, walk
from training.evaluation.metrics.motion import Motion
from training.evaluation.metrics.traversal import first_problem
from training.export.traversals import NECK, folds, obstacle_ground

FRAMES = 700


def upright(height: float = 0.0) -> Motion:
    """A figure in the rest pose that glides along at 1.2 m/s, its soles `height` over level ground."""
    hips = np.zeros((FRAMES, 3))
    hips[:, 1] = REST_HIPS_HEIGHT + height
    hips[:, 2] = np.arange(FRAMES) / 50.0
    local = np.tile(rotations.identity((31,)), (FRAMES, 1, 1))
    ground = Terrain("stairs", np.zeros((81, 721), np.float32), 0.05, (-2.0, -3.0))
    contacts = np.ones((FRAMES, 4))
    return Motion("walk", "angry", hips, local, contacts, np.full(FRAMES, Gait.JOG), ground)


@pytest.mark.parametrize("kind", clips.KINDS)
def test_a_course_begins_level_and_is_the_same_again(kind: str) -> None:
    first, again, other = (random_course(kind, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first.heights, again.heights)
    assert not np.array_equal(first.heights, other.heights)
    z = first.origin[1] + np.arange(first.heights.shape[1]) * first.cell_m
    assert np.abs(first.heights[:, z < clips.START_M]).max() < 0.05
    assert 0.1 < np.ptp(first.heights) < 3.0


def test_the_network_sees_level_ground(model: MotionModel) -> None:
    x = np.zeros((1, INPUT_SIZE), np.float32)
    noise = np.zeros((1, *model.noise_shape), np.float32)
    style = model.fold_style(model.neutral)
    hilly = x.copy()
    hilly[:, INPUT["heights"]] = np.linspace(-0.3, 0.3, 36)
    level = LevelSight.of(model)
    assert np.array_equal(level.step(hilly, noise, style)[0], model.step(x, noise, style)[0])
    assert not np.array_equal(model.step(hilly, noise, style)[0], model.step(x, noise, style)[0])
    assert hilly.any()


def test_a_knee_that_is_thrown_about_is_rounded_off_and_nothing_else() -> None:
    walked = upright()
    local = walked.local.copy()
    knee = SPORT_SKELETON.index("LeftLeg")
    local[350:, knee] = rotations.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(0.9))
    thrown, _ = SPORT_SKELETON.forward_kinematics(walked.hips, local)
    hips, even = smoothed(walked.hips, local, thrown)
    positions, _ = SPORT_SKELETON.forward_kinematics(hips, even)

    def worst(joints: np.ndarray) -> float:
        return float(np.linalg.norm(np.diff(joints.astype(np.float64), 2, axis=0), axis=-1).max()) * 3600.0

    assert worst(thrown) > 800.0
    assert worst(positions) < clips.MAX_ACCELERATION_M_PER_S2
    assert np.allclose(positions[:330], thrown[:330], atol=1e-5)
    assert np.allclose(positions[370:], thrown[370:], atol=1e-5)


def test_stretches_that_pass_are_kept_with_their_ground() -> None:
    seen: Counter[str] = Counter()
    (clip,) = kept(upright(), "one", seen)
    assert seen == {"stairs kept": 2}
    assert clip.source == clips.SOURCE
    assert clip.style == "angry"
    assert len(clip.hips) == 600
    assert clip.gait.argmax(1).tolist() == [Gait.JOG] * 600
    low, high = clip.hips[:, 2].min(), clip.hips[:, 2].max()
    begin = clip.patches.origin[1]
    assert begin < low - 3.0
    assert begin + clip.patches.cell * (clip.patches.heights.shape[2] - 1) > high + 3.0


def test_a_stretch_under_the_ground_or_thrown_about_is_left_out() -> None:
    seen: Counter[str] = Counter()
    assert not list(kept(upright(-0.05), "sunk", seen))
    assert seen == {"stairs soles": 2}
    walked = upright()
    walked.positions[200, SPORT_SKELETON.index("LeftHand")] += 0.3
    (clip,) = kept(walked, "thrown", seen)
    assert seen["stairs thrown"] == 1
    assert len(clip.hips) == 300


def test_the_checks_name_what_does_not_pass() -> None:
    walked = upright()
    positions = walked.positions.astype(np.float64)
    assert not first_problem(positions, walked.terrain, 100.0)
    bar = np.zeros((81, 721), np.float32)
    bar[:, 100:104] = 0.5
    assert first_problem(positions, Terrain("bar", bar, 0.05, (-2.0, -3.0)), 100.0) == "soles"


def test_a_walk_gets_on_over_stairs(model: MotionModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clips, "MAX_WALK_MINUTES", 0.07)
    settle_soon(monkeypatch)
    course = random_course("stairs", np.random.default_rng(3))
    walked = walk(model, course, "neutral", model.neutral, Gait.JOG, 1)
    assert walked.hips[-1, 2] > clips.START_M + 1.0
    assert np.isfinite(walked.local).all()


@pytest.mark.parametrize("kind", list(ObstacleKind))
def test_an_obstacle_is_seen_as_what_it_is(kind: ObstacleKind) -> None:
    size = 0.4
    found = obstacle_ahead(obstacle_ground(kind, size), 0.0, 2.0, np.array([0.0, 1.0]), 3.0)
    assert found.kind is kind
    assert found.size == pytest.approx(size, abs=0.06)


def test_a_trunk_that_folds_over_an_obstacle_is_seen() -> None:
    """Against the style's own posture on level ground: who always leans does not fold."""
    level = np.zeros((60, 31, 3))
    level[:, NECK] = (0.0, 0.5, 0.1)
    over = level.copy()
    assert not folds(over, level)
    over[20:50, NECK] = (0.0, 0.3, 0.4)
    assert folds(over, level)
    assert not folds(over, over)
