"""Writes takes for `sport generate` and `sport convert`: files, and films with progress."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.atomic import check_target
from runtime.errors import UsageError
from runtime.formats.options import ExportOptions
from runtime.formats.prepare import frames_in_range, on_its_ground, prepare
from runtime.formats.table import check_export, format_of, save_ground_beside, save_motion
from runtime.pose import FPS, video_rate
from runtime.safe_read import printable
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from sport.commands.arguments import export_arguments, size

if TYPE_CHECKING:
    from viewer.filming.film import FilmOptions, Progress


def export_options(arguments: argparse.Namespace) -> ExportOptions:
    """Return the options of an export from parsed arguments; UsageError."""
    given: dict[str, Any] = {}
    for field, spec in export_arguments():
        value = getattr(arguments, spec.argument)
        if value is not None and value is not False:
            given[field.name] = not field.default if value is True else value
    if "start_s" in given:
        given["start_s"], given["end_s"] = parse_range(given["start_s"])
    if "fps" in given:
        given["fps"] = given["film_fps"] = video_rate(given["fps"])
    if "with_takes" in given:
        given["with_takes"] = tuple(given["with_takes"])
    options = ExportOptions(**given)
    options.check()
    return options


def parse_range(text: str) -> tuple[float, float | None]:
    """Return start and end in seconds of "2:6.5"; "2:" goes to the end, ":6.5" begins at 0. UsageError shows the form."""
    start, colon, end = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return (float(start) if start.strip() else 0.0), (float(end) if end.strip() else None)
    except ValueError:
        raise UsageError(
            f" {text[:40]}: expected START:END.", "Write seconds, such as 2:6.5.", "range"
        ) from None


def check_outputs(paths: list[Path], options: ExportOptions) -> None:
    """Check the outputs before the work as far as possible; create missing folders, and say so."""
    from runtime.character.character import load_character

    for path in paths:
        check_export(path, options)
        if format_of(path).film:
            from viewer.filming.writers import check_writer

            check_writer(path, film_options(options).size, frames=0)
    if options.character is not None and not options.fit_to_motion:
        guessed = load_character(options.character, options.joint_map, options.character_unit).note
        if guessed:
            note(guessed)
    for path in (*paths, *([options.ground_out] if options.ground_out is not None else [])):
        new = not os.path.exists(path.parent)  # os.path: Path.exists raises for too long names
        check_target(path)
        if new:
            note(f"{path.parent}: this folder is new.")


def check_length(paths: list[Path], options: ExportOptions, seconds: float) -> None:
    """Raise UsageError if the range begins after a generated clip's end, or a film of it has too many frames."""
    for path in paths:
        film = format_of(path).film
        fps = FPS if film else options.fps
        first, last = frames_in_range(options, max(round(seconds * fps), 1), fps)
        if film and not options.loop:
            from viewer.filming.film import count_frames
            from viewer.filming.writers import check_writer

            count = count_frames((last - first + 1) / fps, options.film_fps)
            check_writer(path, film_options(options).size, count)


def write_take(clip: Clip, path: Path, options: ExportOptions, terrain: Terrain) -> None:
    """Write a take to a file, and its ground next to it if requested; report the files."""
    if format_of(path).film:
        from viewer.filming.film import count_frames, film_of_take

        film = film_options(options)
        take = prepare(on_its_ground(clip), replace(options, fps=clip.fps), terrain)
        total = count_frames(len(take.clip) / take.clip.fps, film.fps)
        note(f"{path}: a film of {total / film.fps:.1f} s, {total} frames")
        print(printable(film_of_take(take, terrain, path, options, film, _progress(path))))
        written = save_ground_beside(prepare(clip, options, terrain), options, terrain)
    else:
        written = save_motion(clip, path, options, terrain)
    for text in written:
        print(printable(text))


def film_options(options: ExportOptions) -> FilmOptions:
    """Return the film options; UsageError names an invalid one."""
    from viewer.filming.film import FilmOptions

    width, height = size(options.size)
    film = FilmOptions(
        width, height, options.film_fps, options.camera, options.distance, options.captions, options.quality
    )
    film.check()
    return film


def _progress(path: Path) -> Progress:
    """Return a progress callback: one line on a terminal, ten lines in a log."""
    terminal, said = sys.stderr.isatty(), f"sport: {printable(path.name)}: "

    def show(done: int, total: int) -> None:
        if terminal or done * 10 // total != (done - 1) * 10 // total:
            end = "\n" if done == total or not terminal else ""
            begin = "\r" if terminal else ""
            print(f"{begin}{said}{done} of {total} frames", end=end, file=sys.stderr, flush=True)

    return show


def numbered(path: Path, number: int) -> Path:
    """Return `walk.bvh` with a number: `walk-2.bvh`."""
    return path.with_stem(f"{path.stem}-{number}")


def note(text: str) -> None:
    """Write a remark to stderr in the command's format."""
    print(f"sport: {printable(text)}", file=sys.stderr)
