"""The command line: commands and arguments, with errors that name the arguments as typed."""

import argparse
from collections.abc import Callable
from typing import Any, NoReturn

from runtime.errors import UsageError
from sport.commands import bench, convert, generate, restyle, training, view
from sport.commands.arguments import export_arguments

_DESCRIPTION = "Type a prompt, drive the character over uneven ground, export the clip as BVH."
_EXAMPLES = """examples:
  sport                                                    open the viewer
  sport view --terrain stairs --prompt "an exhausted soldier, left arm hanging"
  sport view --offscreen --frames 120 --screenshot shot.png
  sport generate --prompt "a proud walk" --path circle --seconds 12 --out proud.bvh
  sport generate --prompts "0:walk calmly; 4:a zombie" --terrain hills --out change.bvh
  sport generate --prompt "a proud walk" --blend "a zombie" --blend-weights torso=1,head=0.5 --out blend.bvh
  sport generate --character me.glb --loop --out walk.glb
  sport convert proud.bvh proud.glb proud.mp4
  sport restyle walk.bvh --prompt "a zombie" --out zombie.bvh
  sport bench --json bench.json
  sport train all --preset compact --data DIR --out DIR     needs pip install -e '.[train]'
"""
MAX_MESSAGE = 400  # characters of what a parser says


def run(arguments: list[str]) -> int:
    """Run a command with its arguments and return its exit code. SportError."""
    if arguments[0] in training.COMMANDS:
        return training.run(arguments[0], arguments[1:])
    options = build_parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int] = options.command
    try:
        return command(options)
    except UsageError as error:
        raise _with_flag(error) from error


def _with_flag(error: UsageError) -> UsageError:
    """Return the error with the argument's name in place of the parameter's."""
    if not error.parameter:
        return error
    options = {field.name: spec.flag for field, spec in export_arguments()}
    named = "transition" if error.parameter == "transition_seconds" else error.parameter.replace("_", "-")
    flag = options.get(error.parameter, f"--{named}")
    return UsageError(error.problem.removeprefix(error.parameter), error.remedy, flag)


class _Parser(argparse.ArgumentParser):
    """Reports a mistake in one sentence, like every other error of the command, instead of printing usage."""

    def error(self, message: str) -> NoReturn:
        said = str(UsageError(message))  # on one line, whatever was typed
        said = said if len(said) <= MAX_MESSAGE else said[:MAX_MESSAGE] + "…"
        self.exit(2, f"{self.prog}: {said}. See {self.prog} --help.\n")


class _ShowVersion(argparse.Action):
    """Prints the version of the installed package (`--version`)."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import PackageNotFoundError, version

        try:
            found = version("sport-viewer")
        except PackageNotFoundError:  # a clone that was never installed
            found = "not installed"
        print(f"sport {found}")
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, without importing what the subcommands need."""
    parser = _Parser(
        prog="sport",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_ShowVersion, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in (view, generate, restyle, convert, bench):
        command.add(commands)
    for name, (_, text) in training.COMMANDS.items():
        commands.add_parser(name, help=text, add_help=False)
    return parser
