"""The `sport` command: parses the subcommand and imports only what that one needs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from sport.runtime.errors import UsageError, run_command

_DESCRIPTION = "Type a prompt, drive the character over uneven ground, take home the clip as BVH."
_EXAMPLES = """examples:
  sport                                                    open the viewer
  sport view --terrain stairs --prompt "an exhausted soldier, left arm hanging"
  sport view --offscreen --frames 120 --screenshot shot.png
  sport generate --prompt "a proud walk" --path circle --seconds 12 --out proud.bvh
  sport generate --prompts "0:walk calmly; 4:drunk" --terrain hills --out change.bvh
  sport generate --prompt "a proud walk" --blend drunk --blend-weights torso=1,head=0.5 --out blend.bvh
  sport bench --json bench.json
  sport train all --preset compact --data DIR --out DIR     needs pip install -e '.[train]'
"""
_TRAINING = {
    "train": ("sport.training.pipeline", "train the networks from motion data"),
    "evaluate": ("sport.training.evaluation.command", "score models against captured motion"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; the exit code: 0, 1 for a failed check, 2 when the user can mend what is wrong."""
    arguments = list(sys.argv[1:] if argv is None else argv) or ["view"]
    return run_command("sport", lambda: _run(arguments))


def _run(arguments: list[str]) -> int:
    if arguments[0] in _TRAINING:
        return _training(arguments[0], arguments[1:])
    options = build_parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int] = options.command
    return command(options)


class _Parser(argparse.ArgumentParser):
    """Tells a mistake in one sentence, as every other error of the command, not with a page of usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}. See {self.prog} --help.\n")


def build_parser() -> argparse.ArgumentParser:
    """The command line, without importing what the subcommands need."""
    parser = _Parser(
        prog="sport",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_view(commands)
    _add_generate(commands)
    _add_bench(commands)
    for name, (_, text) in _TRAINING.items():
        commands.add_parser(name, help=text, add_help=False)
    return parser


# --- sport view ------------------------------------------------------------------------------------------------------


def _add_view(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    view = commands.add_parser("view", help="open the viewer (what plain `sport` does)")
    view.set_defaults(command=_view)
    view.add_argument("--terrain", metavar="NAME|FILE", help="a ready terrain, PNG, NPY or mesh file")
    view.add_argument("--prompt", metavar="TEXT", help="style to begin with")
    _add_blend(view)
    view.add_argument("--model", type=Path, metavar="DIR", help="folder of an exported model")
    view.add_argument("--character", type=Path, metavar="GLB", help="skinned character")
    view.add_argument("--clip", type=Path, metavar="BVH", help="clip to open")
    view.add_argument("--size", metavar="WxH", help="window in pixels, e.g. 1280x720")
    view.add_argument("--ui-scale", type=float, metavar="S", help="size of the interface, 1 is 96 dpi")
    view.add_argument("--no-panels", action="store_true", help="begin without panels")
    view.add_argument(
        "--quality", choices=("software", "high"), help="rendering preset (default: by machine)"
    )
    view.add_argument("--camera", choices=("follow", "orbit"))
    view.add_argument("--seed", type=int, default=0, metavar="N")
    view.add_argument(
        "--controls", default="", metavar="SCRIPT", help='keys to play, e.g. "w 2; w+shift 1.5"'
    )
    view.add_argument("--offscreen", action="store_true", help="no window or display; one step per frame")
    view.add_argument("--frames", type=int, metavar="N", help="end after N frames")
    view.add_argument("--screenshot", type=Path, metavar="PNG", help="picture of the last frame")
    view.add_argument("--save-frames", type=Path, metavar="DIR", help="every frame as PNG (offscreen)")


def _view(options: argparse.Namespace) -> int:
    from sport.viewer.options import ViewOptions

    width, height = _size(options.size)
    view_options = ViewOptions(
        offscreen=options.offscreen,
        frames=options.frames,
        screenshot=options.screenshot,
        frames_directory=options.save_frames,
        width=width,
        height=height,
        ui_scale=options.ui_scale,
        panels=not options.no_panels,
        terrain=options.terrain,
        prompt=options.prompt,
        blend=options.blend,
        blend_weights=_blend_weights(options),
        model=options.model,
        character=options.character,
        clip=options.clip,
        seed=options.seed,
        quality=options.quality,
        camera=options.camera,
        controls=options.controls,
    )
    view_options.check()
    from sport.viewer.app import run

    return run(view_options)


def _add_blend(command: argparse.ArgumentParser) -> None:
    command.add_argument("--blend", metavar="TEXT", help="a second prompt to blend with")
    command.add_argument(
        "--blend-weights",
        metavar="LIST",
        help='share of it in each body part: "left_arm=1,torso=0.5", or one number for all (default: 0.5)',
    )


def _blend_weights(options: argparse.Namespace) -> tuple[float, ...]:
    from sport.runtime.prompts.blend import parse_weights

    if options.blend is None and options.blend_weights is not None:
        raise UsageError("--blend-weights: there is no second prompt.", "Add --blend.")
    return parse_weights("0.5" if options.blend_weights is None else options.blend_weights)


def _size(text: str | None) -> tuple[int | None, int | None]:
    if text is None:
        return None, None
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() for part in parts):
        raise UsageError(f"--size {text}: expected WIDTHxHEIGHT in pixels.", "Write 1280x720.")
    return int(parts[0]), int(parts[1])


# --- sport generate --------------------------------------------------------------------------------------------------


def _add_generate(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    generate = commands.add_parser(
        "generate",
        help="write a clip as BVH without a window",
        description="The same options and seed write the same file.",
    )
    generate.set_defaults(command=_generate)
    style = generate.add_mutually_exclusive_group()
    style.add_argument("--prompt", metavar="TEXT", help="how the character moves")
    style.add_argument("--prompts", metavar="LIST", help='prompts with times: "0:walk calmly; 4:drunk"')
    style.add_argument("--parts", type=Path, metavar="JSON", help="file that says what six body parts do")
    _add_blend(generate)
    generate.add_argument(
        "--expander",
        choices=("library", "gpt"),
        default="library",
        help="what turns a prompt into body parts: the shipped library (default), or a language model: "
        "OPENAI_API_KEY, OPENAI_BASE_URL, SPORT_GPT_MODEL",
    )
    generate.add_argument("--terrain", default="flat", metavar="NAME|FILE", help="default: flat")
    generate.add_argument(
        "--path", default="forward", metavar="PATH", help="forward, circle, figure8 or random"
    )
    generate.add_argument("--gait", default="walk", metavar="GAIT", help="walk, jog, crouch or stand")
    generate.add_argument("--seconds", type=float, default=10.0, metavar="S", help="default: 10")
    generate.add_argument(
        "--speed", type=float, default=1.0, metavar="V", help="share of the full stick, 0 to 1"
    )
    generate.add_argument(
        "--transition", type=float, default=1.0, metavar="S", help="seconds between prompts"
    )
    generate.add_argument(
        "--strength",
        type=float,
        default=1.0,
        metavar="S",
        help="how far styles go from plain walking: 0 to 2, 1 as the model shows them",
    )
    generate.add_argument("--seed", type=int, default=0, metavar="N")
    generate.add_argument("--fps", type=float, default=60.0, metavar="F", help="frames a second of the file")
    generate.add_argument("--unit", default="cm", metavar="UNIT", help="cm or m")
    generate.add_argument("--model", type=Path, metavar="DIR", help="folder of an exported model")
    generate.add_argument(
        "--text-encoder",
        type=Path,
        metavar="DIR",
        help="folder of the text encoder that the model was trained with",
    )
    generate.add_argument("--out", type=Path, required=True, metavar="BVH")


def _generate(options: argparse.Namespace) -> int:
    from sport.runtime.atomic import check_target
    from sport.runtime.generate import DEFAULT_PROMPT, generate_clip, load_parts, parse_prompts
    from sport.runtime.prompts.blend import BlendedPrompt
    from sport.runtime.prompts.expander import check_prompt
    from sport.runtime.takes.clip import check_bvh_length, check_bvh_options, save_bvh

    check_bvh_options(options.fps, options.unit)
    check_bvh_length(options.seconds, options.fps)
    check_target(options.out)
    if options.seed < 0:
        raise UsageError(f"--seed {options.seed}: expected 0 or more.", "Choose another seed.")
    prompt: Any = DEFAULT_PROMPT if options.prompt is None else options.prompt
    weights = _blend_weights(options)
    if options.prompts is not None:
        prompt = parse_prompts(options.prompts)
        if options.blend is not None:
            raise UsageError("--blend: blends one prompt, not several with times.", "Use --prompt.")
    elif options.parts is not None:
        prompt = load_parts(options.parts)
    if options.blend is not None:
        prompt = BlendedPrompt(prompt, check_prompt(options.blend), weights)
    clip = generate_clip(
        prompt,
        options.terrain,
        options.path,
        options.gait,
        options.seconds,
        options.seed,
        speed=options.speed,
        transition_seconds=options.transition,
        strength=options.strength,
        model=options.model,
        name=options.out.stem,
        expander=options.expander,
        text_encoder=options.text_encoder,
        report=lambda remark: print(f"sport: {remark}", file=sys.stderr),
    )
    save_bvh(clip, options.out, options.fps, options.unit)
    print(f"{options.out}: {len(clip)} frames, {len(clip) / clip.fps:.1f} s")
    return 0


# --- sport bench, train -----------------------------------------------------------------------------------------------


def _add_bench(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    bench = commands.add_parser("bench", help="measure speed and memory on this machine")
    bench.set_defaults(command=_bench)
    bench.add_argument("--json", type=Path, metavar="FILE", help="write the figures to FILE")
    bench.add_argument("--frames", type=int, default=1000, metavar="N", help="frames to time (default: 1000)")
    bench.add_argument("--model", type=Path, metavar="DIR", help="folder of an exported model")


def _bench(options: argparse.Namespace) -> int:
    from sport.benchmarks.bench import run

    return run(options.json, options.frames, options.model)


def _training(command: str, arguments: list[str]) -> int:
    module = _TRAINING[command][0]
    try:
        import importlib

        entry = importlib.import_module(module)
    except ModuleNotFoundError as error:
        missing = error.name or module
        if missing.split(".")[0] == "sport":
            raise UsageError(
                f"sport {command}: this installation has no module {missing}.", "Update it."
            ) from error
        raise UsageError(
            f"sport {command}: the Python package '{missing}' is not installed.",
            "Run pip install -e '.[train]'.",
        ) from error
    result = entry.main(arguments)
    return int(result or 0)


if __name__ == "__main__":
    sys.exit(main())
