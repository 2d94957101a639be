"""Prompts that are withdrawn, cancelled or replaced while a language model is asked, and who answers meanwhile."""

import threading
import time

import numpy as np
import pytest

from runtime.prompts.expander import Expansion, PromptCancelledError
from runtime.prompts.gpt.expander import FallbackExpander, open_expander
from runtime.prompts.gpt.settings import GptSettings
from runtime.prompts.service import PromptWorker
from tests.helpers.gpt_endpoint import PROUD, UNREACHED_DELAY_S, Encoder, Library, fail, late, say, wait_for


# --- what is asked
def test_a_set_event_ends_the_question_at_once(endpoint, expander_of):
    endpoint.script = [late(UNREACHED_DELAY_S)]
    stop = threading.Event()
    threading.Timer(0.1, stop.set).start()
    with pytest.raises(PromptCancelledError):
        expander_of(endpoint, timeout_s=UNREACHED_DELAY_S, deadline_s=UNREACHED_DELAY_S).expand("proud", stop)
    assert endpoint.waited_out == 0


def test_a_set_event_ends_a_wait_before_a_retry_and_spoils_nothing_later(endpoint, expander_of):
    endpoint.script = [fail(500), say(PROUD.to_json())]
    expander = expander_of(endpoint, backoff_s=5.0, longest_wait_s=10.0, deadline_s=20.0)
    stop = threading.Event()
    threading.Timer(0.15, stop.set).start()
    with pytest.raises(PromptCancelledError):  # the library's answer is no final one either
        list(FallbackExpander(expander, Library()).steps("proud", stop))
    assert expander.expand("proud").descriptions == PROUD


def test_newer_words_and_the_end_do_not_wait_for_a_slow_model(endpoint, expander_of):
    endpoint.script = [late(UNREACHED_DELAY_S)]
    gpt = expander_of(endpoint, timeout_s=UNREACHED_DELAY_S, deadline_s=UNREACHED_DELAY_S)
    worker = PromptWorker(FallbackExpander(gpt, Library()), Encoder())
    worker.submit("a slow prompt")
    while not endpoint.requests:
        quick = worker.poll()
        assert quick is None or (quick.source, quick.final) == ("library", False)
        time.sleep(0.002)
    worker.submit(PROUD)
    result = wait_for(worker)
    assert result.words == PROUD  # and not the withdrawn one's error
    worker.submit("another slow prompt")
    while len(endpoint.requests) < 2:
        time.sleep(0.002)
    worker.close(UNREACHED_DELAY_S)
    assert endpoint.waited_out == 0
    assert worker.poll() is None


def test_the_environment_opens_the_expander(endpoint, monkeypatch, tmp_path):
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    monkeypatch.setenv("OPENAI_BASE_URL", endpoint.url)
    monkeypatch.setenv("SPORT_CACHE_DIR", str(tmp_path))
    worker = PromptWorker(open_expander(Library(), GptSettings.from_environment()), Encoder())
    worker.submit("a proud king")
    result = wait_for(worker)
    worker.close()
    assert (result.source, result.words) == ("gpt", PROUD)
    assert list(tmp_path.rglob("*.json"))


def test_the_library_answers_until_the_language_model_does(endpoint, expander_of):
    endpoint.script = [late(UNREACHED_DELAY_S)]
    worker = PromptWorker(FallbackExpander(expander_of(endpoint), Library()), Encoder())
    worker.submit("proud")
    while (quick := worker.poll()) is None:
        time.sleep(0.002)
    assert (quick.source, quick.final, worker.busy) == ("library", False, True)
    endpoint.released.set()
    answer = wait_for(worker)
    worker.close()
    assert (answer.words, answer.source) == (PROUD, "gpt")
    assert np.all(answer.z == len(PROUD.head))
    assert (quick.prompt, answer.prompt) == ("proud", "proud")


def test_what_was_answered_before_is_there_at_once(endpoint, expander_of):
    expander = FallbackExpander(expander_of(endpoint), Library())
    expander.expand("proud")
    assert list(expander.steps("proud", threading.Event())) == [(Expansion(PROUD, "gpt"), True)]


def test_a_withdrawn_prompt_gets_no_answer(endpoint, expander_of):
    endpoint.script = [late(UNREACHED_DELAY_S)]
    worker = PromptWorker(FallbackExpander(expander_of(endpoint), Library()), Encoder())
    worker.submit("proud")
    while not endpoint.requests:
        time.sleep(0.002)
    worker.withdraw()
    end = time.monotonic() + 60.0
    while worker.busy and time.monotonic() < end:
        time.sleep(0.002)
    assert not worker.busy
    assert worker.poll() is None
    worker.close()
