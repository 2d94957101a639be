"""From a prompt to six descriptions and Z^t: parts, clauses, library, worker."""

from __future__ import annotations

import json
import threading
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.assets import asset_path
from runtime.errors import FileError, ModelError, PromptError, SportError
from runtime.prompts.clauses import parse_clauses
from runtime.prompts.content import PromptEncoder
from runtime.prompts.expander import Expansion
from runtime.prompts.library import LibraryExpander
from runtime.prompts.library_data import library_hash, load_embeddings, load_library, load_styles
from runtime.prompts.parts import PartDescriptions, mirror_text
from runtime.prompts.service import PromptResult, PromptWorker
from runtime.prompts.text_encoder import TextEncoder
from runtime.skeleton import PART_NAMES

PROMPTS = asset_path("prompts/library.json").parent
DESCRIPTIONS = PartDescriptions(*(f"the {part} moves left" for part in PART_NAMES))


@pytest.fixture(scope="module")
def expander() -> LibraryExpander:
    return LibraryExpander(TextEncoder())


# parts


def test_mapping_json_and_tuple_agree() -> None:
    assert tuple(DESCRIPTIONS.to_mapping()) == PART_NAMES
    assert PartDescriptions.from_json(DESCRIPTIONS.to_json()) == DESCRIPTIONS
    assert DESCRIPTIONS.as_tuple()[PART_NAMES.index("torso")] == DESCRIPTIONS.torso


@pytest.mark.parametrize(
    "bad",
    [
        {},
        {**DESCRIPTIONS.to_mapping(), "tail": "wagging"},
        {**DESCRIPTIONS.to_mapping(), "head": 7},
        {**DESCRIPTIONS.to_mapping(), "head": "  "},
        {**DESCRIPTIONS.to_mapping(), "head": "x" * 301},
        {**DESCRIPTIONS.to_mapping(), "head": "down\x07"},
        {**DESCRIPTIONS.to_mapping(), "head": "\ud800"},
    ],
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


# clauses


@pytest.mark.parametrize(
    ("prompt", "rest", "expected"),
    [
        (
            "an exhausted soldier, left arm hanging",
            "an exhausted soldier",
            {"left_arm": "left arm hanging limply"},
        ),
        ("an old pirate limping on his right leg", "an old pirate", {"right_leg": "right leg limping"}),
        ("a person limping with the left foot", "a person", {"left_leg": "left leg limping"}),
        ("limping badly on my right leg", "", {"right_leg": "right leg limping"}),
        ("a spy looking down", "a spy", {"head": "looking at the ground"}),
        ("hands on hips", "", {"left_arm": "left hand on the hip", "right_arm": "right hand on the hip"}),
        ("a cook with crossed arms", "a cook", {"left_arm": "folded across", "right_arm": "folded across"}),
        ("both arms raised overhead", "", {"left_arm": "straight up overhead", "right_arm": "overhead"}),
        (
            "walks without swinging his arms",
            "walks",
            {"left_arm": "not swinging", "right_arm": "not swinging"},
        ),
        ("raising the left hand", "", {"left_arm": "left arm raised"}),
        ("someone looking left and right", "someone", {"head": "from side to side"}),
        ("Left arm spinning like a propeller", "", {"left_arm": "left arm spinning like a propeller"}),
        (
            "hunched, on tiptoes with bent knees",
            "",
            {"torso": "rounded", "left_leg": "knee bent", "right_leg": "tiptoe"},
        ),
        (
            "left and right hand behind the back",
            "",
            {"left_arm": "behind the back", "right_arm": "behind the back"},
        ),
        # words of parts that say nothing about a part
        ("head teacher", "head teacher", {}),
        ("an arms dealer", "an arms dealer", {}),
        ("a man with a cane", "a man with a cane", {}),
        ("feeling down", "feeling down", {}),
    ],
)
def test_clauses(prompt: str, rest: str, expected: dict[str, str]) -> None:
    parsed = parse_clauses(prompt)
    assert parsed.rest == rest
    assert set(parsed.parts) == set(expected)
    for part, words in expected.items():
        assert words in parsed.parts[part]


@given(st.text(max_size=300))
@settings(max_examples=150, deadline=None)
def test_any_text_parses_to_usable_descriptions(text: str) -> None:
    for part, description in parse_clauses(text).parts.items():
        assert part in PART_NAMES
        assert 0 < len(description) <= 300


def test_the_longest_prompt_parses_quickly() -> None:
    started = time.perf_counter()
    for word in ("left ", "looking ", "arms and ", "the his her ", "raised the left "):
        parse_clauses((word * 1000)[:1000])
    assert time.perf_counter() - started < 2.0


# the shipped library


def test_shipped_words_are_well_formed_and_cover_every_style() -> None:
    styles = load_styles(PROMPTS / "styles.json")
    entries = load_library(PROMPTS / "library.json", styles)
    assert {entry.style for entry in entries} - {""} == set(styles)
    assert len(entries) >= 120
    prompts = [entry.prompt for entry in entries]
    assert len(prompts) == len(set(prompts))
    for key, style in styles.items():
        assert len(style.descriptions) >= 5, key
        for text in (t for d in style.descriptions for t in d.as_tuple()):
            assert "{" not in text
            assert "@" not in text


def test_limbs_are_described_on_their_own_side() -> None:
    styles = load_styles(PROMPTS / "styles.json")
    every = [d for style in styles.values() for d in style.descriptions]
    every += [entry.descriptions for entry in load_library(PROMPTS / "library.json", styles)]
    for description in every:
        for part in ("left_arm", "right_arm", "left_leg", "right_leg"):
            own, other = ("left", "right") if part.startswith("left") else ("right", "left")
            words = getattr(description, part).split()
            assert own in words, getattr(description, part)
            assert other not in words[:2], getattr(description, part)


def test_stored_embeddings_fit_the_shipped_words() -> None:
    """Fails when library.json or styles.json changed without `python -m training.text.build_library`."""
    encoder = TextEncoder()
    library, styles = PROMPTS / "library.json", PROMPTS / "styles.json"
    entries = load_library(library, load_styles(styles))
    stored = load_embeddings(PROMPTS / "library.npz", library_hash(library, styles), encoder, len(entries))
    assert stored is not None
    fresh = encoder.encode(entries[5].descriptions.as_tuple())
    np.testing.assert_allclose(stored.parts[5], fresh, atol=2e-3)


# expansion


def test_a_clause_overrides_only_its_part(expander: LibraryExpander) -> None:
    plain = expander.expand("an exhausted soldier")
    hanging = expander.expand("an exhausted soldier, left arm hanging")
    assert hanging.explicit_parts == ("left_arm",)
    assert "hanging limply" in hanging.descriptions.left_arm
    assert hanging.descriptions.as_tuple()[1:] == plain.descriptions.as_tuple()[1:]
    assert plain.nearest[0] == ("an exhausted soldier", pytest.approx(1.0, abs=0.01))


@pytest.mark.parametrize(
    ("prompt", "nearest"),
    [
        ("a drunken man", "a drunk person stumbling home"),
        ("furious", "an angry person stomping around"),
        ("T-rex", "dinosaur"),
        ("an astronaut", "astronaut on the moon"),
        ("a toddler", "toddler"),
    ],
)
def test_new_words_find_their_entry(expander: LibraryExpander, prompt: str, nearest: str) -> None:
    expansion = expander.expand(prompt)
    assert expansion.source == "library"
    assert nearest in [found for found, _ in expansion.nearest[:2]]
    similarities = [s for _, s in expansion.nearest]
    assert similarities == sorted(similarities, reverse=True)


def test_a_mood_and_a_character_are_mixed(expander: LibraryExpander) -> None:
    robot, sad = expander.expand("robot").descriptions, expander.expand("depressed person").descriptions
    mixed = expander.expand("a depressed robot")
    assert mixed.descriptions.left_leg == robot.left_leg
    assert (mixed.descriptions.torso, mixed.descriptions.head) == (sad.torso, sad.head)
    assert "robot" in mixed.note


@pytest.mark.parametrize("prompt", ["walk calmly", "a calm walk", "walk slowly", "a peaceful person"])
def test_calm_words_bring_no_temper(expander: LibraryExpander, prompt: str) -> None:
    expansion = expander.expand(prompt)
    assert expansion.note == ""
    assert "relaxed" in expansion.descriptions.torso


@pytest.mark.parametrize(
    ("prompt", "leg"),
    [("an angry man", "stomping"), ("a drunk man", "stumbling"), ("walk happily", "bounce")],
)
def test_a_mood_of_nobody_in_particular_moves_the_whole_body(
    expander: LibraryExpander, prompt: str, leg: str
) -> None:
    assert leg in expander.expand(prompt).descriptions.left_leg


@pytest.mark.parametrize(
    "prompt", ["asdf qwer zxcv", "invoice number 4711", "疲れた兵士", "🙂", "un soldat épuisé"]
)
def test_what_says_nothing_is_neutral_and_says_so(expander: LibraryExpander, prompt: str) -> None:
    expansion = expander.expand(prompt)
    assert expansion.descriptions == expander.expand("a person walking normally").descriptions
    assert "neutral" in expansion.note


@pytest.mark.parametrize(("side", "other"), [("left", "right"), ("right", "left")])
@pytest.mark.parametrize(
    "prompt", ["someone waves the {} hand", "limping on the {} leg", "{} hand up", "hop on the {} leg"]
)
def test_sides_are_not_mistaken(expander: LibraryExpander, prompt: str, side: str, other: str) -> None:
    there = expander.expand(prompt.format(side)).descriptions
    back = expander.expand(prompt.format(other)).descriptions
    part = "arm" if "hand" in prompt else "leg"
    assert getattr(there, f"{side}_{part}") == mirror_text(getattr(back, f"{other}_{part}"))
    assert getattr(there, f"{side}_{part}") != mirror_text(getattr(there, f"{other}_{part}"))


def test_only_clauses_are_explicit_on_a_neutral_body(expander: LibraryExpander) -> None:
    expansion = expander.expand("a person with hands on hips")
    neutral = expander.expand("a person walking normally").descriptions
    assert expansion.source == "explicit"
    assert expansion.descriptions.torso == neutral.torso
    assert "hip" in expansion.descriptions.left_arm


@pytest.mark.parametrize("prompt", ["", "  \n ", "x" * 1001, "x" * 10_000, "bell\x07", "\ud800", None])
def test_unusable_prompts_are_refused_with_a_remedy(expander: LibraryExpander, prompt: str) -> None:
    with pytest.raises(PromptError) as raised:
        expander.expand(prompt)
    assert "prompt" in str(raised.value)
    assert raised.value.remedy


@given(st.text(alphabet=st.characters(exclude_categories=("Cc", "Cs")), min_size=1, max_size=80))
@settings(max_examples=40, deadline=None)
def test_any_prompt_expands(text: str) -> None:
    if not text.split():
        return
    expansion = _shared_expander().expand(text)
    assert len(expansion.descriptions.as_tuple()) == 6


_SHARED = TextEncoder()


@cache
def _shared_expander() -> LibraryExpander:
    return LibraryExpander(_SHARED)


def _small_library(directory: Path, entries: list[object]) -> Path:
    (directory / "styles.json").write_bytes((PROMPTS / "styles.json").read_bytes())
    path = directory / "library.json"
    path.write_text(json.dumps({"entries": entries}))
    return path


def test_a_library_without_embeddings_computes_them(tmp_path: Path) -> None:
    entry = {
        "prompt": "crab",
        "arms": "{s} hand like a claw",
        "legs": "@chicken",
        "torso": "low",
        "head": "up",
    }
    expansion = LibraryExpander(_SHARED, _small_library(tmp_path, [entry])).expand("crab")
    assert expansion.descriptions.right_arm == "right hand like a claw"
    assert expansion.descriptions.left_leg.startswith("left")


def test_outdated_embeddings_are_not_used(tmp_path: Path) -> None:
    path = _small_library(tmp_path, [{"style": "chicken"}])
    (tmp_path / "library.npz").write_bytes((PROMPTS / "library.npz").read_bytes())
    assert (
        LibraryExpander(_SHARED, path).expand("a clucking hen").nearest[0][0]
        == "someone strutting like a chicken"
    )


@pytest.mark.parametrize(
    "entry", [{"prompt": "crab"}, {"style": "nobody"}, 7, {"prompt": "a", "arms": "@nobody", "legs": "x"}]
)
def test_a_malformed_entry_is_named(tmp_path: Path, entry: object) -> None:
    path = _small_library(tmp_path, [{"style": "chicken"}, entry])
    with pytest.raises(FileError, match="entry 1"):
        LibraryExpander(_SHARED, path).expand("crab")


def test_damaged_files_are_named(tmp_path: Path) -> None:
    path = _small_library(tmp_path, [{"style": "chicken"}])
    (tmp_path / "library.npz").write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(FileError, match=r"library\.npz"):
        LibraryExpander(_SHARED, path).expand("crab")
    path.write_text("{")
    with pytest.raises(FileError, match=r"library\.json"):
        LibraryExpander(_SHARED, path).expand("crab")


# content network and worker


def _network(path: Path, size: int = 384, gain: float = 1.0) -> Path:
    """A stand-in for the trained network: z is the first 64 numbers of each embedding, times `gain`."""
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    constants = {
        "start": np.array([0]),
        "stop": np.array([64]),
        "axis": np.array([2]),
        "gain": np.float32(gain),
    }
    graph = helper.make_graph(
        [
            helper.make_node("Slice", ["embeddings", "start", "stop", "axis"], ["cut"]),
            helper.make_node("Mul", ["cut", "gain"], ["z"]),
        ],
        "content",
        [helper.make_tensor_value_info("embeddings", TensorProto.FLOAT, ["n", 6, size])],
        [helper.make_tensor_value_info("z", TensorProto.FLOAT, ["n", 6, 64])],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path)
    return path


def test_content_code_of_descriptions(tmp_path: Path) -> None:
    z = PromptEncoder(_SHARED, _network(tmp_path / "content.onnx")).encode(DESCRIPTIONS)
    np.testing.assert_allclose(z, _SHARED.encode(DESCRIPTIONS.as_tuple())[:, :64], atol=1e-6)


def test_a_network_of_another_text_encoder_is_refused(tmp_path: Path) -> None:
    encoder = PromptEncoder(_SHARED, _network(tmp_path / "clip.onnx", size=512))
    with pytest.raises(ModelError, match=r"clip\.onnx.*all-MiniLM"):
        encoder.encode(DESCRIPTIONS)


def test_numbers_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    encoder = PromptEncoder(_SHARED, _network(tmp_path / "nan.onnx", gain=float("nan")))
    with pytest.raises(ModelError, match=r"nan\.onnx"):
        encoder.encode(DESCRIPTIONS)


def _wait(worker: PromptWorker, seconds: float = 20.0) -> PromptResult:
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
        good = _wait(worker)
        assert good.error is None
        assert good.z is not None
        assert good.z.shape == (6, 64)
        assert worker.poll() is None
        worker.submit("")
        bad = _wait(worker)
        assert isinstance(bad.error, PromptError)
        assert bad.z is None
        worker.submit(DESCRIPTIONS)
        typed = _wait(worker)
        assert typed.expansion == Expansion(DESCRIPTIONS, "explicit")
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
        started = time.perf_counter()
        for i in range(100):
            worker.submit(f"prompt {i}")
        assert time.perf_counter() - started < 0.5
        assert worker.busy
        slow.go.set()
        while _wait(worker).request != "prompt 99":
            pass
        assert slow.asked == ["first", "prompt 99"]
        worker.submit("defect")
        failed = _wait(worker)
        assert isinstance(failed.error, SportError)
        worker.submit("after")
        assert _wait(worker).error is None  # the thread outlived the defect
    finally:
        slow.go.set()
        worker.close()
    worker.submit("late")
    assert worker.poll() is None
