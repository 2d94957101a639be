"""The language model's answers on disk, its settings and its key."""

import copy
import dataclasses
import json
import pickle
import sys
import threading
from pathlib import Path

import pytest

from runtime.errors import PromptError, UsageError
from runtime.prompts.expander import Expansion
from runtime.prompts.gpt.expander import (
    AnswerCache,
    FallbackExpander,
    GptExpander,
    cache_directory,
    check_endpoint,
)
from runtime.prompts.gpt.settings import GptSettings, Secret, gpt_configured
from tests.helpers.gpt_endpoint import DRUNK, FIVE, KEY, PROUD, Library, fail


# --- the cache
def test_a_prompt_is_asked_once(endpoint, expander_of, tmp_path):
    for _ in range(2):
        assert expander_of(endpoint).expand("proud") == Expansion(PROUD, "gpt")
    assert len(endpoint.requests) == 1
    expander_of(endpoint, model="other").expand("proud")
    expander_of(endpoint).expand("prouder")
    assert len(endpoint.requests) == 3
    stored = list((tmp_path / "gpt").iterdir())
    assert len(stored) == 3
    assert all(path.suffix == ".json" for path in stored)  # no temporary file stays
    assert not any(KEY in path.read_text() for path in stored)


@pytest.mark.parametrize(
    "damage",
    [b"", b"\xff\xfe", b"[1]", b'{"prompt": "proud"}', b"[" * 20_000, b" " * 60_000, json.dumps(
        {"prompt": "drunk", "model": "m", "descriptions": DRUNK.to_mapping()}).encode(), json.dumps(
        {"prompt": "proud", "model": "m", "descriptions": FIVE}).encode()],
)  # fmt: skip
def test_a_damaged_entry_is_ignored_and_replaced(tmp_path, caplog, damage):
    cache = AnswerCache(tmp_path, "m", "http://x/v1", "1")
    cache.put("proud", PROUD)
    (path,) = (tmp_path / "gpt").iterdir()
    path.write_bytes(damage)
    assert cache.get("proud") is None
    assert path.name in caplog.text
    cache.put("proud", PROUD)
    assert cache.get("proud") == PROUD


def test_entries_belong_to_model_endpoint_and_instructions(tmp_path):
    cache = AnswerCache(tmp_path, "m", "http://x/v1", "1")
    cache.put("proud", PROUD)
    for change in ({"model": "n"}, {"base_url": "http://y/v1"}, {"version": "2"}):
        assert dataclasses.replace(cache, **change).get("proud") is None
    assert cache.get("proud") == PROUD


def test_a_cache_that_cannot_be_written_costs_a_log_line(endpoint, settings_of, tmp_path, caplog):
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert GptExpander(settings_of(endpoint), blocked).expand("proud").descriptions == PROUD
    assert "not cached" in caplog.text


def test_where_the_cache_lies():
    assert cache_directory({"SPORT_CACHE_DIR": "/a", "XDG_CACHE_HOME": "/b"}) == Path("/a")
    assert cache_directory({"XDG_CACHE_HOME": "/b"}) == Path("/b/sport-viewer")
    assert cache_directory({}) == Path.home() / ".cache" / "sport-viewer"


# --- settings
def test_settings_come_from_the_environment():
    names = {"OPENAI_API_KEY": f" {KEY}\n", "SPORT_GPT_MODEL": "llama3", "SPORT_GPT_TIMEOUT": "40"}
    settings = GptSettings.from_environment(names)
    assert settings.api_key == Secret(KEY)
    assert (settings.host, settings.model, settings.timeout_s) == ("api.openai.com", "llama3", 40.0)
    assert settings.deadline_s >= 40.0
    local = GptSettings.from_environment({"OPENAI_BASE_URL": "http://localhost:11434/v1"})
    assert (local.host, bool(local.api_key)) == ("localhost:11434", False)
    assert not gpt_configured({"OPENAI_API_KEY": " "})


def test_what_a_person_chose_goes_before_the_environment():
    env = {"OPENAI_API_KEY": KEY, "SPORT_GPT_MODEL": "llama3"}
    assert GptSettings.chosen(environment=env).api_key == Secret(KEY)
    mine = GptSettings.chosen("http://localhost:1/v1", "m", 7.0, "own", env)
    assert (mine.host, mine.model, mine.timeout_s, mine.api_key) == ("localhost:1", "m", 7.0, Secret("own"))
    # the environment's key is for the environment's address
    assert not GptSettings.chosen("http://localhost:1/v1", environment=env).api_key
    assert GptSettings.chosen("https://api.openai.com/v1/", environment=env).api_key == Secret(KEY)
    with pytest.raises(UsageError, match="neither a key nor"):
        GptSettings.chosen(environment={})


def test_a_check_asks_once_and_says_who_answered(endpoint, settings_of):
    for _ in range(2):  # the second is no look-up
        said = check_endpoint(settings_of(endpoint), threading.Event())
        assert f"m at 127.0.0.1:{endpoint.server_port} answered in" in said
    assert len(endpoint.requests) == 2
    endpoint.script = [fail(401, f"Incorrect API key provided: {KEY}")]
    with pytest.raises(PromptError, match="refuses the key") as error:
        check_endpoint(settings_of(endpoint), threading.Event())
    assert KEY not in str(error.value)


@pytest.mark.parametrize(
    ("environment", "named"),
    [({}, "OPENAI_API_KEY"), ({"OPENAI_API_KEY": "ключ-секрет"}, "OPENAI_API_KEY"),
     ({"OPENAI_API_KEY": "sk-a b"}, "OPENAI_API_KEY"), ({"OPENAI_BASE_URL": "localhost:1"}, "OPENAI_BASE_URL"),
     ({"OPENAI_BASE_URL": "http://user:pw@x:port/"}, "OPENAI_BASE_URL"), ({"OPENAI_BASE_URL": "http://["}, "OPENAI_BASE_URL"),
     ({"OPENAI_API_KEY": KEY, "SPORT_GPT_MODEL": "a\nb"}, "SPORT_GPT_MODEL"),
     ({"OPENAI_API_KEY": KEY, "SPORT_GPT_TIMEOUT": "fast"}, "SPORT_GPT_TIMEOUT"),
     ({"OPENAI_API_KEY": KEY, "SPORT_GPT_TIMEOUT": "nan"}, "SPORT_GPT_TIMEOUT")],
)  # fmt: skip
def test_settings_that_cannot_be_used_are_named_without_the_secret(environment, named):
    with pytest.raises(UsageError, match=named) as error:
        GptSettings.from_environment(environment)
    for secret in (KEY, "секрет", "sk-a", "pw"):
        assert secret not in str(error.value)


def test_wrong_settings_leave_the_library(monkeypatch, tmp_path):
    monkeypatch.setenv("OPENAI_BASE_URL", "nonsense")
    gpt = GptExpander(cache=tmp_path)
    gpt.prepare()  # while the program starts: nothing to say yet
    expansion = FallbackExpander(gpt, Library()).expand("proud")
    assert expansion.source == "library"
    assert "OPENAI_BASE_URL" in expansion.note


def test_the_key_is_neither_shown_nor_written(settings_of, endpoint):
    settings = settings_of(endpoint)
    assert KEY not in repr(settings) + str(settings.api_key)
    for write in (pickle.dumps, copy.deepcopy, dataclasses.asdict, lambda s: json.dumps(vars(s))):
        with pytest.raises(TypeError):
            write(settings)


def test_without_the_package_the_remedy_is_told(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "openai", None)
    with pytest.raises(PromptError, match=r"openai.*not installed") as error:
        GptExpander(GptSettings(Secret(KEY)), tmp_path).expand("proud")
    assert "pip install 'sport-viewer[gpt]'" in error.value.remedy
