"""Arguments that several commands share."""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import Field, fields
from typing import Any

from runtime.assets import model_folder, shipped_models
from runtime.errors import UsageError
from runtime.formats.options import FILMS, ExportOptions, ExportSpec
from runtime.formats.table import FORMATS
from runtime.options import spec_of

OUT_HELP = "file to write; its ending selects the format: " + ", ".join(FORMATS)
Subparsers = argparse._SubParsersAction  # what `add_subparsers` returns


def declare(command: argparse._ActionsContainer, table: Mapping[str, Mapping[str, Any]]) -> None:
    """Declare the arguments of a table: flag to keyword arguments of `add_argument`."""
    for flag, spec in table.items():
        command.add_argument(flag, **spec)


def add_model(command: argparse.ArgumentParser) -> None:
    """Declare the model."""
    command.add_argument(
        "--model",
        type=model_folder,
        metavar="NAME|DIR",
        help=f"a shipped model ({', '.join(shipped_models())}; the first is the default) or the folder of an exported one",
    )


def add_blend(command: argparse.ArgumentParser) -> None:
    """Declare a second prompt and its share."""
    command.add_argument("--blend", metavar="TEXT", help="a second prompt to blend with")
    command.add_argument(
        "--blend-weights",
        metavar="LIST",
        help='its weight in each body part: "left_arm=1,torso=0.5", or one number for all (default: 0.5)',
    )


def blend_weights(options: argparse.Namespace) -> tuple[float, ...]:
    """Return the weight of the second prompt in each part, in the order of `PART_NAMES`."""
    from runtime.prompts.blend import parse_weights

    if options.blend is None and options.blend_weights is not None:
        raise UsageError("--blend-weights: there is no second prompt.", "Add --blend.")
    return parse_weights("0.5" if options.blend_weights is None else options.blend_weights)


def size(text: str) -> tuple[int, int]:
    """Return width and height in pixels of "1280x720"; UsageError shows the form."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() for part in parts):
        raise UsageError(f"--size {text}: expected WIDTHxHEIGHT in pixels.", "Write 1280x720.")
    return int(parts[0]), int(parts[1])


def export_arguments() -> Iterator[tuple[Field[object], ExportSpec]]:
    """Yield the options of an export that have an argument."""
    for field in fields(ExportOptions):
        spec = spec_of(ExportOptions, field.name)
        if isinstance(spec, ExportSpec) and spec.flag:
            yield field, spec


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments that every export has; one that is not given is None, or False for a flag."""
    take = parser.add_argument_group("options of the take")
    film = parser.add_argument_group("options of a film")
    for field, spec in export_arguments():
        group = film if spec.formats == FILMS else take
        if isinstance(field.default, bool):
            group.add_argument(spec.flag, dest=spec.argument, action="store_true", help=spec.help)
            continue
        several = isinstance(field.default, tuple)
        group.add_argument(
            spec.flag,
            dest=spec.argument,
            action="append" if several else "store",
            type=spec.parse,
            metavar=spec.metavar or None,
            choices=None if spec.metavar else tuple(spec.choices or ()),
            help=spec.help,
        )
