"""Retrieval in the text evaluation, on codes whose answers are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime.errors import FileError
from tests.training.evaluation.test_evaluation_text import clips, write_clip  # noqa: F401
from training.evaluation.text.retrieval import codes_of, first_ranks, held_out_clips, recall, scores


def test_codes_compare_as_equation_2_does() -> None:
    random = np.random.default_rng(0)
    mean, log_variance = random.standard_normal((2, 4, 6, 64))
    codes = codes_of(mean, log_variance)
    both = np.concatenate([mean, np.exp(log_variance / 2)], -1).reshape(4, -1)
    cosine = both[0] @ both[1] / np.linalg.norm(both[0]) / np.linalg.norm(both[1])
    assert codes[0] @ codes[1] == pytest.approx(cosine)
    np.testing.assert_allclose(np.linalg.norm(codes, axis=1), 1.0)


def test_ranks_count_the_nearest_relevant_entry_and_ties_against_it() -> None:
    similarity = np.array([[0.9, 0.8, 0.7, 0.1], [0.1, 0.5, 0.5, 0.2], [0.1, 0.2, 0.3, 0.4]])
    relevant = np.array([[0, 1, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], bool)
    assert first_ranks(similarity, relevant).tolist() == [2, 2, 1]
    found = recall(similarity, relevant, ["a", "a", "b"])
    assert (found.r1, found.r3, found.median_rank) == (pytest.approx(1 / 3), 1.0, 2.0)
    assert found.r1_by_style == 0.5  # of a no query, of b every one
    assert found.chance_r1 == pytest.approx((2 / 4 + 1 / 4 + 1 / 4) / 3)


def test_chance_is_what_random_similarities_give() -> None:
    random = np.random.default_rng(1)
    relevant = np.arange(30) % 6 == np.zeros((4000, 1))
    found = recall(random.random((4000, 30)), relevant, ["a"] * 4000)
    assert found.r1 == pytest.approx(found.chance_r1, abs=0.03)
    assert found.r3 == pytest.approx(found.chance_r3, abs=0.03)
    assert abs(found.median_rank - found.chance_rank) <= 1
    small = recall(np.ones((1, 1)), np.ones((1, 1), bool), ["a"])
    assert (small.r1, small.chance_r3) == (1.0, 1.0)


def _codes(*numbers: int) -> np.ndarray:
    """Codes that are alike where the numbers are."""
    mean = np.stack([np.random.default_rng(n).standard_normal((6, 64)) for n in numbers])
    return codes_of(mean, np.zeros_like(mean))


def test_scores_count_what_is_found_first() -> None:
    styles = ["angry", "angry", "happy", "neutral_bn"]
    texts = {
        "angry": _codes(0, 0),
        "happy": _codes(1),
        "neutral": _codes(2),
        "neutral_bn": _codes(3),
        "old": _codes(4),
    }
    found = scores(styles, list(_codes(0, 0, 0, 2)), texts)  # the happy clip moves as the angry ones
    assert found["motion_to_text"]["r1"] == 0.5
    assert found["motion_to_text_alike"]["r1"] == 0.75  # a neutral walk of another data set is one
    assert found["text_to_motion"]["queries"] == 4  # no held-out clip is old, so it is not queried


def test_only_held_out_captured_clips_of_described_styles_are_in_the_gallery(
    clips: Path,  # noqa: F811
) -> None:
    assert [c.path.stem for c in held_out_clips(clips, ["neutral"])] == ["cmu_05"]
    with pytest.raises(FileError, match="no held-out clips"):
        held_out_clips(clips, ["angry"])
