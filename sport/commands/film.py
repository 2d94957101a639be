"""Films from the command line: length and progress on stderr, Ctrl+C leaves nothing half written."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.safe_read import printable
from runtime.takes.clip import Clip
from runtime.takes.options import ExportOptions
from runtime.terrain.height_map import Terrain
from sport.commands.arguments import size
from sport.commands.export_arguments import FILM_FPS

if TYPE_CHECKING:
    from viewer.filming.film import FilmOptions, Progress


def film_options(arguments: argparse.Namespace) -> FilmOptions:
    """How a film looks, from parsed arguments; UsageError names the one that cannot be used."""
    from viewer.filming.film import FilmOptions

    width, height = size(arguments.size)
    options = FilmOptions(
        width=width or FilmOptions.width,
        height=height or FilmOptions.height,
        fps=FILM_FPS if arguments.fps is None else arguments.fps,
        camera=arguments.camera,
        distance=arguments.distance,
        captions=not arguments.no_captions,
        quality=arguments.quality,
    )
    options.check()
    return options


def write_film(
    clip: Clip,
    terrain: Terrain,
    path: Path,
    export: ExportOptions,
    arguments: argparse.Namespace,
) -> str:
    """Make a film of a take; a sentence about it. SportError names what cannot be used."""
    from runtime.character.character import load_character
    from runtime.character.joint_map import read_joint_map
    from runtime.takes.prepare import on_its_ground, prepare
    from viewer.filming.film import count_frames, make_film

    options = film_options(arguments)
    take = prepare(on_its_ground(clip), replace(export, fps=clip.fps), terrain)
    joint_map = None if export.joint_map is None else read_joint_map(export.joint_map)
    character = None if export.character is None else load_character(export.character, joint_map)
    total = count_frames(take.clip, options.fps)
    print(f"sport: {printable(path)}: a film of {total / options.fps:.1f} s, {total} frames", file=sys.stderr)
    done = make_film(take.clip, terrain, path, options, character=character, progress=_shown(path))
    text = f"{path}: {done.frames} frames at {options.fps:g} fps, {done.seconds:.1f} s"
    return text if take.loop is None else f"{text}; {take.loop.describe()}"


def _shown(path: Path) -> Progress:
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
