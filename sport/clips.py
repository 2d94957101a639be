"""Clips from the options of `sport generate`: generated, trimmed and written."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.errors import UsageError
from sport.commands.arguments import blend_weights

if TYPE_CHECKING:
    from runtime.formats.options import ExportOptions
    from runtime.motion.control_scripts import StickScript

MAX_VARIANTS = 1000
Tools = Callable[[argparse.Namespace], tuple[Any, Any]]  # the loaded model and its prompter


def write_clips(options: argparse.Namespace, tools: Tools | None = None) -> None:
    """Write the clip or its variants; `tools` gives a loaded model and its prompter for these options. SportError."""
    from runtime.formats.bvh_clip import check_bvh_length
    from runtime.formats.table import format_of
    from runtime.generate import check_seconds, generate_clip
    from runtime.motion.features import FPS
    from runtime.terrain.library import load_terrain
    from sport.commands.export import check_length, check_outputs, export_options, note, write_take

    export = export_options(options)
    outputs = _outputs(options)
    controls, seconds = _controls(options)
    check_seconds(seconds)
    arguments = _arguments(options, controls)
    if any(out.suffix.lower() == ".bvh" for out in outputs):
        check_bvh_length(seconds, export.fps)
    check_length(outputs, export, seconds)
    check_outputs(outputs, export)
    terrain = load_terrain(options.terrain)
    if terrain.note:
        note(terrain.note)
    rendered = seconds
    if export.fps > FPS and not any(format_of(out).film for out in outputs):
        rendered += 1.0 / FPS  # at higher rates the last frames lie between two of ours
    size = _size_of(export)
    model, prompter = (options.model, None) if tools is None else tools(options)
    for k, out in enumerate(outputs):
        clip = generate_clip(
            **arguments, seconds=rendered, seed=options.seed + k, model=model, name=out.stem,
            prompter=prompter, size=size,
        )  # fmt: skip
        if not format_of(out).film:
            clip = clip.resampled(export.fps)
            clip = clip.trim(0, min(max(round(seconds * export.fps), 1), len(clip)) - 1)
        write_take(clip, out, export, terrain)


def _arguments(options: argparse.Namespace, controls: StickScript | None) -> dict[str, Any]:
    """Return the arguments of `generate_clip` shared by all variants."""
    from sport.commands.export import note

    return {
        "prompt": _prompt(options), "terrain": options.terrain, "path": options.path or "forward",
        "gait": options.gait or "walk", "controls": controls, "transition_seconds": options.transition,
        "speed": 1.0 if options.speed is None else options.speed, "strength": options.strength,
        "response": options.response, "expander": options.expander, "text_encoder": options.text_encoder,
        "report": note, "pins": "; ".join(options.pin), "exact_legs": not options.network_legs,
    }  # fmt: skip


def _size_of(export: ExportOptions) -> float:
    """Return the size of the export's character, for which the motion is generated; 1 for the mannequin. FileError."""
    from runtime.character.character import load_character

    if export.character is None or export.fit_to_motion:
        return 1.0
    return load_character(export.character, export.joint_map, export.character_unit).size


def _outputs(options: argparse.Namespace) -> list[Path]:
    """Return the file, or one for each variant; UsageError."""
    from sport.commands.export import numbered

    if options.seed < 0:
        raise UsageError(f" {options.seed}: expected 0 or more.", "Choose another seed.", "seed")
    if not 1 <= options.variants <= MAX_VARIANTS:
        raise UsageError(f" {options.variants}: expected 1 to {MAX_VARIANTS}.", "Try 3.", "variants")
    if options.variants > 1 and options.ground_out is not None:
        raise UsageError(
            " with --variants: all clips use the same ground.", "Leave one of the two out.", "ground_out"
        )
    if options.variants == 1:
        return [options.out]
    return [numbered(options.out, number) for number in range(1, options.variants + 1)]


def _controls(options: argparse.Namespace) -> tuple[StickScript | None, float]:
    """Return the stick script, if given, and the seconds of the clip; UsageError."""
    from runtime.motion.control_scripts import parse_stick

    if options.controls is None:
        return None, 10.0 if options.seconds is None else options.seconds
    for name in ("path", "gait", "speed"):
        if getattr(options, name) is not None:
            raise UsageError(": --controls already sets it.", "Leave one of the two out.", name)
    script = parse_stick(options.controls)
    return script, script.seconds if options.seconds is None else options.seconds


def _prompt(options: argparse.Namespace) -> Any:
    """Return the prompt for `generate_clip`: one text, texts with times, six descriptions, or a blend."""
    from runtime.generate import load_parts, parse_prompts
    from runtime.prompts.blend import BlendedPrompt
    from runtime.prompts.expander import DEFAULT_PROMPT, check_prompt

    prompt: Any = DEFAULT_PROMPT if options.prompt is None else options.prompt
    weights = blend_weights(options)
    if options.prompts is not None:
        prompt = parse_prompts(options.prompts)
        if options.blend is not None:
            raise UsageError("--blend: blends one prompt, not several with times.", "Use --prompt.")
    elif options.parts is not None:
        prompt = load_parts(options.parts)
    return prompt if options.blend is None else BlendedPrompt(prompt, check_prompt(options.blend), weights)
