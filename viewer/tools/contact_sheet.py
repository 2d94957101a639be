"""Contact sheets: one row of frames per clip, drawn by the viewer's own renderer.

python -m viewer.tools.contact_sheet angry.bvh drunk.bvh --terrain flat --out sheet.png
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from runtime.errors import run_command
from runtime.motion import features
from runtime.pose import Pose
from runtime.terrain.height_map import Terrain
from viewer.render.camera import FollowCamera, looked_at

CELL_PIXELS = (200, 250)
# turn from the character's facing and pitch, radians: a three-quarter view, and one for ground that would hide the character
FRONT_VIEW_RAD, BACK_VIEW_RAD = (2.5, 0.12), (0.75, 0.3)
DISTANCE_M = 3.6
SETTLED_S = 10.0  # time for the camera to rise above the ground


def cell_camera(pose: Pose, ground: Terrain, view_rad: tuple[float, float]) -> FollowCamera:
    """Return the camera of a cell: turned from the character's facing, and above the ground."""
    turn, pitch = view_rad
    yaw = float(features.facing_yaw(pose.positions)) + turn
    camera = FollowCamera(looked_at(pose.hips_position, ground), yaw, pitch, DISTANCE_M)
    camera.keep_above(ground, SETTLED_S)
    return camera


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the sheet and return the exit code."""
    from PIL import Image, ImageDraw, ImageFont

    from runtime.formats.bvh_clip import load_clip_bvh
    from runtime.formats.ground import ground_of
    from runtime.formats.prepare import on_its_ground
    from viewer.filming.film import studio
    from viewer.render.offscreen import save_png

    parser = argparse.ArgumentParser(prog="python -m viewer.tools.contact_sheet", description=__doc__)
    parser.add_argument("clips", nargs="+", type=Path, metavar="BVH")
    parser.add_argument("--terrain", help="default: the ground of each clip, from its JSON")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--labels", nargs="*", help="default: the file names")
    parser.add_argument("--behind", action="store_true", help="look from behind (for stairs and hills)")
    parser.add_argument("--columns", type=int, default=8)
    parser.add_argument("--interval", type=float, default=0.15, help="seconds between two frames")
    parser.add_argument("--start", type=float, default=3.0, help="seconds")
    args = parser.parse_args(argv)
    view_rad = BACK_VIEW_RAD if args.behind else FRONT_VIEW_RAD
    seconds = [args.start + k * args.interval for k in range(args.columns)]
    rows = []
    for path in args.clips:
        clip = load_clip_bvh(path)
        ground, clip = ground_of(clip, path, args.terrain), on_its_ground(clip)
        poses = [clip.sample(min(at, clip.seconds)) for at in seconds]
        with studio(CELL_PIXELS, ground) as draw:
            cells = [draw(cell_camera(pose, ground, view_rad), pose) for pose in poses]
        rows.append(np.concatenate(cells, axis=1))
    image = Image.fromarray(np.concatenate(rows))
    drawing, labels = ImageDraw.Draw(image), args.labels or [path.stem for path in args.clips]
    for row, label in enumerate(labels):
        place = 10, row * image.height // len(labels) + 8
        drawing.text(place, label, fill=(30, 40, 55), font=ImageFont.load_default(18))
    save_png(np.asarray(image), args.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("contact sheet", main))
