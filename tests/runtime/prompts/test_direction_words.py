"""Direction words beside sentence embeddings: what they see, and the networks with and without them."""

import numpy as np
import pytest

from runtime.prompts.content import GROUPS, MIN_PRESENT_VALUE, PromptEncoder, direction_words
from runtime.prompts.parts import PartDescriptions
from tests.helpers.graphs import save_graph

NAMES = [name for name, _ in GROUPS]


def _found(text: str) -> set[str]:
    return {name for name, value in zip(NAMES, direction_words([text])[0], strict=True) if value}


def test_opposites_are_told_apart():
    assert _found("left arm raised high") == {"left", "up"}
    assert _found("Right arm, lowered slightly.") == {"right", "down", "little"}
    assert _found("torso leaning far back") == {"tilted", "much", "back"}
    assert _found("") == set()


def test_words_are_whole_words():
    assert not _found("leftovers for a pupil in a box")


def test_no_word_is_in_both_groups_of_a_pair():
    groups = dict(GROUPS)
    pairs = "left right, forward back, up down, out in, much little, bent straight, fast slow, still moving"
    for first, second in (pair.split() for pair in pairs.split(", ")):
        assert not groups[first] & groups[second]


def _network(path, size):
    """z = the last number of every sentence, in all 64 places."""
    nodes = [("Gather", "embeddings last", "one", {"axis": 2}), ("Expand", "one shape", "z", {})]
    constants = {"last": np.array([size - 1]), "shape": np.array([1, 6, 64])}
    return save_graph(path, nodes, {"embeddings": ["n", 6, size]}, {"z": ["n", 6, 64]}, constants)


class _Words:
    name, dimensions = "stand-in", 4

    def encode(self, texts):
        return np.full((len(texts), 4), 0.5, np.float32)


def test_a_network_gets_them_if_it_was_trained_with_them(tmp_path):
    text = PartDescriptions(*["both feet stepping"] * 6)
    plain = PromptEncoder(_Words(), _network(tmp_path / "plain.onnx", 4)).encode(text)
    words = PromptEncoder(_Words(), _network(tmp_path / "words.onnx", 4 + len(GROUPS))).encode(text)
    assert plain == pytest.approx(0.5)
    assert words == pytest.approx(MIN_PRESENT_VALUE)  # the last group is that of the feet
