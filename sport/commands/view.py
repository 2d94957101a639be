"""`sport view`: the viewer in a window, or its frames without one."""

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

from runtime.assets import character_file
from sport.commands.arguments import Subparsers, add_blend, add_model, blend_weights, declare, size


def add(commands: Subparsers) -> None:
    """Declare the arguments."""
    view = commands.add_parser("view", help="open the viewer (what plain `sport` does)")
    view.set_defaults(command=run)
    declare(view, _BEFORE_BLEND)
    add_blend(view)
    add_model(view)
    declare(view, _ARGUMENTS)


_BEFORE_BLEND: dict[str, dict[str, Any]] = {
    "--terrain": dict(metavar="NAME|FILE", help="a ready terrain, PNG, NPY or mesh file"),
    "--prompt": dict(metavar="TEXT", help="style to begin with"),
}
_ARGUMENTS: dict[str, dict[str, Any]] = {
    "--character": dict(type=character_file, metavar="NAME|FILE", help="walker, or a skinned GLB, glTF or VRM"),
    "--joint-map": dict(type=Path, metavar="JSON", help="joint map to use instead of the file next to it"),
    "--fit-to-motion": dict(action="store_true", help="scale the character to the motion instead of keeping its own size"),
    "--clip": dict(type=Path, metavar="FILE", help="motion to open: BVH, GLB, VRM, FBX"),
    "--session": dict(metavar="FILE", help='session to open, or "last"'),
    "--size": dict(metavar="WxH", help="window in pixels, e.g. 1280x720"),
    "--ui-scale": dict(type=float, metavar="S", help="size of the interface, 1 is 96 dpi"),
    "--no-panels": dict(action="store_true", help="begin without panels"),
    "--quality": dict(choices=("fast", "software", "high"), help="rendering preset (default: chosen for this machine)"),
    "--camera": dict(choices=("follow", "orbit")),
    "--response": dict(
        type=float, metavar="R",
        help="how quickly starts, stops and turns follow the stick: 0 as in capture to 1 as in a game",
    ),
    "--seed": dict(type=int, default=0, metavar="N"),
    "--controls": dict(metavar="SCRIPT", help='the stick as text: "stand 2; walk 3; walk@90 3; jog@0*0.5 2; jump 1"'),
    "--keys": dict(default="", metavar="SCRIPT", help='keys to press, e.g. "w 2; w+shift 1.5; f1 0.2"'),
    "--live-link": dict(
        nargs="?", const="", metavar="HOST:PORT",
        help="send the pose to Blender or another program (default: 127.0.0.1:9763)",
    ),
    "--vmc": dict(
        nargs="?", const="", metavar="HOST:PORT",
        help="send the pose by the VMC protocol, for Unity, Warudo, VSeeFace (default: 127.0.0.1:39539)",
    ),
    "--offscreen": dict(action="store_true", help="no window or display; one step per frame"),
    "--frames": dict(type=int, metavar="N", help="end after N frames"),
    "--screenshot": dict(type=Path, metavar="PNG", help="image of the last frame"),
    "--save-frames": dict(type=Path, metavar="DIR", help="every frame as PNG (offscreen)"),
}  # fmt: skip


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
    given |= dict(frames_directory=options.save_frames, width=width, height=height)
    given |= dict(panels=not options.no_panels, blend_weights=blend_weights(options))
    view_options = ViewOptions(**given)
    view_options.check()
    from viewer.app import run

    return run(view_options)
