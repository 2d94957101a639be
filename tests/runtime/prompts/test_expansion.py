"""What the library makes of prompts: entries by their names, mixtures by part, denials, degrees, typing errors."""

import dataclasses
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.errors import PromptError
from runtime.prompts.edit_targets import left_to_network, targets_of
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.english.spelling import Spelling
from runtime.prompts.expander import DEFAULT_PROMPT, Expansion
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.skeleton import PART_NAMES
from tests.helpers.shipped import shipped_library
from tests.helpers.tables import table

ARMS, LEGS = ("left_arm", "right_arm"), ("left_leg", "right_leg")


@cache
def expander() -> LibraryExpander:
    return shipped_library()


@cache
def expand(prompt: str) -> Expansion:
    return expander().expand(prompt)


def parts_of(prompt: str, parts: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(getattr(expand(prompt).descriptions, part) for part in parts)


def moves_like(prompt: str, entry: str, parts: tuple[str, ...]) -> bool:
    return parts_of(prompt, parts) == parts_of(entry, parts)


NEUTRAL = "a person walking normally"


# --- one entry
def test_a_neutral_prompt_is_near_nothing_else() -> None:
    assert expand(DEFAULT_PROMPT).nearest == (("someone walking in a relaxed, everyday way", 1.0),)
    with_a_clause = f"{DEFAULT_PROMPT}, left hand on the hip"
    assert expand(with_a_clause).nearest == expand(DEFAULT_PROMPT).nearest
    assert moves_like(with_a_clause, DEFAULT_PROMPT, ("right_arm", *LEGS, "torso", "head"))
    assert len(expand("a zombie").nearest) > 1


def test_a_clause_overrides_only_its_part() -> None:
    plain, hanging = expand("an exhausted soldier"), expand("an exhausted soldier, left arm hanging")
    assert hanging.explicit_parts == ("left_arm",)
    assert "hanging limp" in hanging.descriptions.left_arm
    assert hanging.descriptions.as_tuple()[1:] == plain.descriptions.as_tuple()[1:]
    assert plain.nearest[0] == ("an exhausted soldier", pytest.approx(1.0, abs=0.01))


@pytest.mark.parametrize(("prompt", "nearest"), table(__file__, "new_words_find_their_entry"))
def test_new_words_find_their_entry(prompt: str, nearest: str) -> None:
    expansion = expand(prompt)
    assert expansion.source == "library"
    assert nearest in [found for found, _ in expansion.nearest[:2]]
    similarities = [s for _, s in expansion.nearest]
    assert similarities == sorted(similarities, reverse=True)


@pytest.mark.parametrize("prompt", ["walk calmly", "a calm walk", "walk slowly", "a peaceful person"])
def test_calm_words_bring_no_temper(prompt: str) -> None:
    assert expand(prompt).note == ""
    assert "relaxed" in expand(prompt).descriptions.torso


@pytest.mark.parametrize(
    ("prompt", "leg"),
    [("an angry man", "stomping"), ("a drunk man", "stumbling"), ("walk happily", "bounce")],
)
def test_a_mood_of_nobody_in_particular_moves_the_whole_body(prompt: str, leg: str) -> None:
    assert leg in expand(prompt).descriptions.left_leg


@pytest.mark.parametrize(("prompt", "leg"), table(__file__, "where_feet_are_leaves_the_way_that_they_step"))
def test_where_feet_are_leaves_the_way_that_they_step(prompt: str, leg: str) -> None:
    assert expand(prompt).descriptions.left_leg == leg


def test_one_arm_does_what_a_figure_does_with_both() -> None:
    against_wind = expand("walking against a strong wind, one arm shielding the eyes")
    assert "hanging" in against_wind.descriptions.left_arm


def test_far_words_are_composed_of_neighbours_and_say_how_near() -> None:
    expansion = expand("somebody measuring a room in strides")
    assert f"{expansion.nearest[0][1]:.0%}" in expansion.note
    assert expansion.nearest[0][0] in expansion.note


@pytest.mark.parametrize(("side", "other"), [("left", "right"), ("right", "left")])
@pytest.mark.parametrize(
    "prompt", ["someone waves the {} hand", "limping on the {} leg", "{} hand up", "hop on the {} leg"]
)
def test_sides_are_not_mistaken(prompt: str, side: str, other: str) -> None:
    there, back = expand(prompt.format(side)).descriptions, expand(prompt.format(other)).descriptions
    part = "arm" if "hand" in prompt else "leg"
    assert getattr(there, f"{side}_{part}") == mirror_text(getattr(back, f"{other}_{part}"))
    assert getattr(there, f"{side}_{part}") != mirror_text(getattr(there, f"{other}_{part}"))


def test_what_is_left_of_a_clause_is_an_entry_too() -> None:
    assert expand("a chicken with a limp").explicit_parts == ("right_leg",)
    assert moves_like("a chicken with a limp", "chicken", (*ARMS, "left_leg", "torso", "head"))


@pytest.mark.parametrize(
    ("prompt", "side"),
    [
        ("a limping man", "right"),
        ("a man limping on the left leg", "left"),
        ("limping, putting little weight on it", "right"),
    ],
)
def test_who_only_limps_does_so_with_the_whole_body(prompt: str, side: str) -> None:
    limping = expand(prompt)
    assert limping.explicit_parts == (f"{side}_leg",)
    assert "limping" in getattr(limping.descriptions, f"{side}_leg")
    assert moves_like(prompt, f"limping on the {side} leg", (*ARMS, "torso", "head"))
    raised = expand(f"{prompt}, both arms raised").descriptions
    assert "raised" in raised.left_arm
    assert raised.torso == limping.descriptions.torso


@pytest.mark.parametrize(
    ("prompt", "unlike"),
    [
        ("a star athlete", "star"),
        ("a child running to the ice cream van", "ice"),
        ("an angry mob", "mobster"),
    ],
)
def test_words_that_mean_something_else_in_company_are_not_taken(prompt: str, unlike: str) -> None:
    assert not moves_like(prompt, unlike, ("left_leg",))


def test_only_clauses_are_explicit_on_a_neutral_body() -> None:
    expansion = expand("a person with hands on hips")
    assert expansion.source == "explicit"
    assert moves_like("a person with hands on hips", NEUTRAL, ("torso", *LEGS))
    assert "hip" in expansion.descriptions.left_arm


# --- several entries
@pytest.mark.parametrize(
    ("prompt", "sources"),
    table(__file__, "mixtures_are_by_part") + table(__file__, "what_is_denied_of_a_figure_is_taken_from_it"),
)
def test_mixtures_are_by_part(prompt: str, sources: dict[str, str]) -> None:
    groups = {"arms": ARMS, "legs": LEGS}
    for entry, words in sources.items():
        parts = tuple(part for word in words.split() for part in groups.get(word, (word,)))
        entry = NEUTRAL if entry == "NEUTRAL" else entry
        assert moves_like(prompt, entry, parts), (entry, expand(prompt).note)


def test_a_mixture_names_its_parts_and_their_sources() -> None:
    assert expand("a depressed robot").note.startswith("arms, legs: “robot”; torso, head: “depressed person”")


@pytest.mark.parametrize(
    ("prompt", "like", "unlike"), table(__file__, "whoever_is_only_mentioned_does_not_move")
)
def test_whoever_is_only_mentioned_does_not_move(prompt: str, like: str, unlike: str) -> None:
    assert moves_like(prompt, like, ("torso", "head"))
    assert not moves_like(prompt, unlike, ("torso",))


# --- denials
@pytest.mark.parametrize(
    ("prompt", "like", "note"), table(__file__, "what_is_denied_or_only_compared_is_left_out_and_said")
)
def test_what_is_denied_or_only_compared_is_left_out_and_said(prompt: str, like: str, note: str) -> None:
    assert moves_like(prompt, like, PART_NAMES)
    assert note in expand(prompt).note


@pytest.mark.parametrize("prompt", ["no energy left", "not a care in the world", "can't see anything"])
def test_denials_that_are_ways_to_say_something_are_kept(prompt: str) -> None:
    assert expand(prompt).note == ""
    assert not moves_like(prompt, NEUTRAL, PART_NAMES)


@pytest.mark.parametrize(("left", "right"), table(__file__, "the_other_side_is_mirrored"))
def test_the_other_side_is_mirrored(left: str, right: str) -> None:
    assert expand(left).descriptions == expand(right).descriptions.mirrored()


def test_a_mood_is_kept_beside_a_figure_near_the_whole_prompt() -> None:
    assert moves_like("weary nurse going home after a very long shift", "nurse", LEGS)
    assert not moves_like("weary nurse going home after a very long shift", "nurse", ("torso",))


@pytest.mark.parametrize(
    "prompt",
    [
        "arms do not swing",
        "his arms don't swing",
        "the arms cannot swing",
        "the arms never swing",
        "no arm swing",
        "walks without the arm swing",
    ],
)
def test_arms_that_do_not_swing_hang_still(prompt: str) -> None:
    assert all("not swinging" in arm for arm in parts_of(prompt, ARMS))


def test_one_foot_in_front_of_the_other_is_both_feet() -> None:
    prompt = "hands on hips, one foot in front of the other"
    assert all("one line" in leg for leg in parts_of(prompt, LEGS))


@pytest.mark.parametrize("figure", ["zombie", "drunk", "king"])
def test_a_figure_that_walks_slowly_keeps_its_gait_and_only_its_speed_is_bounded(figure: str) -> None:
    own, slow = (expand(f"a {figure}{words}").descriptions for words in ("", " walking slowly"))
    legs = {part: f"{getattr(own, part)}, walking slowly" for part in LEGS}
    assert slow == dataclasses.replace(own, **legs)
    assert left_to_network(slow) == left_to_network(own)
    assert "pace" in targets_of("left_leg", slow.left_leg)


# --- typing errors
@pytest.mark.parametrize(("prompt", "meant"), table(__file__, "one_wrong_letter_is_read_and_said"))
def test_one_wrong_letter_is_read_and_said(prompt: str, meant: str) -> None:
    assert expand(prompt).descriptions == expand(meant).descriptions
    assert "read as" in expand(prompt).note


@pytest.mark.parametrize("prompt", ["a hoarse robot", "a guy named Steve", "a dessert chef", "stumbled"])
def test_right_words_are_not_corrected(prompt: str) -> None:
    assert "read as" not in expand(prompt).note


def test_spelling_needs_a_known_word_one_letter_off() -> None:
    spelling = Spelling({"penguin", "stomping"}, {"stamping"})
    wrong, right = "A penguni is stompin, stamping or penguins", "A penguin is stomping, stamping or penguins"
    assert spelling.corrected(wrong) == (right, {"penguni": "penguin", "stompin": "stomping"})
    assert spelling.corrected("pinguin pengu engine") == ("pinguin pengu engine", {})


# --- any prompt
@pytest.mark.parametrize("prompt", ["", "  \n ", "x" * 1001, "x" * 10_000, "bell\x07", "\ud800", None])
def test_unusable_prompts_are_refused_with_a_remedy(prompt: str) -> None:
    with pytest.raises(PromptError, match="prompt") as raised:
        expander().expand(prompt)
    assert raised.value.remedy


@given(st.text(alphabet=st.characters(exclude_categories=("Cc", "Cs")), min_size=1, max_size=80))
@settings(max_examples=40, deadline=None)
def test_any_prompt_expands(text: str) -> None:
    if text.split():
        assert len(expander().expand(text).descriptions.as_tuple()) == 6


WORDS = [
    "a",
    "very",
    "not",
    "sad",
    "old",
    "robot",
    "like",
    "with",
    "carrying",
    "bear",
    "arms",
    "of",
    "the",
    "left,",
    "slowly",
    "and",
    "without",
    "drunk",
    "dancing",
]


@given(st.lists(st.sampled_from(WORDS), min_size=1, max_size=14))
@settings(max_examples=60, deadline=None)
def test_any_sentence_of_known_words_expands(words: list[str]) -> None:
    expansion = expander().expand(" ".join(words))
    assert isinstance(expansion.descriptions, PartDescriptions)
    assert set(expansion.explicit_parts) <= set(PART_NAMES)
