"""A reel: the same stick in six styles, every moment of it from the side and from the front, next to raw capture.

python -m viewer.tools.reel --out DIR [--data RAW]      # a contact sheet and a BVH for each style, and one of the captures

A row is a moment, drawn by the viewer's own renderer; the camera goes along and does not turn.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.arrays import Array
from runtime.atomic import check_target
from runtime.errors import UsageError, run_command
from runtime.pose import Pose
from runtime.takes.clip import Clip
from runtime.terrain.height_map import Terrain
from viewer.render.camera import Camera, looked_at
from viewer.tools.contact_sheet import draw_row, save_sheet

SCRIPT = (
    "stand 1.5; walk 3; stand 2.5; walk 2; walk@90 2; walk 2; jog 2.5; stand 3; walk 2; jump 2; jog 2; jump 2"
)
PROMPTS = (
    "a person walking normally",
    "a proud queen",
    "a frail old man",
    "walk like a drunk",
    "a happy child",
    "an angry man",
)
COLUMNS, INTERVAL_S = 10, 0.15
CELL = (150, 200)  # pixels
VIEWS = (("side", np.pi / 2), ("front", np.pi))  # camera's yaw over the heading
MOVES = 0.2  # m/s: a captured body has set off
SLOWS = 0.8  # of its speed: it is about to stop


@dataclass(frozen=True)
class Moment:
    """A row: its title, when it begins in SCRIPT, and the captures that show the same and how they begin."""

    title: str
    seconds: float
    captures: str = ""
    begins: str = "start"  # or "stop"


MOMENTS = (
    Moment("start", 1.4, "*_StandToWalk.bvh"),
    Moment("stop", 4.4, "*_WalkToStand.bvh", "stop"),
    Moment("turn", 8.9, "*_WalkTurnLeft90.bvh"),
    Moment("turn back", 10.9),
    Moment("walk to jog", 12.9, "*_WalkToRun.bvh"),
    Moment("stop from a jog", 15.4, "*_RunToStand.bvh", "stop"),
    Moment("jump from a walk", 20.4, "*_C19_Run2Hop2Walk.bvh"),
    Moment("jump from a jog", 24.4),
)


def begins(hips: Array, fps: float, how: str) -> float:
    """When a captured body, hips `(T, 3)` in metres, sets off or begins to stop, seconds."""
    steps = np.linalg.norm(np.diff(hips[:, [0, 2]], axis=0), axis=-1) * fps
    wide = max(1, round(0.2 * fps))
    speed = np.convolve(steps, np.ones(wide) / wide, "same")
    if how == "start":
        return float(np.argmax(speed > MOVES)) / fps
    goes = float(np.median(speed[speed > 0.5 * speed.max()]))
    return float(np.flatnonzero(speed > SLOWS * goes)[-1]) / fps


def heading(hips: Array) -> float:
    """The direction in which a body goes on the whole, radians; 0 is +Z."""
    x, _, z = (hips[-1] - hips[0]).tolist()
    return float(np.arctan2(x, z))


def draw_rows(clip: Clip, terrain: Terrain, seconds: float, yaw: float) -> NDArray[np.uint8]:
    """The frames of a moment from every view, a row each."""
    moments = [seconds + k * INTERVAL_S for k in range(COLUMNS)]

    def row(turn: float) -> NDArray[np.uint8]:
        def see(pose: Pose) -> Camera:
            return Camera(looked_at(pose.hips_position, terrain), yaw + turn, 0.1, 3.4)

        return draw_row(clip, terrain, moments, see, CELL)

    return np.concatenate([row(turn) for _, turn in VIEWS])


def save_rows(path: Path, rows: Sequence[tuple[str, NDArray[np.uint8]]]) -> None:
    labels = [f"{title}, {view}" for title, _ in rows for view, _ in VIEWS]
    save_sheet(path, [drawn for _, drawn in rows], labels)


def of_style(prompt: str, seed: int, out: Path, terrain: Terrain) -> Path:
    """Write the clip and the sheet of a style; the sheet's path."""
    from runtime.formats.bvh_clip import save_bvh
    from runtime.generate import generate_clip

    clip = generate_clip(prompt, terrain, controls=SCRIPT, seed=seed)
    path = save_bvh(clip, out / f"{'_'.join(prompt.split())}.bvh").with_suffix(".png")
    save_rows(path, [(f"{prompt}: {m.title}", draw_rows(clip, terrain, m.seconds, 0.0)) for m in MOMENTS])
    return path


def of_captures(data: Path, out: Path, terrain: Terrain) -> None:
    """Write the sheet of the captures below `data`; UsageError where none of them is there."""
    from runtime.formats.reference import open_take

    rows = []
    for moment in MOMENTS:
        for path in sorted(data.rglob(moment.captures))[:1] if moment.captures else ():
            clip = open_take(path).clip
            first = begins(clip.hips_positions, clip.fps, moment.begins) - 0.1
            first = max(min(first, clip.seconds - COLUMNS * INTERVAL_S), 0.0)
            drawn = draw_rows(clip, terrain, first, heading(clip.hips_positions))
            rows.append((f"{path.stem}: {moment.title}", drawn))
    if not rows:
        raise UsageError(f"--data {data}: none of the captures is there.", "Give the unpacked accad.")
    save_rows(out / "captures.png", rows)


def main(argv: Sequence[str] | None = None) -> int:
    from runtime.terrain.library import load_terrain

    parser = argparse.ArgumentParser(prog="python -m viewer.tools.reel", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of sheets and clips")
    parser.add_argument("--prompts", nargs="*", default=list(PROMPTS), metavar="PROMPT", help="default: six")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of captures (accad, unpacked)")
    args = parser.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    check_target(args.out / "captures.png")
    terrain = load_terrain("flat")
    for prompt in args.prompts:
        print(of_style(prompt, args.seed, args.out, terrain))
    if args.data is not None:
        of_captures(args.data, args.out, terrain)
    return 0


if __name__ == "__main__":
    raise SystemExit(run_command("reel", main))
