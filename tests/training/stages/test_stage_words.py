"""Longer sentences mean what their phrases mean, and what was known stays."""

from functools import cache

import numpy as np
import pytest
import torch

from runtime.prompts.content import part_inputs
from runtime.skeleton import PART_NAMES
from training.augmentation.catalogue import catalogue, part_edits
from training.augmentation.sentences import LongerSentence, longer_sentences, other_sentences
from training.networks.content import ContentEncoder
from training.presets import preset
from training.session import StageLength
from training.stages.words import codes_of, disturbed, learn_longer_sentences
from training.styles import StyleTexts

pytestmark = pytest.mark.needs_torch


@cache
def vector_of(word):
    return np.random.default_rng(list(word.encode())).normal(size=384)


class BagOfWords:
    """A sentence is the sum of a vector for each word."""

    name, dimensions = "stand-in", 384

    def encode(self, texts):
        sums = [sum(vector_of(w) for w in t.replace(",", " ").lower().split()) for t in texts]
        return np.stack([s / np.linalg.norm(s) for s in sums]).astype("f4")


def test_longer_sentences_are_made_of_trained_phrases_alone():
    known = [edit for name, edit in part_edits().items() if name not in catalogue().held_out]
    trained = {p for edit in known for phrases in edit.phrases.values() for p in phrases}
    sentences = longer_sentences()
    assert {s.part for s in sentences} == set(PART_NAMES)
    assert all(set(s.of) <= trained for s in sentences)
    held = [part_edits()[name] for name in catalogue().held_out]
    only_held_out = {p for edit in held for phrases in edit.phrases.values() for p in phrases} - trained
    assert not any(s.text.startswith(p) for s in sentences for p in only_held_out)


def test_a_clause_that_adds_nothing_leaves_one_phrase_and_two_postures_leave_two():
    sentences = longer_sentences()
    words = "left hand resting on the hip, held still"
    assert LongerSentence("left_arm", words, ("left hand resting on the hip",)) in sentences
    both = {s.text: set(s.of) for s in sentences if len(s.of) == 2}
    assert both["head lowered, turned to the left"] == {"head lowered", "head turned to the left"}
    assert not any("held still" in s.text and "swinging widely" in s.text for s in sentences)


def test_longer_sentences_are_learnt_and_the_others_kept(monkeypatch):
    few, others = longer_sentences()[::12], other_sentences()[::12]
    monkeypatch.setattr("training.stages.words.longer_sentences", lambda: few)
    monkeypatch.setattr("training.stages.words.other_sentences", lambda: others)
    torch.manual_seed(0)
    config, encoder = preset("tiny"), BagOfWords()
    content = ContentEncoder(config)
    known = [sorted({s.of[0] for s in few if s.part == part})[:20] for part in PART_NAMES]
    pairs = zip(PART_NAMES, known, strict=True)
    inputs = [part_inputs(encoder, [part] * len(s), s, True, True) for part, s in pairs]
    texts = StyleTexts(known, inputs, np.zeros((1, 1, 6), int), np.zeros((1, 6), int), ["a"])
    result = learn_longer_sentences(content, config, texts, encoder, StageLength(40, 1))
    assert result["known_before"] == 0.0
    assert result["longer"] < 0.7 * result["longer_before"]
    assert result["known"] < 0.5
    assert codes_of(content.text, torch.as_tensor(inputs[0]), 0).shape == (len(known[0]), 128)


def test_noise_keeps_the_side():
    words = torch.randn(4, 6, 9)
    noisy = disturbed(words, one_sided=True)
    assert torch.equal(noisy[..., -1], words[..., -1])
    assert not torch.equal(noisy[..., :-1], words[..., :-1])
