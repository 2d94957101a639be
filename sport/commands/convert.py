"""`sport convert`: a take (BVH) as another file."""

from __future__ import annotations

import argparse
from pathlib import Path

from runtime.errors import UsageError
from sport.commands.arguments import Subparsers
from sport.commands.export_arguments import OUT_HELP, add_export_arguments


def add(commands: Subparsers) -> None:
    """Declare the arguments."""
    convert = commands.add_parser(
        "convert",
        help="write a take (BVH, of any two-legged skeleton) as GLB, FBX, film, ground or another BVH",
        description="The ground is the one that the JSON beside the take names.",
    )
    convert.set_defaults(command=run)
    convert.add_argument("take", type=Path, metavar="BVH")
    convert.add_argument("out", type=Path, nargs="+", metavar="FILE", help=OUT_HELP)
    convert.add_argument("--terrain", metavar="NAME|FILE", help="another ground than the take's own")
    add_export_arguments(convert)


def run(options: argparse.Namespace) -> int:
    """Write every file and say what was written; a motion of another skeleton goes onto ours first."""
    from runtime.formats.bvh_clip import OtherSkeleton, load_clip_bvh
    from runtime.formats.ground import ground_of
    from runtime.formats.reference import load_reference_bvh
    from sport.commands.export import check_outputs, export_options, note, write_take

    export = export_options(options)
    if options.take.resolve() in [out.resolve() for out in options.out]:
        raise UsageError(f"{options.take}: would be written over itself.", "Choose another name.")
    if options.ground_out is not None and len(options.out) > 1:
        raise UsageError(" with several files: their units may differ.", "Convert one by one.", "ground_out")
    try:
        clip = load_clip_bvh(options.take)
    except OtherSkeleton:
        reference = load_reference_bvh(options.take)
        clip = reference.clip
        note(f"{options.take.name}{reference.describe()}.")
    terrain = ground_of(clip, options.take, options.terrain)
    check_outputs(options.out, export, options)
    if terrain.note:
        note(terrain.note)
    for out in options.out:
        write_take(clip, out, export, options, terrain)
    return 0
