"""A classifier that tells windows apart: of motions that differ, and of ones that do not."""

import numpy as np
import pytest

pytest.importorskip("sklearn")

from runtime import rotations
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import Terrain
from training.evaluation.metrics.classifiers import area_under_curve, halves_auc
from training.evaluation.metrics.motion import Motion
from training.evaluation.on_captured_paths import FEATURES, WHOLE, two_sample_auc, windows_of

TAKES, FRAMES = 6, 160
FLAT = Terrain.flat(size_m=20.0)


def takes(swing: float, seed: int) -> list[Motion]:
    """Bodies that glide ahead and swing an arm by `swing` radians, each at its own rate."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(TAKES):
        local = np.zeros((FRAMES, J, 4)) + rotations.identity((J,))
        beat = swing * np.sin(rng.uniform(0.08, 0.12) * np.arange(FRAMES) + rng.uniform(0, 6))
        local[:, SPORT_SKELETON.index("LeftArm")] = rotations.from_axis_angle(np.array([0.0, 0, 1]), beat)
        hips = np.stack([np.zeros(FRAMES), np.full(FRAMES, 0.95), 0.02 * np.arange(FRAMES)], 1)
        found.append(Motion("w", "neutral", hips, local, np.ones((FRAMES, 4)), np.ones(FRAMES, int), FLAT))
    return found


def test_an_arm_that_swings_less_is_two_sample_auc_the_capture_and_halves_of_it_are_not(monkeypatch):
    monkeypatch.setattr("training.evaluation.on_captured_paths.HOP", 4)
    theirs = windows_of(takes(0.8, 0))
    told = two_sample_auc(windows_of(takes(0.3, 1)), theirs)
    assert told["kinematic"] > 0.9
    assert told["trajectories"] > 0.7  # single places tell of it only where the arm is far out
    assert told["arms"] > 0.9
    assert (
        max(told[name] for name in ("feet", "thighs", "knees", "head", "pelvis")) < 0.6
    )  # the arm alone differs
    assert set(told) == set(FEATURES)
    assert all(halves_auc(theirs.features[name], theirs.takes) < 0.75 for name in WHOLE)


@pytest.fixture(autouse=True)
def _few_trees(monkeypatch):
    for name, value in {"ROUNDS": 10, "TREES": 20, "FOLDS": 3, "DRAWS": 2}.items():
        monkeypatch.setattr(f"training.evaluation.metrics.classifiers.{name}", value)


def test_a_window_of_a_take_that_was_seen_is_not_what_counts():
    rng = np.random.default_rng(0)
    number = np.repeat(np.arange(20), 30)
    features = rng.normal(size=(20, 3))[number] + 1e-3 * rng.normal(size=(600, 3))
    assert 0.1 < area_under_curve(features, (number % 2).astype(int), number) < 0.9
