"""The shipped prompt library: its extent, its vocabulary, its embeddings, and what is said of damaged files."""

import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.errors import FileError
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.english.phrases import PhraseIndex
from runtime.prompts.english.words import key, words_of
from runtime.prompts.gpt.prompt import load_structured_prompt
from runtime.prompts.library_data import PromptLibrary, load_embeddings, load_library, load_styles, sentences
from runtime.prompts.text_encoder import TextEncoder
from runtime.skeleton import PART_NAMES
from tests.helpers.shipped import shipped_encoder
from training.text.build_library import other_words

PROMPTS = asset_path("prompts/library.json").parent
ENCODER = shipped_encoder()
# the styles of the 100STYLE data set, by the names of its files
STYLES_100 = (
    "Aeroplane Akimbo Angry ArmsAboveHead ArmsBehindBack ArmsBySide ArmsFolded Balance BeatChest BentForward "
    "BentKnees BigSteps BouncyLeft BouncyRight Cat Chicken CrossOver Crouched CrowdAvoidance Depressed "
    "Dinosaur DragLeftLeg DragRightLeg Drunk DuckFoot Elated FairySteps Flapping FlickLegs Followed "
    "GracefulArms HandsBetweenLegs HandsInPockets Heavyset HighKnees InTheDark KarateChop Kick LawnMower "
    "LeanBack LeanLeft LeanRight LeftHop LegsApart LimpLeft LimpRight LookUp Lunge March Monk Morris Neutral "
    "Old OnHeels OnPhoneLeft OnPhoneRight OnToesBentForward OnToesCrouched PendulumHands Penguin PigeonToed "
    "Proud Punch Quail RaisedLeftArm RaisedRightArm RightHop Roadrunner Robot Rocket Rushed ShieldedLeft "
    "ShieldedRight Skip SlideFeet SpinAntiClock SpinClock Star StartStop Stiff Strutting Superman Swat Sweep "
    "Swimming SwingArmsRound SwingShoulders Teapot Tiptoe TogetherStep TwoFootJump WalkingStickLeft "
    "WalkingStickRight Waving WhirlArms WideLegs WiggleHips WildArms WildLegs Zombie"
)
ALSO_NAMED = "TwistFoot TwistShoulders"


@pytest.fixture(scope="module")
def library() -> PromptLibrary:
    return load_library(PROMPTS / "library.json", load_styles(PROMPTS / "styles.json"))


def test_every_entry_is_its_own(library: PromptLibrary) -> None:
    descriptions = Counter(entry.descriptions for entry in library.entries)
    assert [d for d, count in descriptions.items() if count > 1] == []
    asked = Counter(key(words_of(text)) for entry in library.entries for text in (entry.prompt, *entry.also))
    assert [text for text, count in asked.items() if count > 1] == []
    assert sum(asked.values()) >= 4000
    assert len(set(library.nothing)) == len(library.nothing) > 400
    phrases = PhraseIndex(library)
    assert [word for word in library.alone if phrases.whole(word) is None] == []


def test_six_different_sentences_of_what_can_be_seen(library: PromptLibrary) -> None:
    for entry in library.entries:
        texts = entry.descriptions.as_tuple()
        assert len(set(texts)) == len(PART_NAMES), entry.prompt
        for text in texts:
            assert 2 <= len(text.split()) <= 30, text
            assert not set("{}@.") & set(text), text


def test_descriptions_keep_to_the_vocabulary(library: PromptLibrary) -> None:
    terms = [term for terms in load_structured_prompt().words.values() for term in terms]
    known = {word for term in terms for word in term.split()}
    written = [e.descriptions for e in library.entries if not e.style]
    words = Counter(word for d in written for text in d.as_tuple() for word in re.findall("[a-z]+", text))
    assert [word for word in words if word not in known] == []


def test_limbs_are_described_on_their_own_side(library: PromptLibrary) -> None:
    styles = load_styles(PROMPTS / "styles.json")
    every = [d for style in styles.values() for d in style.descriptions]
    every += [entry.descriptions for entry in library.entries]
    for description in every:
        for part in ("left_arm", "right_arm", "left_leg", "right_leg"):
            own, other = ("left", "right") if part.startswith("left") else ("right", "left")
            words = re.findall(r"\w+", getattr(description, part))
            assert own in words, getattr(description, part)
            assert other not in words[:2], getattr(description, part)


def test_the_styles_of_100style_are_known_by_name(library: PromptLibrary) -> None:
    phrases = PhraseIndex(library)
    for name in f"{STYLES_100} {ALSO_NAMED}".split():
        spoken = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
        assert phrases.whole(name) is not None, name
        assert phrases.whole(name) == phrases.whole(spoken.lower()) == phrases.whole(f"{spoken} "), name


def test_a_name_may_leave_out_who_does_it(library: PromptLibrary) -> None:
    phrases = PhraseIndex(library)
    for style in load_styles(PROMPTS / "styles.json").values():
        entry = phrases.whole(style.prompt)
        assert entry is not None
        plainly = re.sub(r"^(someone|a person|people) ", "", style.prompt)
        assert phrases.whole(plainly) == phrases.whole(f"somebody {plainly}") == entry


# --- embeddings
def test_stored_embeddings_fit_the_shipped_words(library: PromptLibrary) -> None:
    """Fails when library.json or a style changed without `python -m training.text.build_library`."""
    path = PROMPTS / "library.npz"
    stored = load_embeddings(path, library, ENCODER)
    assert path.stat().st_size < 3_000_000
    network = TextEncoder(stored=False)
    for entry in (5, 250, -1):
        texts = sentences(library)[6 * entry :][:6]
        # versions of onnxruntime differ by 6e-3 in a number; another sentence is at most 0.99 alike
        assert (stored.parts[entry] * network.encode(texts)).sum(-1) == pytest.approx(1.0, abs=2e-3)
        np.testing.assert_array_equal(stored.parts[entry], ENCODER.encode(texts))
    assert stored.other_words == other_words(PhraseIndex(library).known)
    assert "hoarse" in stored.other_words


# --- a library of one's own
def _small_library(directory: Path, entries: list[object], **lists: object) -> Path:
    (directory / "styles.json").write_bytes((PROMPTS / "styles.json").read_bytes())
    path = directory / "library.json"
    path.write_text(json.dumps({"entries": entries, **lists}))
    return path


NEUTRAL = {"style": "neutral"}
CRAB = {"prompt": "crab", "arms": "{s} hand like a claw", "legs": "@chicken", "torso": "low", "head": "up"}


def test_a_library_without_embeddings_computes_them(tmp_path: Path) -> None:
    expansion = LibraryExpander(ENCODER, _small_library(tmp_path, [CRAB, NEUTRAL])).expand("crab")
    assert expansion.descriptions.right_arm == "right hand like a claw"
    assert expansion.descriptions.left_leg.startswith("left")


def test_outdated_embeddings_are_not_used(tmp_path: Path) -> None:
    path = _small_library(tmp_path, [{"style": "chicken"}, NEUTRAL])
    (tmp_path / "library.npz").write_bytes((PROMPTS / "library.npz").read_bytes())
    nearest = LibraryExpander(ENCODER, path).expand("a clucking hen").nearest
    assert nearest[0][0] == "someone strutting like a chicken"


@pytest.mark.parametrize(
    ("entries", "lists", "named"),
    [
        ([NEUTRAL, {"prompt": "crab"}], {}, "entry 1"),
        ([NEUTRAL, {"style": "nobody"}], {}, "entry 1"),
        ([NEUTRAL, 7], {}, "entry 1"),
        ([NEUTRAL, {"prompt": "a", "arms": "@nobody", "legs": "x"}], {}, "entry 1"),
        ([NEUTRAL, {**CRAB, "defines": ["tail"]}], {}, "entry 1"),
        ([NEUTRAL, {**CRAB, "defines": []}], {}, "entry 1"),
        ([{**CRAB, "opposite": "lobster"}], {}, "lobster"),
        ([CRAB], {"alone": 7}, r"library\.json.*'alone'"),
        ([CRAB], {"nothing": [""]}, r"library\.json.*'alone'"),
        ([CRAB], {"categories": {"animals": {}}}, r"library\.json.*'alone'"),
        ([CRAB], {"categories": ["animals"]}, r"library\.json.*'alone'"),
        ([CRAB], {}, "neutral"),
    ],
)
def test_what_is_malformed_is_named(
    tmp_path: Path, entries: list[object], lists: dict[str, object], named: str
) -> None:
    path = _small_library(tmp_path, entries, **lists)
    with pytest.raises(FileError, match=named):
        LibraryExpander(ENCODER, path).expand("crab")


def test_damaged_files_are_named(tmp_path: Path) -> None:
    path = _small_library(tmp_path, [{"style": "chicken"}])
    (tmp_path / "library.npz").write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(FileError, match=r"library\.npz"):
        LibraryExpander(ENCODER, path).expand("crab")
    path.write_text("{")
    with pytest.raises(FileError, match=r"library\.json"):
        LibraryExpander(ENCODER, path).expand("crab")
