"""Sides and relations in English: a table of sentences written by their meaning, and what each part must then do."""

import re
import tomllib
from pathlib import Path

import pytest

from runtime.prompts.english.library import LibraryExpander
from tests.helpers.shipped import shipped_library

FOLDER = Path(__file__).parent
PARTS = {"la": "left_arm", "ra": "right_arm", "ll": "left_leg", "rl": "right_leg"}
# what a sentence of a part must contain to say so; in the words of the descriptions, not of the prompts
SAYS: dict[str, str] = tomllib.loads((FOLDER / "test_sides.toml").read_text("utf-8"))


def rows(name: str) -> list[str]:
    """The lines of a table: a sentence and what each part must do."""
    lines = (FOLDER / f"{name}.txt").read_text("utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


@pytest.fixture(scope="module")
def library() -> LibraryExpander:
    return shipped_library()


@pytest.mark.parametrize(
    "row", rows("side_sentences"), ids=[row.split(" | ")[0][:60] for row in rows("side_sentences")]
)
def test_each_part_does_what_the_sentence_means(row: str, library: LibraryExpander) -> None:
    sentence, *expectations = row.split(" | ")
    words = library.expand(sentence).descriptions.to_mapping()
    failed = [e for e in expectations if not holds(e, words)]
    assert not failed, f"{sentence}: {failed} in {words}"


@pytest.mark.parametrize(("name", "least"), [("seen_prompts", 94), ("unseen_prompts", 78)])
def test_prompts_of_animators_are_read(name: str, least: int, library: LibraryExpander) -> None:
    whole, held, of = 0, 0, 0
    for row in rows(name):
        sentence, *expectations = row.split(" | ")
        words = library.expand(sentence).descriptions.to_mapping()
        failed = [e for e in expectations if not holds(e, words)]
        whole, held, of = whole + (not failed), held + len(expectations) - len(failed), of + len(expectations)
        if failed and not name.startswith("unseen"):
            print(sentence, failed)  # those that are only counted are not looked at
    print(f"{name}: {whole} of {len(rows(name))} prompts whole, {held} of {of} expectations hold")
    assert whole >= least


def holds(expectation: str, words: dict[str, str]) -> bool:
    """Whether the sentences `words` of the parts meet one expectation of the table."""
    part, _, what = expectation.partition(": ")
    if part in ("arms", "legs"):
        limb, (one, other) = part[:-1], what.split("/")
        left, right = words[f"left_{limb}"], words[f"right_{limb}"]
        return any(says(one, a) and says(other, b) for a, b in ((left, right), (right, left)))
    return says(what, words[PARTS.get(part, part)])


def says(what: str, sentence: str) -> bool:
    """Whether a sentence says WHAT, or does not for !WHAT."""
    denied = what.startswith("!")
    found = any(re.search(SAYS[name], sentence) for name in what.lstrip("!").split("|"))
    return found != denied
