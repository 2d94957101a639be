"""Retrieval in the text evaluation, on codes whose answers are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime.errors import FileError
from tests.training.evaluation.test_evaluation_text import clips, write_clip  # noqa: F401
from training.evaluation.text import (
    retrieval,
)
from training.evaluation.text.retrieval import Clips, Codes, encode_clips, first_ranks, held_out_clips, recall


def test_codes_compare_as_equation_2_does() -> None:
    random = np.random.default_rng(0)
    mean, log_variance = random.standard_normal((2, 4, 6, 64))
    codes = Codes.of(mean, log_variance)
    both = np.concatenate([mean, np.exp(log_variance / 2)], -1).reshape(4, -1)
    cosine = both[0] @ both[1] / np.linalg.norm(both[0]) / np.linalg.norm(both[1])
    assert codes.similarity(codes)[0, 1] == pytest.approx(cosine)
    np.testing.assert_allclose(np.diag(codes.similarity(codes, by_part=True)), 1.0)
    assert codes.mean().similarity(codes)[0, 2] == pytest.approx(codes.similarity(codes)[:, 2].mean())


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


def _codes(*numbers: int) -> Codes:
    """Codes that are alike where the numbers are."""
    mean = np.stack([np.random.default_rng(n).standard_normal((6, 64)) for n in numbers])
    return Codes.of(mean, np.zeros_like(mean))


def test_scores_count_what_is_found_first() -> None:
    styles = ["angry", "angry", "happy", "neutral_bn"]
    found = Clips(list("abcd"), styles, _codes(0, 0, 0, 2))  # the happy clip moves as the angry ones
    texts = {
        "angry": _codes(0, 0),
        "happy": _codes(1),
        "neutral": _codes(2),
        "neutral_bn": _codes(3),
        "old": _codes(4),
    }
    scores = retrieval._score(found, texts)
    whole = scores["whole"]
    assert whole["motion_to_text"]["r1"] == 0.5
    assert whole["motion_to_text_alike"]["r1"] == 0.75  # a neutral walk of another data set is one
    assert whole["text_to_motion"]["queries"] == 4  # no held-out clip is old, so it is not queried


def test_only_held_out_captured_clips_are_asked_for(clips: Path, tmp_path: Path) -> None:  # noqa: F811
    assert [p.stem for p in held_out_clips(clips, mirrored=False)] == ["cmu_05"]
    assert [p.stem for p in held_out_clips(clips, mirrored=True)] == ["cmu_05_m"]
    with pytest.raises(FileError, match="no held-out clips"):
        held_out_clips(tmp_path, mirrored=False)


def test_clips_of_styles_without_descriptions_are_left_out(clips: Path) -> None:  # noqa: F811
    class Encoder:
        def encode(self, joints: np.ndarray, _root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return (np.zeros((len(joints), 6, 64), np.float32),) * 2

    paths = [clips / "cmu_01.npz", clips / "cmu_03.npz", clips / "cmu_04.npz"]
    found = encode_clips(Encoder(), paths, {"neutral", "old"})  # type: ignore[arg-type]
    assert found.names == ["cmu_01"]  # cmu_03 is too short, cmu_04 is angry
    assert len(encode_clips(Encoder(), paths, {"neutral", "angry"}).names) == 2  # type: ignore[arg-type]
