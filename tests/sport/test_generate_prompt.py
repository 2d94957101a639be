"""`sport generate` from words: six descriptions in a file, the library, and a language model on loopback."""

import json

import pytest

import runtime.generate as generate_module
import runtime.motion.model
import runtime.prompts.gpt.expander
import runtime.prompts.prompter
from runtime.errors import UsageError
from runtime.formats.bvh import read_bvh
from runtime.prompts.parts import PartDescriptions
from sport import cli
from tests.helpers.gpt_endpoint import FIVE, PROUD, Encoder
from tests.helpers.walker import WalkerModel, settle_soon


@pytest.fixture
def walker(monkeypatch, tmp_path):
    """`sport generate` with a synthetic walker, and the words that its prompt encoder was given."""
    seen = []

    class Encoding(Encoder):
        def __init__(self, *_):
            pass

        def encode(self, descriptions):
            seen.append(descriptions)
            return super().encode(descriptions) / 200.0

    model = WalkerModel()
    model.prompt_path = tmp_path / "none.onnx"
    settle_soon(monkeypatch)
    monkeypatch.setattr(runtime.motion.model, "load_model", lambda folder=None, threads=1: model)
    monkeypatch.setattr(runtime.prompts.prompter, "PromptEncoder", Encoding)
    monkeypatch.setenv("SPORT_CACHE_DIR", str(tmp_path / "cache"))
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "SPORT_GPT_MODEL"):
        monkeypatch.delenv(name, raising=False)
    return seen


def test_generate_from_six_descriptions(walker, tmp_path, capsys):
    parts, out = tmp_path / "parts.json", tmp_path / "clip.bvh"
    parts.write_text(PROUD.to_json(), encoding="utf-8-sig")
    assert cli.main(["generate", "--parts", str(parts), "--seconds", "0.5", "--out", str(out)]) == 0
    assert walker == [PROUD]
    assert len(read_bvh(out).positions) == 30


@pytest.mark.parametrize(
    ("content", "problem"),
    [(None, "No such file"), (b"\xff\xff", "UTF-8"), (json.dumps(FIVE).encode(), "head"), (b"prose", "not JSON"),
     (b"[1]", "object"), (b" " * 200_000, "larger")],
)  # fmt: skip
def test_a_parts_file_that_cannot_be_used_is_named(walker, tmp_path, capsys, content, problem):
    parts, out = tmp_path / "parts.json", tmp_path / "clip.bvh"
    if content is not None:
        parts.write_bytes(content)
    assert cli.main(["generate", "--parts", str(parts), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "parts.json" in error
    assert problem in error
    assert not out.exists()


def test_generate_asks_the_language_model_when_told(walker, endpoint, monkeypatch, tmp_path):
    monkeypatch.setenv("OPENAI_BASE_URL", endpoint.url)
    out = tmp_path / "clip.bvh"
    arguments = ["generate", "--prompt", "proud", "--expander", "gpt", "--seconds", "0.5", "--out", str(out)]
    assert cli.main(arguments) == 0
    assert walker == [PROUD]
    assert endpoint.bodies[0]["model"] == "gpt-4o-mini"


def test_generate_does_not_quietly_use_another_expander(walker, tmp_path, capsys):
    out = tmp_path / "clip.bvh"
    assert cli.main(["generate", "--prompt", "proud", "--expander", "gpt", "--out", str(out)]) == 2
    assert "OPENAI_API_KEY" in capsys.readouterr().err
    assert not out.exists()
    with pytest.raises(UsageError, match="oracle"):
        generate_module.Prompter(WalkerModel(), "oracle")


def test_generate_tells_what_the_library_remarks(walker, tmp_path, capsys):
    out = tmp_path / "clip.bvh"
    prompt = "tax return of the third quarter"
    assert cli.main(["generate", "--prompt", prompt, "--seconds", "0.5", "--out", str(out)]) == 0
    assert "neutral" in capsys.readouterr().err
    assert isinstance(walker[0], PartDescriptions)
