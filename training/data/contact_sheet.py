"""Contact sheets: frames of imported clips as stick figures, to see errors that numbers hide.

`python -m training.data.contact_sheet --dataset DIR --out SHEETS`
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.errors import run_command
from runtime.safe_read import open_npz
from runtime.skeleton import PART_JOINTS, SPORT_SKELETON
from runtime.terrain.height_map import Terrain
from training.data.clips import Patches

CLIPS, FRAMES = 8, 8
_VIEW_YAW, _VIEW_PITCH = np.deg2rad(35.0), np.deg2rad(12.0)
_COLOURS = {
    "left_arm": "#e8590c", "left_leg": "#d9480f", "right_arm": "#1971c2", "right_leg": "#1864ab",
    "torso": "#495057", "head": "#212529",
}  # fmt: skip


def draw_sheet(paths: list[Path], out: Path) -> None:
    """Draw up to `FRAMES` frames of every clip, one clip per row: left limbs orange, right limbs blue."""
    from matplotlib import pyplot

    figure, grid = pyplot.subplots(
        len(paths), FRAMES, figsize=(2.0 * FRAMES, 2.3 * len(paths)), squeeze=False
    )
    for row, path in zip(grid, paths, strict=True):
        with open_npz(path, "Run the importer again.") as clip:
            _draw_row(row, clip)
        row[0].set_title(path.stem, fontsize=8, loc="left")
    figure.subplots_adjust(0, 0, 1, 0.98, 0, 0.08)
    figure.savefig(out, dpi=70)
    pyplot.close(figure)


def _draw_row(row: Array, clip: np.lib.npyio.NpzFile) -> None:
    hips, local = clip["hips_positions"], clip["local_rotations"]
    terrain = Patches.of(clip).terrain()
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local)
    middle = len(hips) // 3
    step = max(1, min(12, (len(hips) - middle - 1) // FRAMES))
    for axis, t in zip(row, range(middle, middle + FRAMES * step, step), strict=False):
        t = min(t, len(hips) - 1)
        forward = rotations.rotate(world[t, 0].astype(np.float64), np.array([0.0, 0, 1.0]))
        yaw = np.arctan2(forward[0], forward[2])
        centre = np.array([hips[t, 0], float(terrain.height(hips[t, 0], hips[t, 2])), hips[t, 2]])
        _draw_ground(axis, terrain, centre, yaw)
        draw_figure(
            axis, rotations.rotate(rotations.from_yaw(-yaw), positions[t] - centre), clip["contacts"][t]
        )


def _draw_ground(axis: Any, terrain: Terrain, centre: Array, yaw: float) -> None:
    """Draw grid lines of the ground around the figure, in the figure's frame."""
    along = np.linspace(-0.6, 0.6, 25)
    for offset in np.linspace(-0.6, 0.6, 9):
        for x, z in ((along, np.full_like(along, offset)), (np.full_like(along, offset), along)):
            local = np.stack([x, np.zeros_like(x), z], -1)
            p = rotations.rotate(rotations.from_yaw(yaw), local) + centre
            local[:, 1] = terrain.height(p[:, 0], p[:, 2]) - centre[1]
            axis.plot(*_project(local), color="#adb5bd", lw=0.5)


def _project(p: Array) -> tuple[Array, Array]:
    q = rotations.multiply(
        rotations.from_axis_angle(np.array([1.0, 0, 0]), _VIEW_PITCH), rotations.from_yaw(-_VIEW_YAW)
    )
    v = rotations.rotate(q, p)
    return v[..., 0], v[..., 1]


def draw_figure(axis: Any, p: Array, contacts: Array) -> None:
    """Draw the bones of a pose `(31, 3)` in the figure's frame, from the front left; contacts are green."""
    for part, joints in PART_JOINTS.items():
        for j in joints:
            parent = SPORT_SKELETON.parents[j]
            if parent >= 0:
                x, y = _project(p[[parent, j]])
                axis.plot(x, y, color=_COLOURS[part], lw=4, solid_capstyle="round")
    for contact, j in zip(contacts, (4, 5, 9, 10), strict=True):
        if contact:
            axis.plot(*_project(p[j]), "o", color="#2b8a3e", ms=4)
    axis.set(xlim=(-0.75, 0.75), ylim=(-0.35, 1.75), aspect="equal")
    axis.axis("off")


def main() -> None:
    """Run the command line: one sheet per source."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dataset", type=Path, required=True, help="folder that the importer wrote")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    import matplotlib

    matplotlib.use("Agg")
    options.out.mkdir(parents=True, exist_ok=True)
    groups: dict[str, list[Path]] = {}
    for path in sorted((options.dataset / "clips").glob("*.npz")):
        kind = "_terrain" if path.stem.endswith("_t") else ""
        if not path.stem.endswith("_m"):
            groups.setdefault(path.stem.split("_")[0] + kind, []).append(path)
    for name, paths in groups.items():
        chosen = [paths[i] for i in np.unique(np.linspace(0, len(paths) - 1, CLIPS).astype(int))]
        draw_sheet(chosen, options.out / f"{name}.png")


if __name__ == "__main__":
    raise SystemExit(run_command("contact sheet", main))
