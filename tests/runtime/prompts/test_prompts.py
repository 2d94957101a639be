"""From a prompt to Z^t: six descriptions, the content network, the worker. test_prompts_*.py have the library."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.errors import ModelError, PromptError, SportError
from runtime.prompts.answer import Answer
from runtime.prompts.content import PromptEncoder
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.expander import Expansion
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.prompts.service import PromptWorker
from runtime.skeleton import PART_NAMES
from tests.helpers.graphs import save_graph
from tests.helpers.shipped import shipped_encoder, shipped_library

_SHARED = shipped_encoder()
DESCRIPTIONS = PartDescriptions(*(f"the {part} moves left" for part in PART_NAMES))


@pytest.fixture(scope="module")
def expander() -> LibraryExpander:
    return shipped_library()


# --- parts
def test_mapping_json_and_tuple_agree() -> None:
    assert tuple(DESCRIPTIONS.to_mapping()) == PART_NAMES
    assert PartDescriptions.from_json(DESCRIPTIONS.to_json()) == DESCRIPTIONS
    assert DESCRIPTIONS.as_tuple()[PART_NAMES.index("torso")] == DESCRIPTIONS.torso


PARTS = DESCRIPTIONS.to_mapping()
HEADS = (7, "  ", "x" * 301, "down\x07", "\ud800")


@pytest.mark.parametrize(
    "bad", [{}, PARTS | {"tail": "wagging"}, *(PARTS | {"head": head} for head in HEADS)]
)
def test_unusable_descriptions_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(PromptError):
        PartDescriptions.from_mapping(bad)


@pytest.mark.parametrize("text", ["[1]", "{", "null"])
def test_json_that_is_no_object_is_refused(text: str) -> None:
    with pytest.raises(PromptError):
        PartDescriptions.from_json(text)


def test_replace_changes_one_part_and_names_an_unknown_one() -> None:
    changed = DESCRIPTIONS.replace("head", "head down")
    assert changed.head == "head down"
    assert changed.as_tuple()[:5] == DESCRIPTIONS.as_tuple()[:5]
    with pytest.raises(PromptError, match="tail"):
        DESCRIPTIONS.replace("tail", "wagging")


def test_mirroring_exchanges_limbs_and_words() -> None:
    parts = PartDescriptions(
        "left arm up", "right arm down", "left leg back", "Right leg", "leaning LEFT", "copyright"
    )
    assert parts.mirrored() == PartDescriptions(
        "left arm down", "right arm up", "Left leg", "right leg back", "leaning RIGHT", "copyright"
    )


@given(st.lists(st.sampled_from(["left", "Right", "RIGHT", "arm", "leftward", "cleft", "-"]), min_size=1))
def test_mirroring_twice_is_nothing(words: list[str]) -> None:
    text = " ".join(words)
    assert mirror_text(mirror_text(text)) == text


# --- content network and worker
def _network(path: Path, size: int = 384, gain: float = 1.0) -> Path:
    """A stand-in for the trained network: z is the first 64 numbers of each embedding, times `gain`."""
    nodes = [("Slice", "embeddings start stop axis", "cut", {}), ("Mul", "cut gain", "z", {})]
    constants = {
        "start": np.array([0]),
        "stop": np.array([64]),
        "axis": np.array([2]),
        "gain": np.float32(gain),
    }
    return save_graph(path, nodes, {"embeddings": ["n", 6, size]}, {"z": ["n", 6, 64]}, constants)


def test_content_code_of_descriptions(tmp_path: Path) -> None:
    z = PromptEncoder(_SHARED, _network(tmp_path / "content.onnx")).encode(DESCRIPTIONS)
    np.testing.assert_allclose(z, _SHARED.encode(DESCRIPTIONS.as_tuple())[:, :64], atol=1e-6)


@pytest.mark.parametrize(
    ("network", "said"),
    [({"size": 512}, r"net\.onnx.*all-MiniLM"), ({"gain": float("nan")}, r"net\.onnx")],
    ids=["of another text encoder", "numbers that are not finite"],
)
def test_a_network_that_cannot_be_used_is_refused(tmp_path: Path, network: dict, said: str) -> None:
    encoder = PromptEncoder(_SHARED, _network(tmp_path / "net.onnx", **network))
    with pytest.raises(ModelError, match=said):
        encoder.encode(DESCRIPTIONS)


def _wait(worker: PromptWorker, seconds: float = 60.0) -> Answer:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        result = worker.poll()
        if result is not None:
            return result
        time.sleep(0.005)
    raise AssertionError("no result")


def test_worker_answers_prompts_descriptions_and_errors(tmp_path: Path, expander: LibraryExpander) -> None:
    worker = PromptWorker(expander, PromptEncoder(_SHARED, _network(tmp_path / "content.onnx")))
    try:
        assert worker.poll() is None
        worker.submit("a proud king")
        assert _wait(worker).z.shape == (6, 64)
        assert worker.poll() is None
        worker.submit("")
        with pytest.raises(PromptError):
            _wait(worker)
        worker.submit(DESCRIPTIONS)
        typed = _wait(worker)
        assert (typed.prompt, typed.words, typed.source) == ("", DESCRIPTIONS, "explicit")
    finally:
        worker.close()


class _SlowExpander:
    """Waits for `go` at its first prompt, and fails on the prompt "defect"."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.asked: list[str] = []

    def expand(self, prompt: str) -> Expansion:
        self.asked.append(prompt)
        assert self.go.wait(20.0)
        if prompt == "defect":
            raise RuntimeError("a defect")
        return Expansion(DESCRIPTIONS, "library")


def test_worker_keeps_only_the_newest_request_and_never_blocks(tmp_path: Path) -> None:
    slow = _SlowExpander()
    worker = PromptWorker(slow, PromptEncoder(_SHARED, _network(tmp_path / "content.onnx")))
    try:
        worker.submit("first")
        while not slow.asked:
            time.sleep(0.001)
        for i in range(100):
            worker.submit(f"prompt {i}")
        assert worker.busy
        slow.go.set()
        assert _wait(worker).prompt == "prompt 99"
        assert slow.asked == ["first", "prompt 99"]
        worker.submit("defect")
        with pytest.raises(SportError):
            _wait(worker)
        worker.submit("after")
        assert _wait(worker).prompt == "after"  # the thread outlived the defect
    finally:
        slow.go.set()
        worker.close()
    worker.submit("late")
    assert worker.poll() is None
