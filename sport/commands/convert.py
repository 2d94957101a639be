"""`sport convert`: a take (BVH, GLB, VRM, FBX) as another file."""

import argparse
from dataclasses import replace
from pathlib import Path

from runtime.errors import UsageError
from sport.commands.arguments import OUT_HELP, Subparsers, add_export_arguments


def add(commands: Subparsers) -> None:
    """Declare the arguments."""
    convert = commands.add_parser(
        "convert",
        help="write a take (BVH, GLB or FBX, of any two-legged skeleton) as GLB, FBX, film, ground or another BVH",
        description="The ground is read from the JSON next to the take; rate and unit are kept.",
    )
    convert.set_defaults(command=run)
    convert.add_argument("take", type=Path, metavar="TAKE", help="BVH, GLB, VRM or FBX")
    convert.add_argument("out", type=Path, nargs="+", metavar="FILE", help=OUT_HELP)
    convert.add_argument("--terrain", metavar="NAME|FILE", help="ground to use instead of the take's own")
    convert.add_argument(
        "--animation",
        default="",
        metavar="NAME",
        help="name of an animation in a GLB, VRM or FBX (default: the first that moves a body)",
    )
    add_export_arguments(convert)


def run(options: argparse.Namespace) -> int:
    """Write every file and say what was written; a motion of another skeleton goes onto ours first."""
    from runtime.formats.ground import ground_of
    from runtime.formats.reference import open_take
    from sport.commands.export import check_outputs, export_options, note, write_take

    export = export_options(options)
    if options.take.resolve() in [out.resolve() for out in options.out]:
        raise UsageError(f"{options.take}: would overwrite itself.", "Choose another name.")
    if options.ground_out is not None and len(options.out) > 1:
        raise UsageError(" with several files: their units may differ.", "Convert one by one.", "ground_out")
    opened = open_take(options.take, options.animation)
    clip = opened.clip
    if options.fps is None:  # rate and unit stay as in the file
        export = replace(export, fps=clip.fps)
    if options.unit is None:
        export = replace(export, unit=opened.unit)
    terrain = ground_of(clip, options.take, options.terrain)
    check_outputs(options.out, export)
    other = "" if opened.reference is None else f"{options.take.name}{opened.reference.describe()}."
    for text in filter(None, (opened.note, other, terrain.note)):
        note(text)
    for out in options.out:
        write_take(clip, out, export, terrain)
    return 0
