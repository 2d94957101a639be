"""What `sport generate` and `sport convert` do to write a take: files, and films with their progress."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.atomic import check_target
from runtime.errors import UsageError
from runtime.formats.prepare import ExportOptions, on_its_ground, prepare
from runtime.formats.table import check_export, format_of, save_ground_beside, save_motion
from runtime.safe_read import printable
from runtime.takes.clip import Clip, video_rate
from runtime.terrain.height_map import Terrain
from sport.commands.arguments import size
from sport.commands.export_arguments import FILM_FPS, MOTION_FPS

if TYPE_CHECKING:
    from viewer.filming.film import FilmOptions, Progress


def export_options(arguments: argparse.Namespace) -> ExportOptions:
    """Options from parsed arguments; `fps` is that of motion. UsageError."""
    start, end = parse_range(arguments.range) if arguments.range else (0.0, None)
    options = ExportOptions(
        fps=MOTION_FPS if arguments.fps is None else video_rate(arguments.fps),
        unit=arguments.unit or "cm",
        euler_order=arguments.euler_order,
        in_place=arguments.in_place,
        ground_root=arguments.ground_root,
        at_origin=arguments.at_origin,
        rest_frame=arguments.rest_frame,
        loop=arguments.loop,
        strides=arguments.strides,
        start_s=start,
        end_s=end,
        with_ground=arguments.with_ground,
        character=arguments.character,
        fit_to_motion=arguments.fit_to_motion,
        joint_map=arguments.joint_map,
        engine=arguments.engine,
        humanoid_names=arguments.humanoid_names,
        animation_only=arguments.animation_only,
        with_takes=tuple(arguments.with_take),
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
        check_export(path, options, ground)
        if format_of(path).film:
            film_options(arguments)
    for path in (*paths, *([ground] if ground is not None else [])):
        new = not os.path.exists(path.parent)  # not Path's: that raises where a name is too long
        check_target(path)
        if new:
            note(f"{path.parent}: this folder is new.")


def write_take(
    clip: Clip,
    path: Path,
    options: ExportOptions,
    arguments: argparse.Namespace,
    terrain: Terrain,
) -> None:
    """Write a take into one file, and its ground beside it where that is asked; says what was written."""
    if not format_of(path).film:
        for written in save_motion(clip, path, options, terrain, arguments.ground_out):
            print(printable(written.text))
        return
    from viewer.filming.film import count_frames, film_of_take

    film = film_options(arguments)
    take = prepare(on_its_ground(clip), replace(options, fps=clip.fps), terrain)
    total = count_frames(take.clip, film.fps)
    note(f"{path}: a film of {total / film.fps:.1f} s, {total} frames")
    print(printable(film_of_take(take, terrain, path, options, film, _progress(path))))
    if arguments.ground_out is not None:
        print(
            printable(save_ground_beside(prepare(clip, options, terrain), arguments.ground_out, terrain).text)
        )


def film_options(arguments: argparse.Namespace) -> FilmOptions:
    """How a film looks, from parsed arguments; UsageError names the one that cannot be used."""
    from viewer.filming.film import FilmOptions

    width, height = size(arguments.size)
    options = FilmOptions(
        width=width or FilmOptions.width,
        height=height or FilmOptions.height,
        fps=FILM_FPS if arguments.fps is None else video_rate(arguments.fps),
        camera=arguments.camera,
        distance=arguments.distance,
        captions=not arguments.no_captions,
        quality=arguments.quality,
    )
    options.check()
    return options


def _progress(path: Path) -> Progress:
    """Progress in one line on a terminal, in ten lines in a log."""
    terminal = sys.stderr.isatty()

    def show(done: int, total: int) -> None:
        tenth = done * 10 // total != (done - 1) * 10 // total
        if terminal:
            end = "\n" if done == total else ""
            print(
                f"\rsport: {printable(path.name)}: {done} of {total} frames",
                end=end,
                file=sys.stderr,
                flush=True,
            )
        elif tenth:
            print(f"sport: {printable(path.name)}: {done} of {total} frames", file=sys.stderr)

    return show


def numbered(path: Path, number: int) -> Path:
    """`walk.bvh` with a number: `walk-2.bvh`."""
    return path.with_stem(f"{path.stem}-{number}")


def note(text: str) -> None:
    """A remark on stderr, as every other one of the command."""
    print(f"sport: {printable(text)}", file=sys.stderr)
