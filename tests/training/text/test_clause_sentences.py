"""The sentences of the clause rules are those that the part edits were trained with."""

import tomllib

import pytest

from runtime.assets import asset_path

pytest.importorskip("torch")


def test_named_sentences_are_the_catalogues() -> None:
    from training.layering.catalog import EDITS

    sentences = tomllib.loads(asset_path("prompts/clauses.toml").read_text("utf-8"))["sentences"]
    for name, text in sentences.items():
        edit = name.rstrip("_23456789")
        edit = edit if edit in EDITS else f"left_{edit}"
        said = {phrase for phrases in EDITS[edit].phrases.values() for phrase in phrases}
        assert text.replace("{s}", "left") in said, name
