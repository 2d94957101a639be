"""The metrics of the evaluation on synthetic data whose answer is known."""

import numpy as np
import pytest

from runtime import rotations
from runtime.feet import skating as feet
from runtime.skeleton import ANKLE_HEIGHT, SPORT_SKELETON, TOE_HEIGHT, J
from runtime.terrain.height_map import Terrain
from tests.helpers.walker import STRIDE_M, walk
from training.evaluation.metrics.classifiers import balanced, recognition
from training.evaluation.metrics.features import (
    WindowSet,
    halves,
    joined,
    kinematic_features,
    temporal_features,
)
from training.evaluation.metrics.feet import foot_skating, skating_means, terrain_feet
from training.evaluation.metrics.frechet import Projection, compare, frechet_distance
from training.evaluation.metrics.motion import (
    RootFeatures,
    jerk,
    pair_distance,
    transition_jerk,
    window_index,
    window_starts,
)
from training.evaluation.motion.driving import path_error, ring

FLAT = Terrain.flat(size_m=100.0)


# --- Frechet distance
def exact(mean, covariance, rows=400, seed=0):
    """Rows whose sample mean and covariance are exactly these."""
    x = np.random.default_rng(seed).normal(size=(rows, len(mean)))
    x -= x.mean(0)
    x = x @ np.linalg.inv(np.linalg.cholesky(np.cov(x.T))).T
    return x @ np.linalg.cholesky(np.asarray(covariance, float)).T + mean


def test_frechet_distance_of_gaussians_with_diagonal_covariance():
    a, b = exact([0.0, 0.0], np.diag([1.0, 4.0])), exact([3.0, 4.0], np.diag([9.0, 1.0]), seed=1)
    assert frechet_distance(a, b) == pytest.approx(25.0 + (1 - 3) ** 2 + (2 - 1) ** 2)
    assert frechet_distance(a, a) == pytest.approx(0.0, abs=1e-9)


def test_frechet_distance_does_not_turn_with_the_axes_and_takes_rank_deficient_sets():
    a, b = exact([0.0, 0.0, 0.0], np.eye(3)), exact([1.0, 0.0, 0.0], 4.0 * np.eye(3), seed=1)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    assert frechet_distance(a @ turn, b @ turn) == pytest.approx(frechet_distance(a, b))
    few = np.random.default_rng(3).normal(size=(4, 50))
    assert np.isfinite(frechet_distance(few, few + 1.0))
    assert frechet_distance(few, few + 1.0) == pytest.approx(50.0)


def test_compare_uses_equal_numbers_of_windows():
    rng = np.random.default_rng(0)
    captured, units = rng.normal(size=(400, 5)), np.repeat(np.arange(20), 20)
    same = compare(rng.normal(size=(4000, 5)), captured, units)
    assert (same["windows"], same["takes"]["windows"]) == (200, 200)
    assert same["ratio"] == pytest.approx(1.0, abs=0.5)
    assert same["takes"]["ratio"] == pytest.approx(1.0, abs=0.5)
    other = compare(rng.normal(size=(4000, 5)) + 1.0, captured, units)
    assert min(other["ratio"], other["takes"]["ratio"]) > 10.0
    lone = compare(captured, captured, np.zeros(400, int))
    assert (lone["windows"], lone["takes"]["windows"]) == (0, 0)  # one half has no other


def test_pairs_of_takes_are_parted():
    """Takes that are alike in pairs give alike sides, whatever the pairs differ by; takes of a pair that differ do not."""
    units = np.repeat(np.arange(40), 20)
    noise = np.random.default_rng(0).normal(size=(800, 2))
    pairs = noise + 10.0 * (units[:, None] // 4)
    assert compare(pairs, pairs, units)["takes"]["reference"] < 3.0
    takes = noise + 10.0 * (units[:, None] // 2 % 2) * np.array([1.0, 0.0])
    found = compare(takes, takes, units)
    assert found["reference"] < 0.5
    assert 1.0 < found["takes"]["reference"] < 110.0
    two = compare(takes[:80], takes[:80], units[:80])
    assert two["takes"]["reference"] == pytest.approx(100.0, rel=0.2)
    assert two["takes"]["windows"] == 40


def test_halves_of_one_take_lie_on_different_sides():
    """Takes that differ a lot do not make the reference larger; halves of a take that differ do."""
    units = np.repeat(np.arange(40), 20)
    noise = np.random.default_rng(0).normal(size=(800, 2))
    by_take = noise + 10.0 * (units[:, None] // 2 % 2)
    assert compare(by_take, by_take, units)["reference"] < 0.5
    single = np.repeat([0, 1], 400)
    by_half = noise + 10.0 * single[:, None]
    assert compare(by_half, by_half, single)["reference"] == pytest.approx(200.0, rel=0.1)


def test_windows_over_the_middle_of_a_take_are_left_out():
    starts = window_starts(300, 10)
    unit = halves(3, 300, starts)
    assert starts[unit == 6].max() + 79 <= 150
    assert starts[unit == 7].min() == 150
    assert (unit == -4).sum() == (starts > 71).sum() - (starts >= 150).sum()
    assert set(halves(3, 157, window_starts(157, 10))) == {6}  # too short for two windows
    captured = np.zeros((40, 2))
    captured[20:] = 100.0
    units = np.repeat([0, 1, -1], [10, 10, 20])
    assert compare(captured[:20], captured, units)["distance"] == 0.0


def test_projection_keeps_what_varies_and_ignores_what_does_not():
    x = np.random.default_rng(0).normal(size=(500, 4)) * [10.0, 1.0, 0.1, 0.0]
    plain, scaled = Projection.fit(x, 1, False), Projection.fit(x, 3, True)
    assert abs(plain.axes[0, 0]) == pytest.approx(1.0, abs=1e-2)
    assert np.abs(scaled.axes[3]).max() == 0.0
    assert scaled(x).std(0) == pytest.approx(np.ones(3), abs=0.15)


# --- feet
def standing(height, frames=11, step=(0.0, 0.0, 0.0)):
    """All joints at one height, moving by `step` metres a frame."""
    return np.full((frames, J, 3), [0.0, height, 0.0]) + np.arange(frames)[:, None, None] * np.array(step)


def test_skating_is_the_papers_formula():
    """v clamp(2 - 2^(h / H), 0, 1): in full on the ground, 2 - 2^0.5 at half of H, nothing from H up."""
    for height, weight in ((0.0, 1.0), (0.0125, 2.0 - 2.0**0.5), (0.025, 0.0), (-0.05, 1.0)):
        slip = feet.skating(standing(height, step=(0.003, 0.0, 0.004)), FLAT)
        assert slip == pytest.approx(np.full((10, 2), 0.5 * weight), abs=1e-5)


def test_skating_takes_height_over_the_terrain():
    slope = Terrain("slope", 0.5 * np.arange(11.0)[:, None] * np.ones((1, 11)), 1.0, (-5.0, -5.0))
    positions = standing(2.5, step=(0.01, 0.005, 0.0))  # along the slope
    assert feet.skating(positions, slope) == pytest.approx(np.ones((10, 2)), abs=1e-3)


def test_foot_skating_counts_chosen_frames_and_adds_up():
    positions = standing(0.0, 21)
    positions[11:, :, 2] += 0.02  # one jump of 2 cm, at frame 11
    chosen = np.zeros(21, bool)
    chosen[6:16] = True
    part, rest = foot_skating(positions, FLAT, chosen), foot_skating(positions, FLAT, ~chosen)
    found = skating_means([part])
    assert (found["frames"], found["toes"]) == (10, pytest.approx(0.2))
    assert skating_means([part, rest])["toes"] == pytest.approx(2.0 / 20)
    assert np.isnan(skating_means([])["toes"])


def test_soles_count_at_their_resting_heights():
    positions = standing(0.0, step=(0.01, 0.0, 0.0))
    positions[:, [5, 10], 1], positions[:, [4, 9], 1] = TOE_HEIGHT, ANKLE_HEIGHT
    assert foot_skating(positions, FLAT) == pytest.approx(np.tile([0.0, 1.0, 1.0], (10, 1)))
    positions[:, [4, 9], 1] += 0.1  # heels up: half of the points stand
    assert foot_skating(positions, FLAT) == pytest.approx(np.tile([0.0, 1.0, 0.5], (10, 1)))


def test_terrain_feet_tells_sinking_from_floating():
    positions = standing(1.0, 100)
    positions[:, [5, 10], 1], positions[:, [4, 9], 1] = TOE_HEIGHT, ANKLE_HEIGHT
    flat = terrain_feet(positions, FLAT)
    assert flat == pytest.approx(dict.fromkeys(flat, 0.0), abs=1e-6)
    up, down = (positions + np.array([0.0, d, 0.0]) for d in (0.03, -0.05))
    assert terrain_feet(up, FLAT)["float_p50"] == pytest.approx(3.0, abs=1e-4)
    assert terrain_feet(down, FLAT)["sunk_sole_p99"] == pytest.approx(5.0, abs=1e-4)
    assert terrain_feet(down, FLAT)["sunk_joint_p99"] == pytest.approx(2.2, abs=1e-4)


# --- smoothness, diversity, courses
def test_jerk_of_a_cubic_is_its_third_derivative():
    t = np.arange(30) / 60.0
    positions = np.zeros((30, 2, 3))
    positions[:, 0, 1], positions[:, 1, 2] = 5.0 * t**3, 7.0 * t**2
    assert jerk(positions)[:, 0] == pytest.approx(np.full(27, 30.0), rel=1e-5)
    assert jerk(positions)[:, 1] == pytest.approx(np.zeros(27), abs=1e-5)


def shaken(begin, end):
    """Joints of six seconds that go up and down, three times as far within a stretch; continuous at whole seconds."""
    t = np.arange(360) / 60.0
    positions = np.zeros((360, J, 3))
    far = np.where((t >= begin) & (t < end), 3.0, 1.0)
    positions[:, :, 1] = (far * 0.01 * np.sin(2 * np.pi * 5.0 * t))[:, None]
    return positions


def test_transition_jerk_is_the_ratio_around_the_change():
    positions = shaken(3.0, 4.0)
    assert transition_jerk(positions, 180) == pytest.approx(3.0, rel=0.05)
    assert transition_jerk(shaken(4.0, 4.4), 180) > 2.0  # a jump after the blend counts as part of the change
    with pytest.raises(ValueError, match="too few"):
        transition_jerk(positions[:200], 180)


def test_diversity_is_the_norm_of_the_pose_difference():
    first = np.zeros((180, J, 3))
    second = first.copy()
    second[:, 3] = [0.03, 0.0, 0.04]
    assert pair_distance(first, first) == 0.0
    assert pair_distance(first, second) == pytest.approx(0.05)


def test_path_error_is_the_distance_to_the_course():
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    error = path_error(np.array([[0.0, 0.0], [0.5, 1.0], [2.0, 0.3], [2.0, 2.0]]), square)
    assert error == pytest.approx([1.0, 0.0, 1.0, 2**0.5])
    course = ring()
    assert path_error(course[:50], course) == pytest.approx(np.zeros(50), abs=1e-9)
    assert 6.7 < np.linalg.norm(course, axis=1).min() < np.linalg.norm(course, axis=1).max() < 9.3


# --- windows, recognition
def test_windows_cover_forty_samples_of_every_second_frame():
    assert window_starts(79, 10).tolist() == [0]
    assert len(window_starts(78, 10)) == 0
    assert window_index(np.array([5]))[0, [0, 1, 39]].tolist() == [5, 7, 83]


def test_joined_sets_keep_their_takes_apart():
    rows = [np.zeros((n, width)) for n, width in ((3, 234), (3, 88), (0, 384))]
    sets = [WindowSet(*rows, np.array(u)) for u in ([0, 1, -1], [0, 0, 1])]
    assert joined(sets).unit.tolist() == [0, 1, -1, 4, 4, 5]  # take 0, and take 2: the first of the next pair


def glide(frames=120):
    """A figure in its rest pose that moves ahead at 1 m/s: root-relative, nothing moves."""
    joints = np.tile(SPORT_SKELETON.rest_positions, (frames, 1, 1)) + np.array([0.0, 1.0, 0.0])
    velocity = np.tile([0.0, 1.0, 0.0], (frames, 1))
    return RootFeatures(joints, rotations.to_6d(rotations.identity((frames, J))), velocity)


def test_kinematic_features_of_a_gliding_figure():
    features = kinematic_features(glide(), np.array([0, 10]))
    assert features.shape == (2, 234)
    assert features[0] == pytest.approx(features[1], abs=1e-5)
    assert features[0, 48:144] == pytest.approx(np.zeros(96), abs=1e-5)  # deviations and ranges
    assert features[0, -10:-7] == pytest.approx([0.0, 1.0, 0.0])  # the root's velocity
    assert features[0, -4:] == pytest.approx(np.zeros(4))  # a foot that moves with 1 m/s does not stand
    assert temporal_features(glide(), np.array([0])) == pytest.approx(np.zeros((1, 88)), abs=1e-5)


def test_temporal_features_find_the_harmonic():
    root = glide()
    hand = SPORT_SKELETON.index("LeftHand")
    root.joints[:, hand, 1] += 0.1 * np.sin(2 * np.pi * 2 * np.arange(120) / 80)  # twice in a window
    spectrum = temporal_features(root, np.array([0]))[0].reshape(4, 22)
    assert spectrum[:, 2 * 3 + 1] == pytest.approx([0.0, 0.05, 0.0, 0.0], abs=1e-3)


def test_walker_stands_while_its_feet_are_planted():
    from training.evaluation.metrics.motion import Motion

    hips, local, contacts = walk(200)
    motion = Motion("w", "neutral", hips, local, contacts, np.ones(200, int), FLAT)
    root = motion.root_features()
    assert root.velocity[50:150, 1] == pytest.approx(np.full(100, STRIDE_M * 60 / 64), abs=0.02)
    standing_share = kinematic_features(root, np.array([40]))[0, -4:]
    assert standing_share == pytest.approx(np.full(4, 0.6), abs=0.15)  # a window is no whole number of steps


def test_heights_under_the_body_do_not_see_the_ground_a_second_ahead():
    """A walker on its way to a step of half a metre is as high over the ground under it as on level ground."""
    from training.evaluation.metrics.motion import Motion

    hips, local, contacts = walk(200)
    rows = np.where(np.arange(-400, 401) * 0.05 > hips[150, 2], 0.5, 0.0)
    step = Terrain("step", np.repeat(rows[None], 801, 0).astype(np.float32), 0.05, (-20.0, -20.0))
    level, before = (
        Motion("w", "neutral", hips, local, contacts, np.ones(200, int), ground) for ground in (FLAT, step)
    )
    assert np.array_equal(level.root_features(True).joints, level.root_features().joints)
    heights = [
        m.root_features(under).joints[130, 0, 1]
        for m, under in ((level, False), (before, True), (before, False))
    ]
    assert heights[1] == pytest.approx(heights[0], abs=1e-3)
    assert heights[2] < heights[0] - 0.05


def test_recognition_counts_own_and_merged_labels():
    found = recognition({"angry": ["angry", "angry_bn"], "drunk": ["drunk", "drunk"], "sad": []})
    assert found["score"] == {"angry": 0.5, "drunk": 1.0}
    assert found["merged_score"] == {"angry": 1.0, "drunk": 1.0}


def test_balanced_rows_have_at_most_so_many_of_a_label():
    labels = np.array(["a"] * 100 + ["b"] * 5)
    chosen = labels[balanced(labels, 10, 0)]
    assert ((chosen == "a").sum(), (chosen == "b").sum()) == (10, 5)


def test_classifier_tells_styles_apart():
    pytest.importorskip("sklearn")
    from training.evaluation.metrics.classifiers import StyleClassifier

    features = np.random.default_rng(0).normal(size=(300, 8))
    labels = [("calm", "wild", "odd")[k % 3] for k in range(300)]
    features[:, 0] += 6.0 * (np.arange(300) % 3)
    classifier = StyleClassifier(features[:200], labels[:200])
    assert classifier.labels == ["calm", "odd", "wild"]
    answers = classifier.predict(features[200:])
    assert np.mean([a == b for a, b in zip(answers, labels[200:], strict=True)]) > 0.9
