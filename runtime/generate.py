"""A clip from a prompt, a path and a terrain, without a window: what `sport generate` does."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from runtime.clip import Clip, PromptEvent
from runtime.errors import PromptError, SportError, UsageError
from runtime.paths import ControlScript, Place, control_script
from runtime.pose import Pose
from runtime.terrain import Terrain

if TYPE_CHECKING:
    from runtime.controller import Controller
    from runtime.model import MotionModel

Array = NDArray[np.floating]
PromptToStyle = Callable[[str], Array]  # a prompt to Z^t (6, 64)

FPS = 60
MAX_SECONDS = 3600.0
DEFAULT_PROMPT = "a person walks normally"


def open_prompter(model: MotionModel) -> PromptToStyle:
    """The offline way from a prompt to Z^t `(6, 64)`: library expansion, sentence embedding, body-part network."""
    from runtime.prompts.content import PromptEncoder
    from runtime.prompts.library import LibraryExpander
    from runtime.prompts.text_encoder import TextEncoder

    text_encoder = TextEncoder()
    expander, encoder = LibraryExpander(text_encoder), PromptEncoder(text_encoder, model.prompt_path)
    return lambda prompt: encoder.encode(expander.expand(prompt).descriptions)


def parse_prompts(script: str) -> tuple[PromptEvent, ...]:
    """Prompts with their times: "0:walk calmly; 4:drunk" are two; PromptError shows the form."""
    events = []
    for entry in script.split(";"):
        match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*:\s*(\S.*?)\s*", entry)
        if not match:
            raise PromptError(
                f"--prompts: '{entry.strip()[:60]}' is not SECONDS:PROMPT.", 'Write "0:walk calmly; 4:drunk".'
            )
        events.append(PromptEvent(float(match[1]), match[2]))
    return tuple(sorted(events, key=lambda event: event.seconds))


def generate_clip(
    prompt: str | Sequence[PromptEvent] = DEFAULT_PROMPT,
    terrain: str | Path | Terrain = "flat",
    path: str = "forward",
    gait: str = "walk",
    seconds: float = 10.0,
    seed: int = 0,
    *,
    speed: float = 1.0,
    transition_seconds: float = 1.0,
    model: Path | None = None,
    name: str = "clip",
) -> Clip:
    """Generate a clip of `seconds` at 60 frames a second; equal arguments give equal bytes.

    `prompt` is one prompt or several with times, `terrain` a name, file or terrain, `path` and `gait` are those of
    `runtime.paths`. `model` is a model folder, by default the shipped one. SportError names what cannot be used.
    """
    from runtime.controller import Controller
    from runtime.model import load_model
    from runtime.prompts.expander import check_prompt
    from runtime.terrain_library import load_terrain

    if not 1.0 / FPS <= seconds <= MAX_SECONDS:
        raise UsageError(f"--seconds {seconds}: expected up to {MAX_SECONDS:.0f}.", "Choose a shorter time.")
    if not 0.0 <= transition_seconds <= 60.0:
        raise UsageError(f"--transition {transition_seconds}: expected 0 to 60 seconds.", "Try 1.")
    script = control_script(path, gait, speed, seed)
    events = (PromptEvent(0.0, prompt),) if isinstance(prompt, str) else tuple(prompt)
    for event in events:
        check_prompt(event.prompt)
    ground = terrain if isinstance(terrain, Terrain) else load_terrain(terrain)
    motion_model = load_model(model)
    to_style = open_prompter(motion_model)
    styles = [(event.seconds, to_style(event.prompt)) for event in events]
    controller = Controller(motion_model, ground, seed)
    poses = simulate(controller, script, styles, round(seconds * FPS), transition_seconds)
    return clip_of(poses, name, events, str(terrain) if not isinstance(terrain, Terrain) else terrain.name)


def simulate(
    controller: Controller,
    script: ControlScript,
    styles: Sequence[tuple[float, Array]],
    frames: int,
    transition_seconds: float = 1.0,
) -> list[Pose]:
    """Step `frames` times under a script; `styles` are (seconds, Z^t), the ones at 0 set without a transition.

    SportError when the network fails: a clip with a hole in it must not be written.
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
        pose = controller.step(script(time, Place(float(root[0]), float(root[2]), pose.root_yaw)))
        if controller.message or not np.all(np.isfinite(pose.positions)):
            raise SportError(
                f"frame {frame}: {controller.message or 'the pose is not finite.'}",
                "Try another seed or model.",
            )
        poses.append(pose)
    return poses


def clip_of(poses: Sequence[Pose], name: str, prompts: Sequence[PromptEvent], terrain: str) -> Clip:
    """The clip of simulated poses."""
    return Clip(
        name=name,
        fps=float(FPS),
        hips_positions=np.stack([pose.hips_position for pose in poses]).astype(np.float32),
        local_rotations=np.stack([pose.local_rotations for pose in poses]).astype(np.float32),
        contacts=np.stack([pose.contacts for pose in poses]).astype(np.float32),
        prompts=tuple(prompts),
        terrain=terrain,
    )
