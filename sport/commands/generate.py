"""`sport generate`: a clip as BVH, GLB, FBX or film, without a window."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.errors import UsageError
from sport.commands.arguments import OUT_HELP, Subparsers, add_blend, add_export_arguments, add_model, declare

if TYPE_CHECKING:
    from sport.batch.rows import RowParser


def add(commands: Subparsers) -> None:
    """Declare the arguments."""
    generate = commands.add_parser(
        "generate",
        help="write a clip as BVH, GLB, FBX or film without a window",
        description="The same options and seed write the same file.",
    )
    generate.set_defaults(command=run)
    style = _add_style(generate)
    # a row of a batch has no arguments without a name
    style.add_argument(
        "prompt", nargs="?", default=argparse.SUPPRESS, metavar="PROMPT", help="the same as --prompt"
    )
    _add_course_and_output(generate)
    batch = generate.add_argument_group("many clips")
    batch.add_argument(
        "--batch",
        type=Path,
        metavar="LIST",
        help="CSV or JSON lines with one clip per row and these arguments as columns; --out is then a folder",
    )
    batch.add_argument("--workers", type=int, metavar="N", help="processes (default: one for each core)")


def _add_style(generate: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    style = generate.add_mutually_exclusive_group()
    style.add_argument("--prompt", metavar="TEXT", help="how the character moves")
    style.add_argument("--prompts", metavar="LIST", help='prompts with times: "0:walk calmly; 4:a zombie"')
    style.add_argument("--parts", type=Path, metavar="JSON", help="JSON file that describes six body parts")
    add_blend(generate)
    generate.add_argument(
        "--expander",
        choices=("library", "gpt"),
        default="library",
        help="what expands a prompt into body part descriptions: the shipped library (default), or a language model: "
        "OPENAI_API_KEY, OPENAI_BASE_URL, SPORT_GPT_MODEL",
    )
    return style


_COURSE: dict[str, dict[str, Any]] = {
    "--terrain": dict(default="flat", metavar="NAME|FILE", help="default: flat"),
    "--path": dict(metavar="PATH", help="forward (default), circle, figure8 or random"),
    "--gait": dict(metavar="GAIT", help="walk (default), jog, crouch or stand"),
    "--speed": dict(type=float, metavar="V", help="fraction of the full stick, 0 to 1 (default: 1)"),
    "--controls": dict(
        metavar="SCRIPT",
        help='the stick as text, instead of path, gait and speed: "stand 2; walk@90 3; jog@0*0.5 2; jump 1"',
    ),
    "--seconds": dict(type=float, metavar="S", help="default: 10, or the length of --controls"),
    "--transition": dict(type=float, default=1.0, metavar="S", help="seconds between prompts"),
    "--pin": dict(
        action="append", default=[], metavar="TEXT",
        help='hold a part of the body (again for more): "left hand 0.3 1.1 0.4 from 2 to 4", '
        '"left hand 0.5 0.9 0 rail 0.5 0.9 4", "look 0 1.6 5", "left foot 0.1 0 2 from 1 to 2", "pose 1.5 from 2 to 3"; '
        "metres of the world, or after the point: along",
    ),
    "--strength": dict(
        type=float, default=1.0, metavar="S", help="style strength, 0 (plain walking) to 2 (exaggerated); 1 is as the model shows it"
    ),
    "--response": dict(
        type=float, default=0.0, metavar="R",
        help="how quickly starts, stops and turns follow the stick: 0 as in capture (default) to 1 as in a game",
    ),
    "--network-legs": dict(
        action="store_true", help="show the network's motion alone, without the body edits of the prompt"
    ),
    "--seed": dict(type=int, default=0, metavar="N"),
}  # fmt: skip
_OUTPUT: dict[str, dict[str, Any]] = {
    "--text-encoder": dict(type=Path, metavar="DIR", help="folder of the text encoder that the model was trained with"),
    "--variants": dict(type=int, default=1, metavar="N", help="N clips, name-1 to name-N, with seeds from --seed on"),
    "--out": dict(type=Path, required=True, metavar="FILE", help=OUT_HELP),
}  # fmt: skip


def _add_course_and_output(generate: argparse.ArgumentParser) -> None:
    declare(generate, _COURSE)
    add_model(generate)
    declare(generate, _OUTPUT)
    add_export_arguments(generate)


def run(options: argparse.Namespace) -> int:
    """Write the clip, or its variants, or the clips of a list, and say what was written."""
    if options.batch is not None:
        from sport.batch.run import run_batch

        return run_batch(options, row_parser())
    if options.workers is not None:
        raise UsageError(": works with --batch only.", "Add --batch.", "workers")
    from sport.clips import write_clips

    write_clips(options)
    return 0


def row_parser() -> RowParser:
    """Return the parser of a row of a batch: it has the arguments of this command without those of the batch itself."""
    from sport.batch.rows import RowParser

    parser = RowParser(prog="row", add_help=False, allow_abbrev=False)
    _add_style(parser)
    _add_course_and_output(parser)
    return parser
