"""The wording that a model follows: what it is told in place of a sentence that it hardly shows."""

import json
from dataclasses import replace

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.errors import FileError
from runtime.prompts.content import PromptEncoder
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.phrasing import ModelPhrasing, PromptAdherence, as_left_limb, load_phrasings, phrasing_of
from tests.helpers.shipped import shipped_encoder, shipped_model

WALKS = ("left arm hanging", "right arm hanging", "left leg stepping", "right leg stepping")
PLAIN = PartDescriptions(*WALKS, "torso upright", "head upright")
FORWARD, STIFF = ("torso", "torso leaning forward"), ("leg", "left leg stiff")
WORDING = ModelPhrasing({FORWARD: "torso tilted forward", STIFF: "left foot hardly lifted"})


def test_a_whole_sentence_is_said_as_the_model_follows_it():
    assert WORDING.of("Torso leaning forward", "torso") == "torso tilted forward"
    assert WORDING.of("torso leaning forward, tense", "torso") == "torso leaning forward, tense"
    assert WORDING.of("torso upright", "torso") == "torso upright"
    assert WORDING.of("torso leaning forward", "head") == "torso leaning forward"


def test_a_right_limb_is_said_as_the_left_one_is():
    told = WORDING.followed(replace(PLAIN, right_leg="right leg stiff"))
    assert told == replace(PLAIN, right_leg="right foot hardly lifted")


def test_an_arm_has_wordings_of_its_own():
    behind = ("left hand held behind the back", "right hand held behind the back")
    wording = ModelPhrasing({("left_arm", behind[0]): "left arm stretched back"})
    assert wording.of(behind[0], "left_arm") == "left arm stretched back"
    assert wording.of(behind[1], "right_arm") == behind[1]
    right = ModelPhrasing({("right_arm", behind[0]): "left arm stretched back"})
    assert right.of(behind[1], "right_arm") == "right arm stretched back"
    assert right.of(behind[0], "left_arm") == behind[0]


def test_the_model_is_told_the_other_words():
    model = shipped_model()
    plain, worded = (PromptEncoder(shipped_encoder(), model.prompt_path, each) for each in (None, WORDING))
    leaning = replace(PLAIN, torso="torso leaning forward")
    tilted = plain.encode(replace(PLAIN, torso="torso tilted forward"))
    np.testing.assert_array_equal(worded.encode(leaning), tilted)
    assert not np.array_equal(worded.encode(leaning), plain.encode(leaning))


def test_the_shipped_table_leaves_captured_styles_alone_and_ends_after_one_step():
    table = phrasing_of("compact").table
    styles = json.loads(asset_path("prompts/styles.json").read_text("utf-8"))
    told = [
        pair for s in styles.values() for description in s["descriptions"] for pair in description.items()
    ]
    captured = {as_left_limb(words, part) for part, words in told}
    assert len(table) > 20
    limbs = {"left_arm": "arm", "right_arm": "arm"}
    assert not captured & {(limbs.get(group, group), words) for group, words in table}
    assert not {(group, told) for (group, _), told in table.items()} & set(table)


def test_a_damaged_table_is_named(tmp_path):
    path = tmp_path / "wording.json"
    assert load_phrasings(path) == {}
    for text in ("[", '{"compact": []}', '{"compact": {"torso": {"torso bent": 3}}}'):
        path.write_text(text)
        with pytest.raises(FileError, match=r"wording\.json.*Restore"):
            load_phrasings(path)


def test_what_is_hardly_shown_is_said_in_the_words_of_the_prompt():
    adherence = PromptAdherence({("torso", "torso tilted forward"): 0.1})
    said = replace(PLAIN, torso="torso leaning forward")
    note = adherence.note(said, WORDING.followed(said))
    assert note == "Hardly shown by this model: torso “torso leaning forward” (10%)."
    assert adherence.note(said, WORDING.followed(said), frozenset({"torso"})) == ""


def test_what_does_not_move_is_not_read_as_moving():
    for (_, words), read in phrasing_of("compact").table.items():
        if any(word in words for word in ("neither", "hardly swaying", "no sway")):
            assert not any(moves in read for moves in ("swaying", "rocking")), words
