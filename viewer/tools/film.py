"""A film of one or more clips from left to right, each with the prompts of its take, or a label, written under it.

python -m viewer.tools.film walk.bvh --out walk.webp        # or any form of film; ground and prompts from walk.bvh.json
python -m viewer.tools.film raw.bvh ours.bvh --labels captured ours --out both.webp
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from runtime.atomic import check_target
from runtime.errors import UsageError, run_command
from runtime.takes.clip import Clip
from viewer.filming.film import film_frames, studio, write_caption
from viewer.filming.shots import VIEW, FilmOptions, Shot
from viewer.filming.writers import Frame, check_writer, open_writer

DEFAULT_FPS = 20.0
FRONT = Shot(2.7, 0.16, 3.9)  # a little from the side


def cut(clip: Clip, start: float, seconds: float | None) -> Clip:
    """The clip from `start` on, `seconds` long or to its end; UsageError when nothing is left."""
    left = clip.seconds - start if seconds is None else min(seconds, clip.seconds - start)
    if start < 0.0 or left <= 0.0:
        raise UsageError(
            f"--start {start:g}: the clip lasts {clip.seconds:.1f} s.", "Choose an earlier moment."
        )
    return clip.trim(round(start * clip.fps), round((start + left) * clip.fps))


def _frames(path: Path, label: str, options: FilmOptions, args: argparse.Namespace) -> list[Frame]:
    """The frames of one clip with its prompts, or its label, written under them."""
    from runtime.formats.bvh_clip import load_clip_bvh
    from runtime.formats.ground import ground_of
    from runtime.formats.prepare import on_its_ground

    clip = load_clip_bvh(path)
    ground, clip = ground_of(clip, path, args.terrain), cut(on_its_ground(clip), args.start, args.seconds)
    with studio(options.size, ground) as draw:
        frames = list(film_frames(clip, ground, options, draw))
    for frame in frames:
        write_caption(frame, label)
    return frames


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m viewer.tools.film", description=__doc__)
    parser.add_argument("clips", type=Path, nargs="+", metavar="BVH", help="several are drawn side by side")
    parser.add_argument("--labels", nargs="+", help="under each clip, in place of its prompts")
    parser.add_argument("--out", type=Path, required=True, help="a .webp, .gif, .mp4 or .png")
    parser.add_argument("--terrain", help="default: the ground of each clip, from its JSON")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 360), metavar=("W", "H"), help="pixels")
    parser.add_argument(
        "--fps", type=float, default=DEFAULT_FPS, help=f"frames a second (default: {DEFAULT_FPS:g})"
    )
    parser.add_argument("--start", type=float, default=0.0, help="seconds")
    parser.add_argument("--seconds", type=float, help="default: to the end")
    parser.add_argument(
        "--turn", type=float, default=np.degrees(FRONT.turn), help="of the camera from the facing, degrees"
    )
    parser.add_argument("--no-captions", action="store_true", help="leave the prompts out")
    args = parser.parse_args(argv)
    labels = args.labels or [""] * len(args.clips)
    if len(labels) != len(args.clips):
        raise UsageError(
            f"--labels: {len(labels)} for {len(args.clips)} clips.", "Give one for each, or none."
        )
    shot = Shot(float(np.radians(args.turn)), FRONT.pitch, FRONT.distance)
    captions = not (args.labels or args.no_captions)
    width, height = args.size
    options = FilmOptions(width, height, args.fps, VIEW, captions=captions, view=shot)
    options.check()
    check_target(args.out)
    films = [_frames(path, label, options, args) for path, label in zip(args.clips, labels, strict=True)]
    count = max(map(len, films))
    size = options.width * len(films), options.height
    check_writer(args.out, size, count)
    with open_writer(args.out, size, options.fps) as write:
        for k in range(count):  # the shorter ones stand still at their last frame
            write(np.concatenate([film[min(k, len(film) - 1)] for film in films], axis=1))
    print(f"{args.out}: {count} frames")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("film", main))
