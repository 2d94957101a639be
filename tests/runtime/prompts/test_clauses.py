"""Clauses that say what a part does: what is understood, and that it is said in the words of the training."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.assets import asset_path
from runtime.prompts.english.clauses import parse_clauses
from runtime.prompts.english.grammar import Grammar
from runtime.prompts.english.segments import with_commas
from runtime.prompts.english.words import continuous
from runtime.skeleton import PART_NAMES
from tests.helpers.counting import bounded
from tests.helpers.tables import table
from training.augmentation.catalogue import part_edits


@pytest.mark.parametrize(("prompt", "rest", "expected"), table(__file__, "clauses"))
def test_clauses(prompt: str, rest: str, expected: dict[str, str]) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest == rest
    assert set(parsed.parts) == set(expected)
    for part, words in expected.items():
        assert words in parsed.parts[part]


@pytest.mark.parametrize(("prompt", "edits"), table(__file__, "clauses_are_said_as_the_networks_were_told"))
def test_clauses_are_said_as_the_networks_were_told(prompt: str, edits: str) -> None:
    told = {part: phrases for edit in edits.split() for part, phrases in part_edits()[edit].phrases.items()}
    parsed = parse_clauses(prompt)
    assert parsed.rest == ""
    if "limping" in edits:  # the other leg is the library's
        told = {part: told[part] for part in parsed.parts}
    assert set(parsed.parts) == set(told)
    for part, phrases in told.items():
        assert any(parsed.parts[part].startswith(phrase) for phrase in phrases), parsed.parts[part]


@pytest.mark.parametrize(
    ("prompt", "expected"), table(__file__, "what_is_said_plainly_is_said_of_those_parts_alone")
)
def test_what_is_said_plainly_is_said_of_those_parts_alone(prompt: str, expected: dict[str, str]) -> None:
    parts = parse_clauses(prompt).parts
    assert set(parts) == set(expected)
    for part, words in expected.items():
        assert words in parts[part]


@pytest.mark.parametrize("prompt", table(__file__, "what_only_sounds_like_a_thing_is_left_as_it_is"))
def test_what_only_sounds_like_a_thing_is_left_as_it_is(prompt: str) -> None:
    assert not parse_clauses(prompt).parts
    assert set(parse_clauses(prompt).rest.split()) <= set(prompt.split())


def test_a_thing_that_is_known_is_left_to_the_library() -> None:
    assert parse_clauses("carrying a samovar").parts
    assert (
        parse_clauses("carrying a samovar", lambda text: text.endswith("samovar")).rest
        == "carrying a samovar"
    )


def test_a_raised_chin_or_look_is_told_by_words_that_show_beside_others() -> None:
    """Of "head raised, chin up" little is left beside folded arms or bent knees."""
    for prompt in ("chin up", "arms crossed, chin raised", "gazing upwards"):
        assert parse_clauses(prompt).parts["head"] == "head tilted back, chin raised, held still"
    assert parse_clauses("chin slightly up").parts["head"] == "head slightly raised"
    assert parse_clauses("looking straight up").parts["head"] == "head thrown back, looking at the sky"


@pytest.mark.parametrize(
    ("prompt", "rest", "part", "words"), table(__file__, "denials_and_instructions_say_what_is_there")
)
def test_denials_and_instructions_say_what_is_there(prompt: str, rest: str, part: str, words: str) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest == rest
    assert words in parsed.parts[part]


def test_what_is_denied_adds_nothing_to_what_is_said() -> None:
    assert parse_clauses("head down, never looking up").parts == parse_clauses("head down").parts
    assert parse_clauses("never looking up, head down").parts == parse_clauses("head down").parts


@pytest.mark.parametrize(
    "prompt", ["hold back the tears", "an elephant's trunk", "turn back home", "swing hip hop"]
)
def test_orders_need_a_body_part(prompt: str) -> None:
    assert parse_clauses(prompt).parts == {}


def test_the_order_of_rules_never_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    file = tomllib.loads(asset_path("prompts/clauses.toml").read_text("utf-8"))
    parts = ("arm", "leg", "torso", "head")
    groups = [file[group][kind] for group in parts for kind in ("actions", "denied")]
    for rules in (*groups, file["phrases"]["rules"], *file["relations"].values()):
        rules.reverse()
    lines = Path(__file__).with_name("side_sentences.txt").read_text("utf-8").splitlines()
    prompts = [line.partition(" | ")[0] for line in lines if line and not line.startswith("#")]
    parsed = [parse_clauses(prompt) for prompt in prompts]
    turned = Grammar(file)
    for module in ("clauses", "sides"):
        monkeypatch.setattr(f"runtime.prompts.english.{module}.grammar", lambda: turned)
    assert [parse_clauses(prompt) for prompt in prompts] == parsed


# --- gestures of a hand at a part
@pytest.mark.parametrize(
    ("prompt", "rest", "part", "words"), table(__file__, "a_hand_goes_where_a_gesture_says")
)
def test_a_hand_goes_where_a_gesture_says(prompt: str, rest: str, part: str, words: str) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest == rest
    assert words in parsed.parts[part]
    assert len(parsed.parts) == (2 if "both" in prompt else 1)


@pytest.mark.parametrize(
    "prompt", ["not touching the face", "a press officer", "pressing the knees together"]
)
def test_no_gesture_is_made_of_other_words(prompt: str) -> None:
    assert "right_arm" not in parse_clauses(prompt).parts


@given(st.text(max_size=300))
@settings(max_examples=150, deadline=None)
def test_any_text_parses_to_usable_descriptions(text: str) -> None:
    for part, description in parse_clauses(text).parts.items():
        assert part in PART_NAMES
        assert 0 < len(description) <= 300


def test_the_longest_prompt_parses_quickly() -> None:
    with bounded():
        words = ("left ", "looking ", "arms and ", "the his her ", "raised the left ", "hands and feet up ")
        for word in words:
            parse_clauses((word * 1000)[:1000])


@pytest.mark.parametrize(("prompt", "plain"), table(__file__, "when_something_is_done_is_no_way_of_stepping"))
def test_when_something_is_done_is_no_way_of_stepping(prompt: str, plain: str) -> None:
    assert parse_clauses(prompt) == parse_clauses(plain)


@pytest.mark.parametrize(
    "prompt", ["pausing at every step", "walks up the steps", "short steps", "on the steps"]
)
def test_steps_that_are_spoken_of_stay(prompt: str) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest.endswith(("step", "steps")) or parsed.parts


@pytest.mark.parametrize(("prompt", "way"), table(__file__, "verbs_are_read_as_the_library_has_them"))
def test_verbs_are_read_as_the_library_has_them(prompt: str, way: str) -> None:
    assert parse_clauses(prompt) == parse_clauses(way)
    assert continuous(prompt.replace(" home", "")) == way


@pytest.mark.parametrize(("prompt", "parts"), table(__file__, "idioms_are_clauses"))
def test_idioms_are_clauses(prompt: str, parts: dict[str, str]) -> None:
    found = parse_clauses(prompt).parts
    assert found.keys() == parts.keys()
    assert all(words in found[part] for part, words in parts.items()), found


@pytest.mark.parametrize(("prompt", "clauses"), table(__file__, "clauses_begin_without_a_comma"))
def test_clauses_begin_without_a_comma(prompt: str, clauses: str) -> None:
    assert with_commas(prompt).replace("\n", "|") == clauses


@pytest.mark.parametrize(("prompt", "part", "words"), table(__file__, "hedges_degrees_and_denials"))
def test_hedges_degrees_and_denials(prompt: str, part: str, words: str) -> None:
    assert words in parse_clauses(prompt).parts[part]
