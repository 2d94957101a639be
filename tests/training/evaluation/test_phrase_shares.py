"""What a model shows of a sentence: claims in measures, the table of shares, and the words about it."""

import json
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import FileError
from runtime.measures.table import BodyMeasures, measure
from runtime.prompts import library_data
from runtime.prompts.english.compose import compose_neighbours
from runtime.prompts.expander import Expansion
from runtime.prompts.library_data import LibraryEmbeddings, LibraryEntry
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.phrasing import (
    ModelPhrasing,
    PromptAdherence,
    as_left_limb,
    load_adherence,
    load_phrasings,
)
from runtime.skeleton import PART_NAMES
from tests.helpers.tables import table
from tests.helpers.walker import WalkerModel
from tests.training.augmentation.test_augmentation import walker
from training.augmentation.catalogue import part_edits
from training.augmentation.edits import apply
from training.evaluation.text import prompt_adherence
from training.evaluation.text import walks as text_walks
from training.export import words
from training.text.claims import clause_fraction, clauses

PLAIN = PartDescriptions(**{part: f"{part.replace('_', ' ')} as it is" for part in PART_NAMES})
TABLE = PromptAdherence(
    {("arm", "left hand on the hip, held still"): 0.2, ("torso", "torso upright"): 0.9},
    {("arm", "elbow bent"): 0.8, ("arm", "left arm raised"): 0.4},
)


def measured(name: str = "") -> BodyMeasures:
    motion = walker(420)
    if name:
        motion = apply(motion, part_edits()[name], np.random.default_rng(1))
    return measure(motion.hips, motion.local, motion.contacts)


# --- the table
def test_a_sentence_of_the_right_limb_is_looked_up_as_one_of_the_left() -> None:
    assert as_left_limb("Right hand on the  hip", "right_arm") == ("arm", "left hand on the hip")
    assert as_left_limb("head turned to the right", "head") == ("head", "head turned to the right")
    assert TABLE.of("right hand on the hip, held still", "right_arm") == 0.2
    assert TABLE.of("right hand on the hip, held still", "left_arm") is None


def test_a_limb_that_differs_from_the_other_has_a_share_of_its_own() -> None:
    found = prompt_adherence.Found()
    for part, share in (("left_arm", 0.0), ("right_arm", 0.9)):
        side = part.split("_")[0]
        found.add_edit(part, f"{side} hand behind the back", share)
        found.add_edit(part, f"{side} arm raised", 0.8)
    tables = found.table()
    assert tables["sentences"] == {
        "arm": {"left arm raised": 0.8, "left hand behind the back": 0.45},
        "left_arm": {"left hand behind the back": 0.0},
        "right_arm": {"left hand behind the back": 0.9},
    }
    assert tables["clauses"] == tables["sentences"]
    table = PromptAdherence({(g, w): v for g, own in tables["sentences"].items() for w, v in own.items()})
    assert table.of("left hand behind the back", "left_arm") == 0.0
    assert table.of("right hand behind the back", "right_arm") == 0.9
    assert table.of("right arm raised", "right_arm") == 0.8


def test_what_was_not_measured_has_the_mean_of_its_clauses_or_nothing() -> None:
    assert TABLE.of("left arm raised, elbow bent, fingers spread", "left_arm") == pytest.approx(0.6)
    assert TABLE.of("left arm juggling", "left_arm") is None
    with pytest.raises(ValueError, match="tail"):
        TABLE.of("wagging", "tail")


def test_the_note_names_what_is_hardly_shown() -> None:
    said = PLAIN.replace("right_arm", "right hand on the hip, held still").replace("torso", "torso upright")
    assert TABLE.weakly_shown(said) == {"right_arm": 0.2}
    assert "right arm “right hand on the hip, held still” (20%)" in TABLE.note(said, said)
    assert TABLE.note(PLAIN, PLAIN) == ""


def test_tables_are_read_and_damage_is_named(tmp_path: Path) -> None:
    path = tmp_path / "shares.json"
    assert load_adherence(path) == {}
    tables = {"compact": {"sentences": {"head": {"head down": 0.5}}, "clauses": {}}}
    path.write_text(json.dumps(tables), "utf-8")
    assert load_adherence(path)["compact"].of("head down", "head") == 0.5
    share = '{"a": {"sentences": {"head": {"x": 7}}, "clauses": {}}}'
    for damage in ('{"compact": {"sentences": {}}}', "[1]", share):
        path.write_text(damage, "utf-8")
        with pytest.raises(FileError, match=r"shares\.json"):
            load_adherence(path)


def test_the_library_prefers_the_sentence_that_is_shown() -> None:
    parts = np.tile(np.array([[1.0, 0.0], [0.98, 0.2]], np.float32)[:, None], (1, 6, 1))
    embeddings = LibraryEmbeddings(parts[:, 0], np.arange(2), parts, np.zeros(3, np.float32))
    ranked = [(0, 0.6), (1, 0.6)]

    def worth(entry: int, part: str) -> float:
        return 0.8 if entry == chosen and part == "head" else 1.0

    plain = compose_neighbours(ranked, embeddings, lambda entry, part: 1.0)
    chosen = plain["head"]
    made = compose_neighbours(ranked, embeddings, worth)
    assert made["head"] != chosen
    assert all(made[p] == plain[p] for p in PART_NAMES if p != "head")

    def of_one_leg(entry: int, part: str) -> float:
        return 0.0 if (entry, part) in ((chosen, "left_leg"), (1 - chosen, "right_leg")) else 1.0

    legs = compose_neighbours(ranked, embeddings, of_one_leg)
    assert legs["left_leg"] == legs["right_leg"], "nobody walks on the legs of two"


# --- claims
@pytest.mark.parametrize(
    ("part", "clause", "edit"),
    table(__file__, "a_clause_is_shown_by_the_motion_that_does_it_and_not_by_neutral"),
)
def test_a_clause_is_shown_by_the_motion_that_does_it_and_not_by_neutral(
    part: str, clause: str, edit: str
) -> None:
    neutral = measured()
    motions = (measured(edit), neutral)
    shown, still = (clause_fraction(part, clause, neutral, motion) for motion in motions)
    assert shown[0] > 0.8
    assert shown[1], "the clause asks for a change"
    assert still[0] == 0.0


def test_words_that_nothing_measures_claim_nothing() -> None:
    neutral = measured()
    assert clause_fraction("left_arm", "fist clenched", neutral, neutral) is None
    assert clauses("head down, looking at the ground, ") == ["head down", "looking at the ground"]


# --- the command
class Prompter:
    """In place of a model's way from words to Z^t: a tilted head is all that the synthetic walker shows."""

    def __init__(self, model: WalkerModel, phrasing: ModelPhrasing) -> None:
        pass

    def expand(self, prompt: str) -> Expansion:
        return Expansion(PLAIN, "library")

    def __call__(self, descriptions: PartDescriptions) -> np.ndarray:
        return np.full((6, 64), 0.4 if "tilted" in descriptions.head else 0.0, np.float32)


@pytest.fixture
def synthetic(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few phrases, short walks of the synthetic walker."""
    names = ("head.tilted_right", "head.turned_left", "left_arm.overhead", "legs.long")
    kept = {name: part_edits()[name] for name in names}
    monkeypatch.setattr(words, "Prompter", Prompter)
    monkeypatch.setattr(words, "load_model", lambda folder: WalkerModel())
    metadata = {"name": "walker", "calibration": {"phase": []}}
    monkeypatch.setattr(words, "read_metadata", lambda folder: metadata)
    monkeypatch.setattr(words, "calibrate", lambda *_, **__: None)
    monkeypatch.setattr(words, "measure_wording", lambda *_: {"head": {"head tilted": "head tilted far"}})
    monkeypatch.setattr(words, "PHRASE_S", 1.5)
    monkeypatch.setattr(prompt_adherence, "part_edits", lambda: kept)
    monkeypatch.setattr(prompt_adherence, "PHRASE_S", 1.5)
    monkeypatch.setattr(text_walks, "LEAD_SECONDS", 0.5)
    monkeypatch.setattr(text_walks, "TOGETHER", 1)  # the stand-in counts its frames
    monkeypatch.setattr(text_walks, "_loaded", lambda folder: WalkerModel())
    said = PLAIN.replace("head", "head tilted to the right").replace(
        "left_arm", "left arm overhead, elbow bent"
    )
    library = library_data.PromptLibrary((LibraryEntry("one", (), said),))
    monkeypatch.setattr(words, "load_library", lambda *_: library)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "metadata.json").write_text("{}", "utf-8")
    return folder


def test_phrases_are_walked_once_and_what_is_not_done_is_said(
    synthetic: None, model: Path, tmp_path: Path
) -> None:
    out = tmp_path / "prompts" / "shares.json"
    out.parent.mkdir()
    out.write_text('{"other": {"sentences": {}, "clauses": {}}}', "utf-8")
    words.measure_words(model, tmp_path, 1, tmp_path / "work")
    phrasing = load_phrasings(tmp_path / "prompts" / "wording.json")["walker"]
    assert phrasing.of("head tilted", "head") == "head tilted far"
    tables = load_adherence(out)
    assert set(tables) == {"other", "walker"}
    found = tables["walker"]
    assert found.of(part_edits()["head.tilted_right"].phrases["head"][0], "head") > 0.5
    assert found.of("head tilted to the right", "head") > 0.5
    assert found.of(part_edits()["head.turned_left"].phrases["head"][0], "head") < 0.1
    for part in ("left_arm", "right_arm"):
        phrase = part_edits()[f"{part}.overhead"].phrases[part][0]
        assert found.of(phrase, part) < 0.3, "the walker's arms do not rise"
    assert found.of("left leg taking long strides", "left_leg") < 0.3


def test_a_measurement_that_was_killed_continues(
    synthetic: None, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(words, "calibrate", killed)
        with pytest.raises(KeyboardInterrupt):
            words.measure_words(model, tmp_path, 1, tmp_path / "work")
    assert not any((tmp_path / "prompts").iterdir())  # nothing is replaced before all is measured
    assert (model / "metadata.json").read_text("utf-8") == "{}"
    monkeypatch.setattr(words, "measure_wording", killed)  # done before
    words.measure_words(model, tmp_path, 1, tmp_path / "work")
    assert load_phrasings(tmp_path / "prompts" / "wording.json")["walker"].of("head tilted", "head")
    assert json.loads((model / "metadata.json").read_text("utf-8"))["name"] == "walker"
    assert not any((tmp_path / "work").iterdir())


def test_the_sentences_of_a_plain_walk_ask_for_nothing() -> None:
    found = prompt_adherence.Found()
    found.sentences["leg", "left leg taking brisk steps"] = [0.0]
    words = PLAIN.replace("left_leg", "left leg taking brisk steps").replace("head", "head level")
    plain = library_data.LibraryStyle("walking", (words,))
    found.add_plain(
        {"neutral_bn": plain, "neutral_rough": library_data.LibraryStyle("x", (PLAIN,)), "proud": plain}
    )
    table = found.table()["sentences"]
    assert table["leg"]["left leg taking brisk steps"] == 1.0
    assert table["head"] == {"head level": 1.0}
