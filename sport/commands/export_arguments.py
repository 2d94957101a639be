"""Arguments of an export, for `sport generate` and `sport convert`; nothing heavy is imported for them."""

from __future__ import annotations

import argparse
from pathlib import Path

from runtime.formats.table import FORMATS

MOTION_FPS, FILM_FPS = 60.0, 30.0
OUT_HELP = "file to write; its ending says what: " + ", ".join(FORMATS)


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments that every export has."""
    form = parser.add_argument_group("form of the take")
    form.add_argument(
        "--fps",
        type=float,
        metavar="F",
        help=f"frames a second, 29.97 for example (default: {MOTION_FPS:g} or the take's own, films {FILM_FPS:g})",
    )
    form.add_argument("--unit", metavar="UNIT", help="of BVH: cm or m (default: cm, or the take's own)")
    form.add_argument(
        "--euler-order",
        metavar="ORDER",
        help="of BVH, such as ZXY (default: YXZ for root and hips, ZYX for the others)",
    )
    form.add_argument("--character", type=Path, metavar="GLB", help="skinned character of GLB, FBX and film")
    form.add_argument(
        "--fit-to-motion",
        action="store_true",
        help="the character gets the size of the motion; otherwise it keeps its own, and steps and speed follow it",
    )
    form.add_argument(
        "--joint-map", type=Path, metavar="JSON", help="names of its joints, in place of the file beside it"
    )
    form.add_argument(
        "--for",
        dest="engine",
        metavar="ENGINE",
        help="GLB or FBX as unreal, unity, godot, maya or blender takes it",
    )
    form.add_argument("--humanoid-names", action="store_true", help="bones named as in the engine's humanoid")
    form.add_argument("--animation-only", action="store_true", help="GLB or FBX without meshes")
    form.add_argument(
        "--with-take",
        type=Path,
        action="append",
        default=[],
        metavar="BVH",
        help="a further take in the same GLB or FBX",
    )
    form.add_argument("--range", default="", metavar="A:B", help="only these seconds, e.g. 2:6.5")
    form.add_argument(
        "--loop", action="store_true", help="only the best cycle of a steady walk, without a seam"
    )
    form.add_argument("--strides", type=int, default=1, metavar="N", help="of the loop (default: 1)")
    form.add_argument("--in-place", action="store_true", help="take the way over the ground out")
    form.add_argument("--ground-root", action="store_true", help="a root joint on the ground, above the hips")
    form.add_argument("--at-origin", action="store_true", help="begin at the origin, facing +Z")
    form.add_argument("--rest-frame", action="store_true", help="the rest pose as first frame")
    form.add_argument("--with-ground", action="store_true", help="the ground as a second node (GLB, FBX)")
    form.add_argument(
        "--ground-out", type=Path, metavar="FILE", help="the ground beside the take: .obj or .glb"
    )
    film = parser.add_argument_group("form of a film")
    film.add_argument("--size", metavar="WxH", help="pixels (default: 1280x720)")
    film.add_argument(
        "--camera", default="front", metavar="NAME", help="front (default), follow, side, orbit or still"
    )
    film.add_argument("--distance", type=float, default=0.0, metavar="M", help="of the camera, metres")
    film.add_argument("--no-captions", action="store_true", help="leave the prompts out")
    film.add_argument(
        "--quality", choices=("high", "software"), default="high", help="rendering (default: high)"
    )
