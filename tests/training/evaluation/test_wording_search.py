"""`training.evaluation.text.wording`: the wording of a sentence is found on walks."""

import dataclasses

import numpy as np
import pytest

from runtime.measures.table import BodyMeasures, PartMeasures, measures_of
from runtime.prompts.phrasing import ModelPhrasing, adherence_of
from runtime.prompts.prompter import Prompter
from runtime.skeleton import PART_NAMES
from tests.helpers.shipped import shipped_model
from training.evaluation.text import walks as text_walks
from training.evaluation.text import wording
from training.evaluation.text.walks import Walker
from training.evaluation.text.wording import NEUTRAL, better_wordings, walk_all
from training.text.claims import claims, sentence_fraction, unclaimed_change

pytestmark = pytest.mark.needs_torch


def _body(**torso: float) -> BodyMeasures:
    ones = {part: PartMeasures(**dict.fromkeys(measures_of(part), 1.0)) for part in PART_NAMES}
    return BodyMeasures(**{**ones, "torso": ones["torso"].changed(**torso)})


PLAIN = _body(pitch=0.0)
WALKS = {
    NEUTRAL: PLAIN,
    ("torso", "torso leaning forward"): _body(pitch=1.0),
    ("torso", "torso tilted forward"): _body(pitch=12.0),
    ("torso", "torso bowed far forward"): _body(pitch=45.0),
    ("torso", "torso bent forward, rocking"): _body(pitch=12.0, roll_range=20.0),
}


def alike(words):
    return np.eye(len(words))


def test_a_share_is_that_of_what_neutral_does_not_do():
    assert sentence_fraction("torso", "torso leaning forward", PLAIN, _body(pitch=4.5)) == pytest.approx(0.5)
    assert sentence_fraction("torso", "torso upright", PLAIN, PLAIN) is None


def test_too_much_and_what_was_not_said_count_as_change():
    words = "torso leaning forward"
    near, far, other = _body(pitch=12.0), _body(pitch=45.0), _body(pitch=12.0, roll_range=20.0)
    assert unclaimed_change("torso", words, PLAIN, near) == 0.0
    assert unclaimed_change("torso", words, PLAIN, far) > 1.0
    assert unclaimed_change("torso", words, PLAIN, other) > 1.0


def test_a_weak_sentence_gets_the_words_whose_walk_does_it_and_nothing_else():
    table = better_wordings(WALKS, frozenset(), alike)
    assert table == {"torso": {"torso leaning forward": "torso tilted forward"}}


def test_each_arm_is_told_what_says_the_same_or_less_and_is_done_by_it():
    whole, less = "left hand held behind the back, elbow bent", "left hand held behind the back"
    arm = PLAIN.right_arm.changed(hand_front=0.1, elbow_bend=10.0)
    plain = dataclasses.replace(PLAIN, left_arm=arm, right_arm=arm)
    there = arm.changed(hand_front=-0.15, elbow_bend=60.0)
    walks = {NEUTRAL: plain}
    for part in ("left_arm", "right_arm"):
        walks[part, whole] = plain
        walks[part, less] = dataclasses.replace(plain, **({part: there} if part == "right_arm" else {}))
    assert better_wordings(walks, frozenset(), alike) == {"right_arm": {whole: less}}
    assert better_wordings(walks, frozenset({("arm", whole)}), alike) == {}


@pytest.mark.parametrize(("neutral", "farther"), [(-3.0, True), (3.0, True), (-3.0, False)])
def test_too_much_counts_on_either_side_of_zero(neutral: float, farther: bool) -> None:
    walked = _body(pitch=neutral + (60.0 if farther else 12.0))
    assert (unclaimed_change("torso", "torso leaning forward", _body(pitch=neutral), walked) > 1.0) == farther


def test_captured_sentences_keep_their_words():
    assert better_wordings(WALKS, frozenset({("torso", "torso leaning forward")}), alike) == {}


def test_a_sentence_is_walked_with_the_rest_of_the_body_neutral(monkeypatch):
    monkeypatch.setattr(text_walks, "LEAD_SECONDS", 0.5)
    model = shipped_model()
    key = ("torso", "torso leaning far forward")
    walks = walk_all(Walker(model.folder, 1, 1.0), Prompter(model, phrasing=ModelPhrasing()), [key])
    assert walks[key].torso.pitch > walks[NEUTRAL].torso.pitch + 10.0


def test_limbs_that_have_their_own_shares_are_walked_as_arms_of_a_side_and_as_legs(monkeypatch):
    sentences = {*adherence_of().sentences, *adherence_of().clauses}
    walked = []
    monkeypatch.setattr(wording, "walk_all", lambda walker, prompter, keys: walked.extend(keys) or WALKS)
    wording.measure_wording(None, Prompter(shipped_model()), sentences)
    assert {group for group, _ in walked} == set(wording.PARTS)
    assert {words for _, words in walked} == {words for _, words in sentences}


@pytest.mark.parametrize(
    ("part", "words", "others"),
    [
        ("left_leg", "left toes turned slightly out", "left toes turned slightly in"),
        ("torso", "hardly swaying", "swaying slowly from side to side"),
        ("torso", "torso upright, not turning", "torso upright, turning"),
        ("left_leg", "left foot placed slightly out", "left foot placed lightly"),
    ],
)
def test_the_contrary_of_a_sentence_does_not_claim_the_same(part: str, words: str, others: str) -> None:
    assert claims(part, words) != claims(part, others)
