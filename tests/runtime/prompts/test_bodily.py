"""What says nothing about a body is answered with neutral walking and says so; what is only odd is not."""

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.assets import asset_path
from runtime.errors import FileError
from runtime.prompts.english import other_languages
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.library_data import load_library, load_styles
from tests.helpers.shipped import shipped_encoder, shipped_library
from tests.helpers.tables import table


def prompts_of(name: str) -> list[str]:
    """A list of `bodily_prompts.txt`."""
    text = Path(__file__).with_name("bodily_prompts.txt").read_text("utf-8")
    return text.partition(f"[{name}]\n")[2].partition("\n\n")[0].splitlines()


@cache
def expander() -> LibraryExpander:
    return shipped_library()


def is_neutral(prompt: str) -> bool:
    expansion = expander().expand(prompt)
    return expansion.descriptions == expander().expand("a person walking normally").descriptions


@pytest.mark.parametrize(("name", "most"), [("BODILY", 3), ("UNSEEN_BODILY", 9)])
def test_few_bodily_prompts_are_left_neutral(name: str, most: int) -> None:
    missed = [prompt for prompt in prompts_of(name) if is_neutral(prompt)]
    assert len(missed) <= most, missed


@pytest.mark.parametrize(("name", "most"), [("NOTHING", 4), ("UNSEEN_NOTHING", 4)])
def test_few_prompts_about_nothing_are_taken_for_a_walk(name: str, most: int) -> None:
    missed = [prompt for prompt in prompts_of(name) if not is_neutral(prompt)]
    assert len(missed) <= most, missed


@pytest.mark.parametrize("prompt", table(__file__, "nothing_bodily_is_neutral_and_says_so"))
def test_nothing_bodily_is_neutral_and_says_so(prompt: str) -> None:
    assert is_neutral(prompt)
    assert "neutral" in expander().expand(prompt).note


@pytest.mark.parametrize("prompt", table(__file__, "other_languages_are_neutral_and_named"))
def test_other_languages_are_neutral_and_named(prompt: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(other_languages, "open_e5", lambda: None)
    alone = LibraryExpander(shipped_encoder()).expand(prompt)
    assert alone.descriptions == expander().expand("a person walking normally").descriptions
    assert "not English" in alone.note
    assert "sport-viewer[languages]" in alone.note
    assert alone.nearest == ()


def test_with_a_multilingual_encoder_the_nearest_entry_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = asset_path("prompts/library.json").parent
    content = load_library(folder / "library.json", load_styles(folder / "styles.json"))
    clown = next(i for i, entry in enumerate(content.entries) if entry.prompt == "clown")
    with np.load(folder / other_languages.FILE) as data:
        vector = data["prompts"][list(data["entry_of"]).index(clown)].astype(np.float32) + 0.0
        mean = data["mean"]
        query = mean + 0.2 * vector / np.linalg.norm(vector)
    encoder = SimpleNamespace(query=lambda prompt: query if "Narr" in prompt else 2 * mean - query)
    monkeypatch.setattr(other_languages, "open_e5", lambda: encoder)
    library = LibraryExpander(shipped_encoder())
    found = library.expand("ein lustiger Narr und sein Hut")
    assert found.nearest[0] == ("clown", pytest.approx(1.0, abs=0.01))
    assert "is not English: nearest by meaning is “clown”" in found.note
    assert "is not English: neutral" in library.expand("die Steuer und der Preis").note


@pytest.mark.parametrize("change", [{"entry_of": [999] * 3}, {"mean": [np.nan, 0.0]}, {"prompts": [[1, 0]]}])
def test_damaged_vectors_of_other_languages_are_one_sentence(
    change: dict[str, list[float]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = asset_path("prompts/library.json").parent
    content = load_library(folder / "library.json", load_styles(folder / "styles.json"))
    good = {"prompts": [[1, 0]] * 3, "entry_of": [0, 1, 2], "mean": [0.0, 0.0]} | change
    np.savez(tmp_path / "languages.npz", digest=np.array(other_languages.prompts_hash(content)), **good)
    monkeypatch.setattr(other_languages, "open_e5", lambda: SimpleNamespace(query=lambda prompt: np.ones(2)))
    with pytest.raises(FileError, match="none of these entries"):
        other_languages.OtherLanguages(tmp_path, content).nearest("ein Narr")


def test_nonsense_is_said_to_be_and_shows_no_match() -> None:
    answer = expander().expand("asdf qwer")
    assert "Nothing was understood" in answer.note
    assert (answer.nearest, is_neutral("asdf qwer")) == ((), True)


@pytest.mark.parametrize(
    "prompt", ["a café waiter", "la la land dancer", "a den mother", "en garde", "a man from El Paso"]
)
def test_foreign_words_in_english_do_not_matter(prompt: str) -> None:
    assert "not English" not in expander().expand(prompt).note


def test_whoever_is_named_is_somebody_whatever_else_is_said() -> None:
    report = expander().expand("a soldier reading the quarterly report")
    assert "soldier" in report.nearest[0][0]
    assert not is_neutral("a soldier reading the quarterly report")
    assert is_neutral("reading of the quarterly report")
