"""What captures say of words: captions ask of a walk its lean, phrases what their clips show, and the rest is written by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.edits.request import FOLD, GAITS, MAX_TARGET, ROW_TRUNK, TRUNK, checked_targets, written_targets
from runtime.errors import FileError
from runtime.prompts import captured as module
from runtime.prompts.captured import CapturedPhrases, captured
from runtime.prompts.edit_targets import WELL_WITHIN_FRACTION, edit_targets, edited_parts, left_to_network
from runtime.prompts.library_data import load_styles
from runtime.prompts.parts import PartDescriptions

STYLES = load_styles(asset_path("prompts/styles.json"))
WALKED = [name for name in captured().styles if name in STYLES]
WALK, JOG = GAITS.index("walk"), GAITS.index("jog")
LEAN = TRUNK.index("lean")
PLAIN = PartDescriptions(*["at rest"] * 6)


@pytest.mark.parametrize("style", WALKED)
def test_a_captured_style_walks_as_the_network_has_it_and_leans_as_captured(style: str) -> None:
    low, high = captured().styles[style]["walk"]["torso"]["lean"]
    for words in STYLES[style].descriptions:
        asked = edit_targets(words)[WALK]
        asked[FOLD] = 0.0
        weight, least, most = asked[ROW_TRUNK, LEAN]
        assert weight == 1.0
        if captured().styles_of(words) == {style}:
            assert low < least == most < high
        asked[ROW_TRUNK, LEAN] = 0.0
        assert not asked.any(), words
        assert edited_parts(words) == frozenset()
        assert left_to_network(words) == words


def test_a_caption_of_a_captured_run_leans_as_it_does() -> None:
    words = STYLES["neutral_bn2"].descriptions[0]
    low, high = captured().styles["neutral_bn2"]["jog"]["torso"]["lean"]
    weight, least, most = edit_targets(words)[JOG, ROW_TRUNK, LEAN]
    assert weight == 1.0
    assert low < least == most < high
    # of four styles that share the sentence, by itself, what either does
    weight, least, most = edit_targets(replace(PLAIN, torso=words.torso))[JOG, ROW_TRUNK, LEAN]
    assert 3.0 < least < low < high < most


@pytest.mark.parametrize(
    "torso", ["torso upright", "torso upright, chin level", "at rest", "torso leaning forward"]
)
def test_jogs_lean_forward_unless_words_say_otherwise(torso: str) -> None:
    _, least, _ = edit_targets(replace(PLAIN, torso=torso))[JOG, ROW_TRUNK, LEAN]
    assert least > 3.0
    back = edit_targets(replace(PLAIN, torso="torso leaning far back"))[JOG, ROW_TRUNK, LEAN]
    assert back[1] == -MAX_TARGET


def test_a_phrase_means_what_was_measured_and_another_what_is_written() -> None:
    measured = captured().phrase("torso", "leaning forward", "lean")
    assert measured[WALK] is not None
    asked = edit_targets(replace(PLAIN, torso="torso leaning forward like a plough"))[WALK, ROW_TRUNK, LEAN]
    low, high = measured[WALK]
    assert tuple(asked[1:]) == (low + WELL_WITHIN_FRACTION * (high - low), high)
    assert captured().phrase("torso", "leaning far back", "lean") is None


def test_what_any_sentence_of_the_library_asks_for_is_read_back_from_a_file() -> None:
    rows = json.loads(asset_path("prompts/library.json").read_text("utf-8"))["entries"]
    torsos = sorted({row["torso"] for row in rows if isinstance(row.get("torso"), str)})
    assert len(torsos) > 100
    for torso in torsos:
        targets = edit_targets(replace(PLAIN, torso=torso))
        np.testing.assert_allclose(checked_targets(written_targets(targets)), targets)


def test_a_gesture_that_was_captured_standing_is_no_caption_of_a_walk() -> None:
    assert not captured().is_caption("left_arm", "left arm raised straight up overhead")
    assert captured().is_caption("left_arm", STYLES["proud"].descriptions[0].left_arm.upper())


def test_a_long_clause_of_one_style_is_measured_by_it_and_a_short_one_by_none() -> None:
    rows = {"left_arm": {"swing": (0.1, 0.2), "hand_range": (0.3, 0.4)}}
    texts = ("held quite still like wood", "held still")
    clauses = {("left_arm", text): frozenset({"odd"}) for text in texts}
    found = CapturedPhrases({"odd": {"walk": rows}}, clauses=clauses)
    assert found.clause("left_arm", "held quite still like wood", "swing") == ((0.1, 0.2), None, None)
    assert found.clause("left_arm", "held still", "swing") is None
    assert found.moves("left_arm", "held still")


@pytest.mark.parametrize(
    "tree", [[], {"styles": {}}, {"styles": {}, "usual": {"walk": {"lean": [2, 1]}}, "phrases": {}}]
)
def test_a_damaged_file_is_named(tree: object, monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "phrase_measures.json").write_text(json.dumps(tree))
    own = asset_path("prompts/styles.json")
    measures = tmp_path / "phrase_measures.json"
    monkeypatch.setattr(module, "asset_path", lambda name: own if "styles" in name else measures)
    with pytest.raises(FileError, match="phrase_measures"):
        captured.__wrapped__()
