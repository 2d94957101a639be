"""What `sport generate` and `sport convert` do to write a take."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

from runtime.atomic import check_target
from runtime.errors import UsageError
from runtime.safe_read import printable
from runtime.takes.clip import Clip
from runtime.takes.endings import ending_of
from runtime.takes.export import check_export, save_motion
from runtime.takes.options import ExportOptions
from runtime.terrain.height_map import Terrain
from sport.commands.export_arguments import MOTION_FPS
from sport.commands.film import film_options, write_film


def export_options(arguments: argparse.Namespace) -> ExportOptions:
    """Options from parsed arguments; `fps` is that of motion. UsageError."""
    start, end = parse_range(arguments.range) if arguments.range else (0.0, None)
    options = ExportOptions(
        fps=MOTION_FPS if arguments.fps is None else arguments.fps,
        unit=arguments.unit,
        in_place=arguments.in_place,
        ground_root=arguments.ground_root,
        at_origin=arguments.at_origin,
        rest_frame=arguments.rest_frame,
        loop=arguments.loop,
        start_s=start,
        end_s=end,
        with_ground=arguments.with_ground,
        character=arguments.character,
        joint_map=arguments.joint_map,
    )
    options.check()
    return options


def parse_range(text: str) -> tuple[float, float | None]:
    """Seconds from "2:6.5"; "2:" goes to the end, ":6.5" begins at 0. UsageError shows the form."""
    start, colon, end = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return (float(start) if start.strip() else 0.0), (float(end) if end.strip() else None)
    except ValueError:
        raise UsageError(
            f" {text[:40]}: expected START:END.", "Write seconds, such as 2:6.5.", "range"
        ) from None


def check_outputs(paths: list[Path], options: ExportOptions, arguments: argparse.Namespace) -> None:
    """Everything about the files that can be known before the work; missing folders are made, and said so."""
    ground = arguments.ground_out
    for path in paths:
        ending = ending_of(path)
        check_export(path, options, ground)
        if ending.kind == "film":
            _check_film(options)
            film_options(arguments)
    for path in (*paths, *([ground] if ground is not None else [])):
        new = not os.path.exists(path.parent)  # not Path's: that raises where a name is too long
        check_target(path)
        if new:
            note(f"{path.parent}: this folder is new.")


def _check_film(options: ExportOptions) -> None:
    for name in ("in_place", "ground_root", "at_origin", "rest_frame"):
        if getattr(options, name):
            raise UsageError(
                ": a film has no such thing.", "Leave it out, or write .bvh, .glb or .fbx.", name
            )


def write_take(
    clip: Clip,
    path: Path,
    options: ExportOptions,
    arguments: argparse.Namespace,
    terrain: Terrain,
) -> None:
    """Write a take into one file, and its ground beside it where that is asked; says what was written."""
    if ending_of(path).kind == "film":
        print(printable(write_film(clip, terrain, path, replace(options, fps=clip.fps), arguments)))
        if arguments.ground_out is None:
            return
        from runtime.takes.export import save_ground_of

        print(printable(save_ground_of(clip, arguments.ground_out, options, terrain).text))
        return
    for written in save_motion(clip, path, options, terrain, arguments.ground_out):
        print(printable(written.text))


def numbered(path: Path, number: int) -> Path:
    """`walk.bvh` with a number: `walk-2.bvh`."""
    return path.with_stem(f"{path.stem}-{number}")


def note(text: str) -> None:
    """A remark on stderr, as every other one of the command."""
    print(f"sport: {printable(text)}", file=sys.stderr)
