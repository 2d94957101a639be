"""`sport view`: the viewer in a window, or its frames without one."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path

from runtime.assets import character_file
from sport.commands.arguments import Subparsers, add_blend, add_model, blend_weights, size


def add(commands: Subparsers) -> None:
    """Declare the arguments."""
    view = commands.add_parser("view", help="open the viewer (what plain `sport` does)")
    view.set_defaults(command=run)
    view.add_argument("--terrain", metavar="NAME|FILE", help="a ready terrain, PNG, NPY or mesh file")
    view.add_argument("--prompt", metavar="TEXT", help="style to begin with")
    add_blend(view)
    add_model(view)
    view.add_argument(
        "--character", type=character_file, metavar="NAME|FILE", help="walker, or a skinned GLB, glTF or VRM"
    )
    view.add_argument(
        "--joint-map", type=Path, metavar="JSON", help="names of its joints, in place of the file next to it"
    )
    view.add_argument(
        "--fit-to-motion", action="store_true", help="the character gets the size of the motion, not its own"
    )
    view.add_argument("--clip", type=Path, metavar="FILE", help="motion to open: BVH, GLB, VRM, FBX")
    view.add_argument("--session", metavar="FILE", help='session to open, or "last"')
    view.add_argument("--size", metavar="WxH", help="window in pixels, e.g. 1280x720")
    view.add_argument("--ui-scale", type=float, metavar="S", help="size of the interface, 1 is 96 dpi")
    view.add_argument("--no-panels", action="store_true", help="begin without panels")
    view.add_argument(
        "--quality", choices=("fast", "software", "high"), help="rendering preset (default: by machine)"
    )
    view.add_argument("--camera", choices=("follow", "orbit"))
    view.add_argument(
        "--response",
        type=float,
        metavar="R",
        help="how quickly starts, stops and turns follow the stick: 0 as in capture to 1 as in a game",
    )
    view.add_argument("--seed", type=int, default=0, metavar="N")
    view.add_argument(
        "--controls",
        metavar="SCRIPT",
        help='the stick as text: "stand 2; walk 3; walk@90 3; jog@0*0.5 2; jump 1"',
    )
    view.add_argument(
        "--keys", default="", metavar="SCRIPT", help='keys to press, e.g. "w 2; w+shift 1.5; f1 0.2"'
    )
    view.add_argument(
        "--live-link",
        nargs="?",
        const="",
        metavar="HOST:PORT",
        help="send the pose to Blender or another program (default: 127.0.0.1:9763)",
    )
    view.add_argument(
        "--vmc",
        nargs="?",
        const="",
        metavar="HOST:PORT",
        help="send the pose by the VMC protocol, for Unity, Warudo, VSeeFace (default: 127.0.0.1:39539)",
    )
    view.add_argument("--offscreen", action="store_true", help="no window or display; one step per frame")
    view.add_argument("--frames", type=int, metavar="N", help="end after N frames")
    view.add_argument("--screenshot", type=Path, metavar="PNG", help="image of the last frame")
    view.add_argument("--save-frames", type=Path, metavar="DIR", help="every frame as PNG (offscreen)")


def run(options: argparse.Namespace) -> int:
    """Open the viewer and return its exit code."""
    from viewer.live.link import parse_address
    from viewer.options import ViewOptions

    for flag, link in (("--live-link", options.live_link), ("--vmc", options.vmc)):
        if link is not None:
            parse_address(link, flag=flag)
    width, height = (None, None) if options.size is None else size(options.size)
    names = {field.name for field in fields(ViewOptions)}
    given = {name: value for name, value in vars(options).items() if name in names}
    view_options = ViewOptions(
        **given
        | {
            "frames_directory": options.save_frames,
            "width": width,
            "height": height,
            "panels": not options.no_panels,
            "blend_weights": blend_weights(options),
        }
    )
    view_options.check()
    from viewer.app import run

    return run(view_options)
