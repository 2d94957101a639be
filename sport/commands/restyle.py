"""`sport restyle`: the path, speed, facing and gaits of a clip, walked by a prompt."""

import argparse
from dataclasses import replace
from pathlib import Path

from sport.commands.arguments import OUT_HELP, Subparsers, add_export_arguments, add_model


def add(commands: Subparsers) -> None:
    """Declare the arguments."""
    restyle = commands.add_parser(
        "restyle",
        help="walk the path of a clip (BVH, GLB, VRM, FBX) in the style of a prompt",
        description="The new clip has the path, speed, facing, gaits and time of the given one. "
        "The same options and seed write the same file.",
    )
    restyle.set_defaults(command=run)
    restyle.add_argument("take", type=Path, metavar="CLIP", help="BVH, GLB, VRM or FBX")
    restyle.add_argument("--prompt", metavar="TEXT", required=True, help="how the character moves")
    restyle.add_argument(
        "--terrain", metavar="NAME|FILE", help="ground to walk on (default: the clip's own, or flat)"
    )
    restyle.add_argument(
        "--animation", default="", metavar="NAME", help="name of an animation in a GLB, VRM or FBX"
    )
    restyle.add_argument("--seed", type=int, default=0, metavar="N")
    add_model(restyle)
    restyle.add_argument("--out", type=Path, required=True, metavar="FILE", help=OUT_HELP)
    add_export_arguments(restyle)


def run(options: argparse.Namespace) -> int:
    """Write the restyled clip, and say how far it keeps to the given one."""
    from runtime.formats.ground import ground_of
    from runtime.formats.reference import open_take
    from runtime.motion.controller import Controller
    from runtime.motion.model import load_model
    from runtime.prompts.expander import check_prompt
    from runtime.prompts.prompter import Prompter
    from runtime.takes.input_recording import StyleChange
    from runtime.takes.metadata import PromptEvent
    from runtime.takes.restyle import path_error, restyled
    from sport.commands.export import check_outputs, export_options, note, write_take

    export, prompt = export_options(options), check_prompt(options.prompt)
    check_outputs([options.out], export)
    opened = open_take(options.take, options.animation)
    terrain = ground_of(opened.clip, options.take, options.terrain)
    controller = Controller(load_model(options.model), terrain, options.seed)
    z = Prompter(controller.model, report=note).style(prompt)
    made, _ = restyled(opened.clip, controller, StyleChange(0, z, 0.0, PromptEvent(0.0, prompt)))
    error = path_error(made, opened.clip)
    note(
        f"{100.0 * error.path_m:.0f} cm off the path, {error.time_s:.2f} s off the time of {options.take.name}"
    )
    write_take(replace(made, name=options.out.stem).resampled(export.fps), options.out, export, terrain)
    return 0
