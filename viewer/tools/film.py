"""A film of a clip, drawn by the viewer's own renderer, with the prompts of its take written under it.

python -m viewer.tools.film walk.bvh --out walk.webp        # or walk.gif; ground and prompts from walk.bvh.json
python -m viewer.tools.film raw.bvh ours.bvh --labels captured ours --out beside.webp    # from left to right
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.atomic import check_target
from runtime.errors import FileError, UsageError, run_command
from runtime.motion import features
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from viewer.filming.captions import Captions, caption

Image = NDArray[np.uint8]

FORMATS = {".webp": "WEBP", ".gif": "GIF"}
DEFAULT_FPS = 20.0
MAX_FRAMES = 1200
MAX_SIDE = 2048
TURN = 2.7  # radians from where the character looks: from the front, a little from the side


def draw_frames(
    clip: Clip,
    terrain: Terrain,
    size: tuple[int, int],
    fps: float = DEFAULT_FPS,
    start: float = 0.0,
    seconds: float | None = None,
    turn: float = TURN,
) -> Iterator[Image]:
    """Frames `(H, W, 3)` of a clip from `start` on; the camera follows, at `turn` radians from the facing."""
    from viewer.filming.studio import studio
    from viewer.render.camera import FollowCamera

    first = clip.sample(start)
    yaw = float(features.facing_yaw(first.positions)) + turn
    camera = FollowCamera(_middle(first.hips_position, terrain), yaw, pitch=0.16, distance=3.9)
    with studio(size, terrain) as draw:
        for frame in range(count_frames(clip, fps, start, seconds)):
            pose = clip.sample(start + frame / fps)
            yaw = float(features.facing_yaw(pose.positions)) + turn
            camera.update(_middle(pose.hips_position, terrain), 1.0 / fps, terrain=terrain, align_yaw=yaw)
            yield draw(camera, pose)


def count_frames(clip: Clip, fps: float, start: float, seconds: float | None) -> int:
    """How many frames that makes; UsageError when it is none, or more than MAX_FRAMES."""
    left = clip.seconds - start if seconds is None else min(seconds, clip.seconds - start)
    if start < 0.0 or left <= 0.0:
        raise UsageError(
            f"--start {start:g}: the clip lasts {clip.seconds:.1f} s.", "Choose an earlier moment."
        )
    count = max(1, round(left * fps))
    if count > MAX_FRAMES:
        raise UsageError(
            f"{count} frames: expected {MAX_FRAMES} at most.", "Choose fewer --seconds or a lower --fps."
        )
    return count


def _middle(hips: NDArray[np.floating], terrain: Terrain) -> NDArray[np.floating]:
    """What the camera looks at: a point over the ground, so that steps do not shake it."""
    x, _, z = (float(value) for value in hips)
    return np.array([x, float(terrain.height(x, z)) + 0.86, z])


def write_caption(frame: Image, text: str) -> Image:
    """The frame with a line of text over its lower edge."""
    if not text:
        return frame
    written = frame.copy()
    Captions((frame.shape[1], frame.shape[0])).write(written, text)
    return written


def save_film(path: Path, frames: Sequence[Image], fps: float) -> None:
    """Write an endless animated WebP or GIF, by the suffix; FileError when it cannot be written."""
    from PIL import Image as Images

    first, *others = [Images.fromarray(frame) for frame in frames]
    options: dict[str, Any] = (
        {"quality": 70, "method": 4} if path.suffix.lower() == ".webp" else {"optimize": True}
    )
    try:
        first.save(
            path,
            FORMATS[path.suffix.lower()],
            save_all=True,
            append_images=others,
            duration=round(1000.0 / fps),
            loop=0,
            **options,
        )
    except OSError as error:
        raise FileError(f"{path}: the film cannot be written ({error}).", "Choose another folder.") from error


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line, checked; UsageError names what cannot be used."""
    parser = argparse.ArgumentParser(prog="python -m viewer.tools.film", description=__doc__)
    parser.add_argument("clips", type=Path, nargs="+", metavar="BVH", help="several are drawn side by side")
    parser.add_argument("--labels", nargs="+", default=(), help="under each clip, in place of its prompts")
    parser.add_argument("--out", type=Path, required=True, help="a .webp or .gif")
    parser.add_argument("--terrain", help="default: the one that stands beside the clip, in its JSON")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 360), metavar=("W", "H"), help="pixels")
    parser.add_argument(
        "--fps", type=float, default=DEFAULT_FPS, help=f"frames a second (default: {DEFAULT_FPS:g})"
    )
    parser.add_argument("--start", type=float, default=0.0, help="seconds")
    parser.add_argument("--seconds", type=float, help="default: to the end")
    parser.add_argument(
        "--turn", type=float, default=np.degrees(TURN), help="of the camera from the facing, degrees"
    )
    parser.add_argument("--no-captions", action="store_true", help="leave the prompts out")
    args = parser.parse_args(argv)
    if not 1.0 <= args.fps <= 60.0:
        raise UsageError(f"--fps {args.fps:g}: expected 1 to 60.", "Choose another number.")
    if not all(16 <= side <= MAX_SIDE for side in args.size):
        raise UsageError(f"--size {args.size}: expected 16 to {MAX_SIDE} pixels.", "Choose another size.")
    if args.out.suffix.lower() not in FORMATS:
        raise UsageError(f"{args.out}: no film by its name.", f"Let it end in {' or '.join(FORMATS)}.")
    if args.labels and len(args.labels) != len(args.clips):
        raise UsageError(
            f"--labels: {len(args.labels)} for {len(args.clips)} clips.", "Give one for each, or none."
        )
    check_target(args.out)
    return args


def _captioned(path: Path, label: str, args: argparse.Namespace) -> list[Image]:
    """The frames of one clip with its prompts, or its label, written under them."""
    from runtime.formats.bvh_clip import load_clip_bvh
    from runtime.formats.ground import ground_of
    from runtime.formats.prepare import on_its_ground

    clip = load_clip_bvh(path)
    ground, clip = ground_of(clip, path, args.terrain), on_its_ground(clip)
    turn = float(np.radians(args.turn))
    frames = draw_frames(clip, ground, tuple(args.size), args.fps, args.start, args.seconds, turn)
    prompts = () if args.no_captions else clip.prompts
    return [
        write_caption(frame, label or caption(prompts, args.start + k / args.fps))
        for k, frame in enumerate(frames)
    ]


def beside(films: Sequence[list[Image]]) -> list[Image]:
    """Frames of several films from left to right; the shorter ones stand still at their last frame."""
    count = max(len(film) for film in films)
    return [np.concatenate([film[min(k, len(film) - 1)] for film in films], axis=1) for k in range(count)]


def main(argv: Sequence[str] | None = None) -> int:
    """Draw a film of one or more BVH files."""
    args = _options(argv)
    labels = args.labels or [""] * len(args.clips)
    films = [_captioned(path, label, args) for path, label in zip(args.clips, labels, strict=True)]
    frames = beside(films)
    save_film(args.out, frames, args.fps)
    print(f"{args.out}: {len(frames)} frames, {args.out.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("film", main))
