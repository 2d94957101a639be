"""Obstacles that a model's network crosses without keyframes: `python -m training.export.traversals --model FOLDER`.

Characters of several styles walk and jog over bars, gaps and steps. A size counts as crossed if most traversals pass
every check; larger or other obstacles are crossed by keyframes. The sizes are written into the model's metadata.
"""

import argparse
import logging
from collections.abc import Sequence
from copy import copy
from pathlib import Path

import numpy as np

from runtime.arrays import Array
from runtime.controls import Controls, Gait
from runtime.errors import run_command
from runtime.motion.control_scripts import PlanarPose
from runtime.motion.controller import SETTLE_SECONDS
from runtime.motion.features import FPS
from runtime.motion.model import MotionModel
from runtime.motion.model_files import read_metadata, write_metadata
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.courses import CELL_M
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import ObstacleKind
from training.evaluation.metrics.traversal import first_problem
from training.evaluation.motion.driving import characters, walk_together
from training.evaluation.motion.evaluated_model import EvaluatedModel, style_texts
from training.evaluation.on_obstacles import GAITS, STYLES

log = logging.getLogger("sport.train")

SIZES = {  # metres
    ObstacleKind.UP: (0.3, 0.4, 0.5),
    ObstacleKind.DOWN: (0.3, 0.4, 0.5),
    ObstacleKind.GAP: (0.4, 0.6, 0.8, 1.0),
    ObstacleKind.BAR: (0.2, 0.25, 0.3, 0.4, 0.5, 0.6),
}
PASSED_FRACTION = 0.7  # of the traversals of a size that must pass
PLACE_M = 4.0  # of the obstacle's near edge
BEHIND_M, BEFORE_M = 2.0, 1.2  # walked behind the obstacle; checked before it
BAR_M, FLOOR_M = 0.1, 0.6  # thickness of a bar; depth of a gap
MAX_WALK_S = 12.0
LEVEL_FROM_M = 1.0  # from here to the obstacle the style's normal posture is measured
MAX_TILT_RAD, SMOOTH_FRAMES = 0.35, FPS // 4  # extra tilt of the trunk over an obstacle
NECK = SPORT_SKELETON.index("Neck")


def measure_traversals(folder: Path) -> dict[str, float]:
    """Measure a model folder, and write the largest crossed size of each kind into its metadata."""
    evaluated = EvaluatedModel(folder, style_texts(STYLES))
    model = copy(evaluated.model)
    model.crosses = lambda obstacle: True  # type: ignore[method-assign]
    codes = [evaluated.style(style, 0) for style in STYLES]
    crossed: dict[str, float] = {}
    for kind, sizes in SIZES.items():
        for size in sizes:
            ground = obstacle_ground(kind, size)
            ways = [way for gait in GAITS for way in ways_over(model, ground, codes, gait)]
            fraction = float(np.mean([not problem for problem in ways]))
            log.info("%s of %.2f m: %.0f %% of %d traversals", kind.value, size, 100.0 * fraction, len(ways))
            if fraction < PASSED_FRACTION:
                break
            crossed[kind.value] = size
    write_metadata(folder, read_metadata(folder) | {"crosses": crossed})
    return crossed


def obstacle_ground(kind: ObstacleKind, size: float) -> Terrain:
    """Return ground with one obstacle across the path, its near edge at `PLACE_M`."""
    z = np.arange(round((PLACE_M + BEHIND_M + 7.0) / CELL_M)) * CELL_M - 3.0
    behind = z > PLACE_M - 1e-6
    row: Array = {
        ObstacleKind.UP: np.where(behind, size, 0.0),
        ObstacleKind.DOWN: np.where(behind, 0.0, size),
        ObstacleKind.GAP: np.where(behind & (z < PLACE_M + size - 1e-6), 0.0, FLOOR_M),
        ObstacleKind.BAR: np.where(behind & (z < PLACE_M + BAR_M + 1e-6), size, 0.0),
    }[kind]
    return Terrain(kind.value, np.repeat(row[None], 81, axis=0).astype(np.float32), CELL_M, (-2.0, -3.0))


def ways_over(model: MotionModel, ground: Terrain, codes: Sequence[Array], gait: Gait) -> list[str]:
    """Walk over the obstacle at full stick from rest, once per code; returns the first failed check of each, or ""."""

    def stick(seconds: float, _: PlanarPose) -> Controls:
        return Controls((0.0, float(seconds >= SETTLE_SECONDS)), gait=gait)

    members = characters(model, ground, codes)
    walks = walk_together(members, stick, round((SETTLE_SECONDS + MAX_WALK_S) * FPS))
    return [_problem(np.stack([pose.positions for pose in poses]), ground) for poses in walks]


def _problem(positions: Array, ground: Terrain) -> str:
    z = positions[:, 0, 2]
    if z.max() <= PLACE_M + BEHIND_M:
        return "stuck"
    end = int(np.argmax(z > PLACE_M + BEHIND_M))
    positions, z = positions[:end], z[:end]
    over = z > PLACE_M - BEFORE_M
    problem = first_problem(positions[over], ground)
    return problem or ("posture" if folds(positions[over], positions[~over & (z > LEVEL_FROM_M)]) else "")


def folds(positions: Array, level: Array) -> bool:
    """Return whether the trunk tilts much farther over an obstacle than on level ground; positions `(T, 31, 3)`."""
    tilts = [_tilt(each) for each in (positions, level)]
    return bool(tilts[0].max() > tilts[1].max() + MAX_TILT_RAD)


def _tilt(positions: Array) -> Array:
    """Return the tilt of the trunk from the vertical `(T,)`, radians, smoothed over a quarter of a second."""
    trunk = positions[:, NECK].astype(np.float64) - positions[:, 0]
    angle = np.arctan2(np.hypot(trunk[:, 0], trunk[:, 2]), trunk[:, 1])
    return np.convolve(angle, np.full(SMOOTH_FRAMES, 1.0 / SMOOTH_FRAMES), mode="valid")


def main(argv: Sequence[str] | None = None) -> None:
    """Command line."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--model", type=Path, required=True, help="folder of an exported model")
    args = parser.parse_args(argv)
    for kind, size in measure_traversals(args.model).items():
        print(f"{kind}: {size} m")


if __name__ == "__main__":
    raise SystemExit(run_command("traversals", main))
