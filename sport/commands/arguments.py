"""Arguments that several commands share."""

from __future__ import annotations

import argparse

from runtime.assets import model_folder, shipped_models
from runtime.errors import UsageError

Subparsers = argparse._SubParsersAction  # what `add_subparsers` returns


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
        help='share of it in each body part: "left_arm=1,torso=0.5", or one number for all (default: 0.5)',
    )


def blend_weights(options: argparse.Namespace) -> tuple[float, ...]:
    """The share of the second prompt in each part, in the order of `PART_NAMES`."""
    from runtime.prompts.blend import parse_weights

    if options.blend is None and options.blend_weights is not None:
        raise UsageError("--blend-weights: there is no second prompt.", "Add --blend.")
    return parse_weights("0.5" if options.blend_weights is None else options.blend_weights)


def size(text: str | None) -> tuple[int | None, int | None]:
    """Width and height in pixels of "1280x720", None twice without text; UsageError shows the form."""
    if text is None:
        return None, None
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() for part in parts):
        raise UsageError(f"--size {text}: expected WIDTHxHEIGHT in pixels.", "Write 1280x720.")
    return int(parts[0]), int(parts[1])
