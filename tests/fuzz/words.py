"""Targets that are words and settings: prompts, parts, answers of language models, the command line, the library."""

import contextlib
import io
import json
import math
import random
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from runtime.assets import asset_path
from runtime.controls import Controls
from runtime.generate import generate_clip, load_parts, parse_prompts
from runtime.motion.control_scripts import EXAMPLE, parse_stick
from runtime.motion.controller import Controller
from runtime.motion.model import load_model
from runtime.prompts.blend import BlendedPrompt, parse_weights, read_words
from runtime.prompts.english.library import LibraryExpander
from runtime.prompts.gpt.client import ChatClient, retry_after
from runtime.prompts.gpt.expander import AnswerCache
from runtime.prompts.gpt.prompt import load_structured_prompt
from runtime.prompts.gpt.settings import GptSettings, Secret
from runtime.prompts.library_data import load_styles
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from sport import cli

from .mutate import damaged_json, damaged_text
from .networks import write_model
from .target import Target, put

_PROMPTS = (
    "an exhausted soldier, left arm hanging",
    "walk like a duck, but the right leg limps; head down",
    "proud and slow, both arms stretched out to the sides",
    "ein müder Roboter",
    "not drunk, no swinging arms, torso bent forward as if carrying a 20 kg sack",
)


def _parts() -> dict[str, str]:
    return load_styles(asset_path("prompts/styles.json"))["proud"].descriptions[1].to_mapping()


class _Vectors:
    """Stands in for the sentence network: any text has a vector, the same text the same one."""

    name, dimensions = "all-MiniLM-L6-v2", 384

    def encode(self, texts: Any) -> Any:
        rows = [np.random.default_rng(sum(text.encode()) % 9973).normal(size=384) for text in texts]
        return np.array([row / np.linalg.norm(row) for row in rows], np.float32)


@cache
def _library() -> LibraryExpander:
    return LibraryExpander(_Vectors())


def _text(data: bytes) -> str:
    """The input as the command line or a text field has it: any bytes, none of them zero."""
    return data.decode("utf-8", "surrogateescape").replace("\0", "")


def _read_prompt(_folder: Path, data: bytes) -> None:
    for part in _library().expand(_text(data)).descriptions.as_tuple():
        part.encode()


def _stick(_folder: Path, data: bytes) -> None:
    script = parse_stick(_text(data))
    for share in (0.0, 0.3, 0.999, 2.0):
        controls = script(share * script.seconds)
        assert math.hypot(*controls.move) <= 1.0 + 1e-9
        assert controls.facing is None or math.isfinite(sum(controls.facing))


def _sticks(rng: random.Random, data: bytes) -> bytes:
    """A script that follows the grammar but for one of its parts, or none."""
    segments = []
    for _ in range(rng.choice((1, 2, 5, 300))):
        text = rng.choice(("walk", "jog", "Crouch", "stand", "jump"))
        if text not in ("stand", "jump") or rng.random() < 0.02:
            text += rng.choice(("", f"@{rng.uniform(-720, 720):.3f}"))
            text += rng.choice(("", f"*{rng.random():.2f}"))
            text += rng.choice(("", f">{rng.randrange(-400, 400)}"))
        segments.append(f"{text} {rng.choice((0.001, 0.1, 2, 3600, 86400))}")
    script = "; ".join(segments).encode()
    return script if rng.random() < 0.5 else damaged_text(rng, rng.choice((script, data)))


def _weights(_folder: Path, data: bytes) -> None:
    assert all(0.0 <= weight <= 1.0 for weight in parse_weights(_text(data)))


def _script(_folder: Path, data: bytes) -> None:
    assert all(math.isfinite(event.seconds) for event in parse_prompts(_text(data)))


def _blend_seeds(_folder: Path) -> list[bytes]:
    return [json.dumps(_parts()).encode(), BlendedPrompt("a", "b", (0.5,) * 6).to_json().encode()]


# --- settings
def _settings_seeds(folder: Path) -> list[bytes]:
    from viewer.settings import Settings, save_settings

    save_settings(Settings(prompt_history=["a", "b"]), folder)
    return [(folder / "settings.json").read_bytes()]


def _read_settings(folder: Path, data: bytes) -> None:
    from viewer.settings import load_settings, save_settings

    put(folder, "settings.json", data)
    settings, complaints = load_settings(folder)
    assert len(complaints) <= 60
    "".join(complaints).encode()
    save_settings(settings, folder)


# --- language model
def _answer_seeds(_folder: Path) -> list[bytes]:
    content = json.dumps(_parts())
    return [json.dumps({"choices": [{"message": {"role": "assistant", "content": content}}]}).encode()]


@cache
def _instructions() -> Any:
    return load_structured_prompt()


def _read_answer(_folder: Path, data: bytes) -> None:
    client = ChatClient(GptSettings(Secret("key"), "http://127.0.0.1:9/v1"))
    _instructions().read(client._text(data))


def _cache_of(folder: Path) -> AnswerCache:
    return AnswerCache(folder, "m", "http://h", "1")


def _cache_seeds(folder: Path) -> list[bytes]:
    answers = _cache_of(folder)
    answers.put("p", load_styles(asset_path("prompts/styles.json"))["proud"].descriptions[1])
    return [answers._path("p").read_bytes()]


def _read_cache(folder: Path, data: bytes) -> None:
    answers = _cache_of(folder)
    answers._path("p").write_bytes(data)
    answers.get("p")


def _environment(_folder: Path, data: bytes) -> None:
    key, url, model, timeout, *headers = [*_text(data).split("\n"), "", "", "", ""]
    environment = {"OPENAI_API_KEY": key, "OPENAI_BASE_URL": url}
    environment |= {"SPORT_GPT_MODEL": model, "SPORT_GPT_TIMEOUT": timeout}
    wait = retry_after({"retry-after": headers[0], "retry-after-ms": timeout})
    assert wait is None or 0.0 <= wait < math.inf
    settings = GptSettings.from_environment(environment)
    assert math.isfinite(settings.timeout_s)
    assert settings.host


# --- command line
def _command_seeds(folder: Path) -> list[bytes]:
    model = write_model(folder / "model")
    (folder / "parts.json").write_text(json.dumps(_parts()), encoding="utf-8")
    start = f"generate --model {model} --seconds 0.1 --out {folder / 'out.bvh'}"
    ground = asset_path("terrains/bowl.png")
    return [
        command.encode()
        for command in (
            f"{start} --prompt 'a proud walk' --path circle --seed 3",
            f"{start} --prompts '0:walk;0.05:drunk' --transition 0.1 --terrain stairs --gait jog",
            f"{start} --parts {folder / 'parts.json'} --fps 30 --unit m --speed 0.5",
            f"{start} --prompt proud --blend drunk --blend-weights torso=1,head=0.5 --strength 1.5",
            f"{start} --terrain {ground} --text-encoder {model / 'text_encoder'} --expander library",
            "bench --frames x --json",
        )
    ]


def _damaged_command(rng: random.Random, data: bytes) -> bytes:
    """A word of a command line exchanged, lost, repeated or damaged; the words are separated by zero bytes."""
    words = shlex.split(data.decode())
    for _ in range(rng.choice((1, 1, 2))):
        at = rng.randrange(len(words))
        kind = rng.randrange(5)
        if kind == 0:
            del words[at]
        elif kind == 1:
            words.insert(at, rng.choice(words))
        elif kind == 2:
            words[at] = rng.choice(words)
        else:
            words[at] = _text(damaged_text(rng, words[at].encode()))[:100_000]
        words = words or ["generate"]
    return "\0".join(words).encode("utf-8", "surrogateescape")


def _run_command(folder: Path, data: bytes) -> None:

    words = data.decode("utf-8", "surrogateescape").split("\0")
    if not words[0].startswith(("gen", "ben")) or ("bench" in words and "x" not in words):
        words = ["generate", *words]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), contextlib.chdir(folder):
        try:
            code = cli.main(words)
        except SystemExit as exit_:  # of argparse
            code = exit_.code
    assert code in (0, 2, None), code
    said = err.getvalue()
    if code == 2:
        assert said.count("\n") == 1 + said.count("sport: “"), said[:500]


# --- the library
_NASTY: tuple[Any, ...] = (
    0, 1, -1, 0.5, 2.0, -0.0, math.nan, math.inf, -math.inf, 1e300, 10**30, 1e-320, None, "x", (0, 0), (0, math.nan),
    (math.inf, 0), (1, 2, 3), (1e5, -1e5), (0.6, 0.8), (), [], True, 99, "walk", np.float32(0.3), np.array([0.0, 1.0]),
)  # fmt: skip


@cache
def _model(folder: Path) -> Any:
    return load_model(write_model(folder / "model"))


def _library_seeds(folder: Path) -> list[bytes]:
    _model(folder)
    return [b"0"]


def _call(folder: Path, data: bytes) -> None:
    """One random call of the library with values that no caller should give; poses that come back must be finite."""
    rng = random.Random(data)

    def nasty(*good: Any) -> Any:
        return rng.choice(_NASTY) if rng.random() < 0.4 else rng.choice(good)

    kind = rng.randrange(3)
    if kind == 0:
        shape = rng.choice(((5, 5), (1, 1), (2, 2), (0, 0), (1, 7), (4,)))
        heights = np.full(shape, nasty_number(rng), np.float32)
        terrain = Terrain("t", heights, nasty_number(rng), (nasty_number(rng), 0.0))
        assert np.isfinite(terrain.height(0.3, nasty_number(rng) if rng.random() < 0.1 else 0.0))
    elif kind == 1:
        seed, numbers = rng.choice((0, 3, -1)), (nasty_number(rng), nasty_number(rng))
        controller = Controller(_model(folder), Terrain.flat(), seed, *numbers)
        controls = Controls(nasty((0.0, 1.0), (0.0, 0.0)), nasty(None, (1.0, 0.0)), nasty(1, 2, 3, 4))
        for _ in range(3):
            assert np.isfinite(controller.step(controls).positions).all()
        controller.set_style(np.full((6, 64), nasty_number(rng)), nasty_number(rng))
        assert np.isfinite(controller.step(controls).positions).all()
    else:
        take = generate_clip(
            "proud", "flat", rng.choice(("forward", "x")), rng.choice(("walk", "fly")),
            rng.choice((0.05, nasty_number(rng))) if rng.random() < 0.5 else 0.05, rng.choice((0, -2)),
            speed=nasty_number(rng), transition_seconds=nasty_number(rng), strength=nasty_number(rng),
            model=folder / "model",
        ) if rng.random() < 0.1 else None  # fmt: skip
        assert take is None or (isinstance(take, Clip) and np.isfinite(take.hips_positions).all())


def nasty_number(rng: random.Random) -> float:
    """A number, mostly a good one."""
    return float(rng.choice((0.5, 1.0, 0.1, 1.0, math.nan, math.inf, -1.0, 0.0, 1e-300, 1e30)))


def _any_seed(rng: random.Random, _data: bytes) -> bytes:
    return str(rng.getrandbits(60)).encode()


def _words(_folder: Path, data: bytes) -> None:
    read_words(_text(data))


TARGETS = (
    Target("prompt", lambda _: [p.encode() for p in _PROMPTS], damaged_text, _read_prompt, 0.5),
    Target("--prompts", lambda _: [b"0:walk calmly; 4:drunk ; 5.5 : a b"], damaged_text, _script),
    Target("--controls", lambda _: [EXAMPLE.encode()], _sticks, _stick),
    Target("--blend-weights", lambda _: [b"left_arm=1,torso=0.5", b"0.3"], damaged_text, _weights),
    Target("--parts", lambda _: [json.dumps(_parts()).encode()], damaged_json,
           lambda f, d: load_parts(put(f, "parts.json", d))),
    Target("words of a take", _blend_seeds, damaged_json, _words),
    Target("settings", _settings_seeds, damaged_json, _read_settings),
    Target("model's answer", _answer_seeds, damaged_json, _read_answer),
    Target("stored answer", _cache_seeds, damaged_json, _read_cache),
    Target("endpoint settings", lambda _: [b"sk-1\nhttp://localhost:8080/v1\nm\n10\n5\nWed, 21 Oct 2026 07:28:00 GMT"],
           damaged_text, _environment),
    Target("command line", _command_seeds, _damaged_command, _run_command, 0.05, seconds=10.0),
    Target("library calls", _library_seeds, _any_seed, _call, 0.5),
)  # fmt: skip
