"""Generates a clip from a prompt, a path and a terrain without a window, as `sport generate` does."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.errors import FileError, PromptError, SportError, UsageError
from runtime.motion.control_scripts import (
    GAITS,
    ControlScript,
    PlanarPose,
    StickScript,
    control_script,
    parse_stick,
)
from runtime.motion.features import FPS
from runtime.pose import Pose
from runtime.prompts.blend import BlendedPrompt, Words, read_words, write_words
from runtime.prompts.expander import DEFAULT_PROMPT, check_prompt
from runtime.prompts.parts import PartDescriptions
from runtime.prompts.prompter import Prompter
from runtime.safe_read import read_bounded
from runtime.skeleton import PART_NAMES
from runtime.takes.clip import Clip, stacked
from runtime.takes.metadata import PromptEvent, gait_of, gait_seconds, origin_of
from runtime.takes.pinned import pinned
from runtime.takes.pins import Pin, parse_pins
from runtime.terrain.height_map import Terrain

if TYPE_CHECKING:
    from runtime.controls import Controls, Gait
    from runtime.motion.controller import Controller
    from runtime.motion.model import MotionModel
    from runtime.motion.style import StyleMix


MAX_SECONDS = 3600.0
MAX_PARTS_BYTES = 100_000
MAX_PROMPTS = 1000
MAX_SCRIPT_CHARACTERS = 200_000


def load_parts(path: Path) -> PartDescriptions:
    """Read six descriptions from a JSON file with one string per body part; FileError or PromptError says what is wrong."""
    form = f"Write a JSON object with {', '.join(PART_NAMES)}."
    try:
        text = read_bounded(path, MAX_PARTS_BYTES, form, missing="Choose a file that can be read.").decode(
            "utf-8-sig"
        )
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not text in UTF-8.", form) from error
    try:
        return PartDescriptions.from_json(text)
    except PromptError as error:
        raise PromptError(f"{path}: {error.problem}", error.remedy) from error


def parse_prompts(script: str) -> tuple[PromptEvent, ...]:
    """Parse prompts with start times, e.g. "0:walk calmly; 4:a zombie"; PromptError shows the expected form."""
    if len(script) > MAX_SCRIPT_CHARACTERS:
        raise PromptError(
            f"Prompts with times: {len(script)} characters; expected at most {MAX_SCRIPT_CHARACTERS}.",
            "Use fewer.",
        )
    events = []
    entries = script.split(";")
    if len(entries) > MAX_PROMPTS:
        raise PromptError(
            f"Prompts with times: {len(entries)} prompts; expected at most {MAX_PROMPTS}.", "Use fewer."
        )
    for entry in entries:
        seconds, colon, prompt = (part.strip() for part in entry.partition(":"))
        if not colon or not prompt or not re.fullmatch(r"[0-9]{1,9}(\.[0-9]{1,9})?", seconds):
            raise PromptError(
                f"Prompts with times: '{entry.strip()[:60]}' is not SECONDS:PROMPT.",
                'Write "0:walk calmly; 4:a zombie".',
            )
        if float(seconds) > MAX_SECONDS:
            raise PromptError(
                f"Prompts with times: {seconds} s; expected at most {MAX_SECONDS:.0f}.",
                "Choose an earlier time.",
            )
        events.append(PromptEvent(float(seconds), prompt))
    return tuple(sorted(events, key=lambda event: event.seconds))


def _silent(_: str) -> None:
    """A report callback that does nothing."""


@dataclass(frozen=True)
class ClipOptions:
    """Further options of `generate_clip`, passed by name."""

    controls: str | StickScript | None = None  # the stick, also as text, instead of path, gait and speed
    speed: float = 1.0  # fraction of the full stick
    transition_seconds: float = 1.0  # from one prompt to the next
    model: Path | MotionModel | None = None  # a model folder (default: the shipped one), or a loaded model
    name: str = "clip"
    expander: str = "library"  # this, `report` and `text_encoder` are arguments of `Prompter`
    report: Callable[[str], None] = _silent
    text_encoder: Path | None = None
    prompter: Prompter | None = None  # an existing one of that model, instead of them
    strength: float = 1.0  # of the style, see `Controller`
    size: float = 1.0  # of `Character`: a smaller body makes smaller steps on the same ground
    pins: str | Sequence[Pin] = ()  # that modify the poses, also as text of `runtime.takes.pins`
    exact_legs: bool = True  # add body edits for what the network does not show
    # response of starts, stops and turns to the stick: 0 as captured, 1 as in a game
    response: float = 0.0


def generate_clip(
    prompt: str | PartDescriptions | BlendedPrompt | Sequence[PromptEvent] = DEFAULT_PROMPT,
    terrain: str | Path | Terrain = "flat",
    path: str = "forward",
    gait: str = "walk",
    seconds: float | None = None,
    seed: int = 0,
    **options: Any,
) -> Clip:
    """Generate a clip of `seconds` (default 10, or the length of `controls`) at 60 fps; equal arguments give equal bytes.

    It starts at rest at the origin, in its first style and in the gait. `prompt` is one prompt, six descriptions, a
    blend of two, or several prompts with times; `terrain` a name, file or terrain; `path` and `gait` are those of
    `runtime.motion.control_scripts`; `options` the fields of `ClipOptions`. Raises SportError.
    """
    o = ClipOptions(**options)
    script, first_gait, seconds = _script(o, path, gait, seconds, seed)
    _check(o, seconds, seed)
    held = parse_pins(o.pins) if isinstance(o.pins, str) else tuple(o.pins)
    events, requested = _events(prompt)
    controller = _controller(o, terrain, seed)
    meant: dict[str, PartDescriptions] = {}
    if o.prompter is None:
        prompter = Prompter(controller.model, o.expander, o.report, o.text_encoder, meant.__setitem__)
    else:
        prompter = o.prompter.listening(o.report, meant.__setitem__)
    styles = [
        (event.seconds, prompter.style(words, o.exact_legs))
        for event, words in zip(events, requested, strict=True)
    ]
    poses, gaits = _walk(controller, script, styles, first_gait, round(seconds * FPS), o.transition_seconds)
    events = _described(events, requested, meant, o.transition_seconds)
    spec = str(terrain) if not isinstance(terrain, Terrain) else terrain.name
    origin, durations = origin_of(controller, spec), gait_seconds(gaits, FPS)
    clip = clip_of(poses, o.name, events, spec)
    clip = replace(clip, origin=origin, gaits=gaits, gait_seconds=durations, size=o.size)
    return pinned(clip, held) if held else clip


def _script(
    options: ClipOptions, path: str, gait: str, seconds: float | None, seed: int
) -> tuple[ControlScript, Gait, float]:
    """Return the stick of `generate_clip`, the initial gait, and the clip's seconds."""
    controls = options.controls
    if controls is None:
        script = control_script(path, gait, options.speed, seed)
        return script, GAITS[gait], 10.0 if seconds is None else seconds
    stick = parse_stick(controls) if isinstance(controls, str) else controls
    return stick, stick(0.0).gait, stick.seconds if seconds is None else seconds


def check_seconds(seconds: float) -> None:
    """Raise UsageError unless `seconds` is a valid clip length."""
    frame = 1.0 / FPS
    if not frame <= seconds <= MAX_SECONDS:
        expected = f"{frame:.3f} (one frame) to {MAX_SECONDS:.0f}"
        raise UsageError(f" {seconds:g}: expected {expected}.", "Try 10.", "seconds")


def _check(options: ClipOptions, seconds: float, seed: int) -> None:
    """Raise UsageError that names the first argument of `generate_clip` out of range."""
    from runtime.motion.model import MAX_STRENGTH, MIN_STRENGTH
    from runtime.motion.trajectory import MAX_RESPONSE, MIN_RESPONSE

    check_seconds(seconds)
    for name, value, low, high, expected, remedy in (
        ("transition_seconds", options.transition_seconds, 0.0, 60.0, "0 to 60 seconds", "Try 1."),
        ("strength", options.strength, MIN_STRENGTH, MAX_STRENGTH, "0 to 2", "1 is as the model shows it."),
        ("response", options.response, MIN_RESPONSE, MAX_RESPONSE, "0 (as in capture) to 1 (as in a game)", "Try 0."),
        ("seed", seed, 0, inf, "0 or more", "Choose another seed."),
    ):  # fmt: skip
        if not low <= value <= high:
            raise UsageError(f" {value:g}: expected {expected}.", remedy, name)


def _controller(options: ClipOptions, terrain: str | Path | Terrain, seed: int) -> Controller:
    """Return a character at the origin, on the ground at its own scale."""
    from runtime.motion.controller import Controller
    from runtime.motion.model import load_model
    from runtime.terrain.library import load_terrain

    ground = terrain if isinstance(terrain, Terrain) else load_terrain(terrain)
    model = options.model
    loaded = load_model(model) if model is None or isinstance(model, Path) else model
    seen = ground.seen_by(options.size)
    return Controller(loaded, seen, seed, strength=options.strength, response=options.response)


def _walk(
    controller: Controller,
    script: ControlScript,
    styles: Sequence[tuple[float, Array | StyleMix]],
    gait: Gait,
    frames: int,
    transition_seconds: float,
) -> tuple[list[Pose], NDArray[np.int8]]:
    """Return poses from rest in the first style on, and the requested gait of each."""
    controller.set_style(styles[0][1], 0.0)
    controller.settle(gait)
    gaits: list[int] = []

    def watched(time: float, place: PlanarPose) -> Controls:
        controls = script(time, place)
        gaits.append(gait_of(controls))
        return controls

    poses = simulate(controller, watched, styles, frames, transition_seconds)
    return poses, np.array(gaits, np.int8)


def _events(
    prompt: str | PartDescriptions | BlendedPrompt | Sequence[PromptEvent],
) -> tuple[tuple[PromptEvent, ...], list[Words | BlendedPrompt]]:
    """Return the clip's prompt events, and for each what to expand, encode or blend."""
    if isinstance(prompt, str):
        return (PromptEvent(0.0, prompt),), [check_prompt(prompt)]
    if isinstance(prompt, PartDescriptions | BlendedPrompt):
        return (PromptEvent(0.0, write_words(prompt)),), [prompt]
    events = tuple(prompt)
    if events and events[0].seconds > 0.0:  # the character also walks before the first prompt
        events = (PromptEvent(0.0, DEFAULT_PROMPT), *events)
    requested = [read_words(event.prompt) for event in events]
    return events, [check_prompt(words) if isinstance(words, str) else words for words in requested]


def _described(
    events: tuple[PromptEvent, ...],
    requested: Sequence[Words | BlendedPrompt],
    meant: dict[str, PartDescriptions],
    transition_seconds: float,
) -> tuple[PromptEvent, ...]:
    """Return the events with their transitions, and with the descriptions used."""
    return tuple(
        replace(
            event,
            transition_seconds=transition_seconds if event.seconds > 0.0 else 0.0,
            words=_spelled_out(words, meant),
        )
        for event, words in zip(events, requested, strict=True)
    )


def _spelled_out(words: Words | BlendedPrompt, meant: dict[str, PartDescriptions]) -> str:
    """Return the words of `PromptEvent.words`; `meant` has the descriptions reported by the prompter."""

    def parts(side: Words) -> PartDescriptions | None:
        return meant.get(side) if isinstance(side, str) else side

    if isinstance(words, BlendedPrompt):
        a, b = parts(words.a), parts(words.b)
        return "" if a is None or b is None else BlendedPrompt(a, b, words.weights).to_json()
    known = parts(words)
    return "" if known is None else known.to_json()


def simulate(
    controller: Controller,
    script: ControlScript,
    styles: Sequence[tuple[float, Array | StyleMix]],
    frames: int,
    transition_seconds: float = 1.0,
) -> list[Pose]:
    """Simulate `frames` frames under a script; `styles` are (seconds, Z^t), those at 0 set without a transition.

    Raises SportError if the network fails, since a clip with a gap must not be written.
    """
    poses: list[Pose] = []
    waiting = list(styles)
    pose = controller.pose
    for frame in range(frames):
        time = frame / FPS
        while waiting and waiting[0][0] <= time + 1e-9:
            at, z = waiting.pop(0)
            controller.set_style(z, transition_seconds if at > 0.0 else 0.0)
        root = pose.root_position
        pose = controller.step(script(time, PlanarPose(float(root[0]), float(root[2]), pose.root_yaw)))
        if controller.message or not np.all(np.isfinite(pose.positions)):
            raise SportError(
                f"frame {frame}: {controller.message or 'the pose is not finite.'}",
                "Try another seed or model.",
            )
        poses.append(pose)
    return poses


def clip_of(poses: Sequence[Pose], name: str, prompts: Sequence[PromptEvent], terrain: str) -> Clip:
    """Return a clip of simulated poses."""
    return Clip(name, float(FPS), *stacked(poses), prompts=tuple(prompts), terrain=terrain)
