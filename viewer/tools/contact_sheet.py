"""Contact sheets: one row of frames per clip, drawn by the viewer's own renderer.

python -m viewer.tools.contact_sheet angry.bvh drunk.bvh --terrain flat --out sheet.png
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.errors import UsageError, run_command
from runtime.motion import features
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain

FRONT_TURN = 2.5  # radians from the character's facing: a three-quarter view from the front
BACK_TURN = 0.75  # from behind, for terrain that would hide the character


def draw_sheet(
    clips: Sequence[Clip],
    terrain: Terrain,
    columns: int = 8,
    interval_seconds: float = 0.15,
    start_seconds: float = 3.0,
    cell: tuple[int, int] = (200, 250),
    turn: float = FRONT_TURN,
) -> NDArray[np.uint8]:
    """Frames `(H, W, 3)`: row r is clip r at `columns` moments from `start_seconds` on."""
    from viewer.filming.studio import studio
    from viewer.render.camera import Camera

    if not clips:
        raise UsageError("contact sheet: no clips.", "Name at least one BVH file.")
    rows = []
    with studio(cell, terrain) as draw:
        for clip in clips:
            row = []
            for k in range(columns):
                pose = clip.sample(min(start_seconds + k * interval_seconds, clip.seconds))
                yaw = float(features.facing_yaw(pose.positions))
                x, _, z = pose.hips_position
                ground = float(terrain.height(x, z))
                pitch = 0.12 if turn == FRONT_TURN else 0.3
                row.append(draw(Camera((x, ground + 0.88, z), yaw + turn, pitch, 3.6), pose))
            rows.append(np.concatenate(row, axis=1))
    return np.concatenate(rows, axis=0)


def label_rows(sheet: NDArray[np.uint8], labels: Sequence[str]) -> NDArray[np.uint8]:
    """Write each row's label into its upper left corner."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(sheet)
    draw = ImageDraw.Draw(image)
    height = sheet.shape[0] // len(labels)
    for r, label in enumerate(labels):
        draw.text((10, r * height + 8), label, fill=(30, 40, 55), font=ImageFont.load_default(18))
    return np.asarray(image)


def main(argv: Sequence[str] | None = None) -> int:
    """Draw a sheet of BVH files."""
    from runtime.formats.bvh_clip import load_clip_bvh
    from runtime.formats.ground import ground_of
    from runtime.formats.prepare import on_its_ground
    from viewer.render.offscreen import save_png

    parser = argparse.ArgumentParser(prog="python -m viewer.tools.contact_sheet", description=__doc__)
    parser.add_argument("clips", nargs="+", type=Path, metavar="BVH")
    parser.add_argument("--terrain", help="default: the ground that stands beside each clip, in its JSON")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--labels", nargs="*", help="default: the file names")
    parser.add_argument("--behind", action="store_true", help="look from behind (for stairs and hills)")
    parser.add_argument("--columns", type=int, default=8)
    parser.add_argument("--interval", type=float, default=0.15, help="seconds between two frames")
    parser.add_argument("--start", type=float, default=3.0, help="seconds")
    args = parser.parse_args(argv)
    clips = [load_clip_bvh(path) for path in args.clips]
    turn = BACK_TURN if args.behind else FRONT_TURN
    rows = [
        draw_sheet(
            [on_its_ground(clip)],
            ground_of(clip, path, args.terrain),
            args.columns,
            args.interval,
            args.start,
            turn=turn,
        )
        for clip, path in zip(clips, args.clips, strict=True)
    ]
    sheet = np.concatenate(rows, axis=0)
    save_png(label_rows(sheet, args.labels or [p.stem for p in args.clips]), args.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("contact sheet", main))
