"""The layout of the networks' input x and output y: the one place that training and runtime use (Sec. III-A).

Symbols of the paper: t^p, t^d trajectory positions and directions; h terrain heights; j^p, j^v joint positions and
velocities; g gait; p phase; d root displacement; c contacts. Everything is relative to the root: the hips projected
to the ground, facing the smoothed forward direction. Every function takes any leading shape `(...)`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runtime import rotations
from runtime.arrays import Array
from runtime.pose import DT as DT
from runtime.pose import FPS as FPS
from runtime.skeleton import SPORT_SKELETON, J
from runtime.terrain.height_map import Terrain
from runtime.terrain.obstacle_detection import EDGE_M, RUN_M

LAYOUT_VERSION = 1
SAMPLE_STEP = 10  # frames between two samples of the ±1 s window
L = 12  # trajectory samples
C = 5  # phase channels
GAITS = 6
TRAJECTORY_OFFSETS = np.arange(-60, 60, SAMPLE_STEP)  # frames; index 6 is the present
PHASE_OFFSETS = np.arange(-60, 61, SAMPLE_STEP)
FUTURE_OFFSETS = TRAJECTORY_OFFSETS[L // 2 :]
FUTURE_PHASE_OFFSETS = PHASE_OFFSETS[L // 2 :]
HEIGHT_SPACING_M = 0.25  # metres between the right, centre and left height samples
BETWEEN = np.arange(1, 6) / 6.0  # positions between two height samples where narrow obstacles are looked for
# weights (12, 7) of the path around each sample, up to the middle between two: the sample before, and the fraction of the next
_AROUND = np.clip(np.arange(L)[:, None] + np.arange(-3, 4) / 6.0, 0.0, L - 1.0)
_FIRST = np.minimum(_AROUND.astype(int), L - 2)
_SHARE = (_AROUND - _FIRST)[..., None]
SEEN_RISE_FRACTION = (
    0.12  # of the rise of edged ground that the network sees: more would make it lose the style
)
MIN_NARROW_RISE_M = 0.05  # minimum height of a narrow obstacle above both neighbours; less is rough ground


def _layout(*fields: tuple[str, int]) -> tuple[dict[str, slice], int]:
    slices, start = {}, 0
    for name, size in fields:
        slices[name] = slice(start, start + size)
        start += size
    return slices, start


INPUT, INPUT_SIZE = _layout(
    ("trajectory_positions", 2 * L),
    ("trajectory_directions", 2 * L),
    ("heights", 3 * L),
    ("joint_positions", 3 * J),
    ("joint_velocities", 3 * J),
    ("gait", GAITS * L),
    ("phase", 2 * C * (L + 1)),
)
OUTPUT, OUTPUT_SIZE = _layout(
    ("trajectory_positions", L),
    ("trajectory_directions", L),
    ("joint_positions", 3 * J),
    ("joint_velocities", 3 * J),
    ("root", 3),
    ("contacts", 4),
    ("phase", 2 * C * (L // 2 + 1)),
    ("joint_rotations", 6 * J),
)
PAPER_OUTPUT_SIZE = OUTPUT["joint_rotations"].start  # 287: the paper's y has no rotations
MOTION_INPUT_SIZE = INPUT["phase"].start  # 342: x without p, what the motion experts see

_HIP_ACROSS = (SPORT_SKELETON.index("LeftUpLeg"), SPORT_SKELETON.index("RightUpLeg"))
_SHOULDER_ACROSS = (SPORT_SKELETON.index("LeftArm"), SPORT_SKELETON.index("RightArm"))


def to_root(vectors: Array, yaw: Array) -> Array:
    """Rotate world XZ `(..., 2)` or XYZ `(..., 3)` vectors into the frame of a root with `yaw` `(...)`."""
    return to_world(vectors, -np.asarray(yaw))


def to_world(vectors: Array, yaw: Array) -> Array:
    """Rotate vectors of a root frame back into world space; inverse of `to_root`."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x, z = vectors[..., 0], vectors[..., -1]
    turned_x = cosine * x + sine * z
    result = np.empty((*turned_x.shape, vectors.shape[-1]), turned_x.dtype)
    result[..., 0], result[..., -1] = turned_x, cosine * z - sine * x
    if vectors.shape[-1] == 3:
        result[..., 1] = vectors[..., 1]
    return result


def facing_yaw(positions: Array) -> Array:
    """Return the yaw `(...)` of the body's forward direction, perpendicular to hips and shoulders, from joints `(..., 31, 3)`."""
    left_hip, right_hip = _HIP_ACROSS
    left_arm, right_arm = _SHOULDER_ACROSS
    across = (
        positions[..., left_hip, :]
        - positions[..., right_hip, :]
        + positions[..., left_arm, :]
        - positions[..., right_arm, :]
    )
    # forward = across x up
    return np.arctan2(-across[..., 2], across[..., 0])


def height_points(positions: Array, directions: Array) -> Array:
    """Return XZ points `(..., n, 3, 2)` right of, at and left of trajectory samples `(..., n, 2)`."""
    left = np.stack([directions[..., 1], -directions[..., 0]], axis=-1)
    side = np.array([-HEIGHT_SPACING_M, 0.0, HEIGHT_SPACING_M], np.float32)[:, None]
    return positions[..., None, :] + side * left[..., None, :]


def sampled_heights(terrain: Terrain, positions: Array, directions: Array) -> tuple[Array, Array]:
    """Return XZ points `(..., 12, 3, 2)` of trajectory samples and their heights `(..., 12, 3)`, right, centre and left.

    Samples are up to half a metre apart: a narrow obstacle between two of them, such as a hurdle, counts for the nearer.
    """
    points = height_points(positions, directions)
    heights = terrain.height(points[..., 0], points[..., 1])
    if terrain.steepest * RUN_M < EDGE_M:  # no obstacle stands out of this ground
        return points, heights
    t = BETWEEN[:, None]
    places = (1.0 - t) * positions[..., :-1, None, :] + t * positions[..., 1:, None, :]
    nearer = np.where(t > 0.5, directions[..., 1:, None, :], directions[..., :-1, None, :])
    between = height_points(places, nearer)  # (..., 11, 5, 3, 2)
    ends = np.maximum(heights[..., :-1, :], heights[..., 1:, :])
    above = terrain.height(between[..., 0], between[..., 1]) - ends[..., None, :]
    above = np.where(above > MIN_NARROW_RISE_M, above, np.float32(0.0))
    behind = int(np.argmax(BETWEEN > 0.5))
    most = np.zeros_like(heights)
    most[..., :-1, :] = above[..., :behind, :].max(-2)
    most[..., 1:, :] = np.maximum(most[..., 1:, :], above[..., behind:, :].max(-2))
    return points, heights + most


def mean_heights(terrain: Terrain, positions: Array) -> Array:
    """Return mean heights `(..., 12)` of the path around trajectory samples `(..., 12, 2)`; narrow obstacles count by width."""
    places = (1.0 - _SHARE) * positions[..., _FIRST, :] + _SHARE * positions[..., _FIRST + 1, :]
    return np.asarray(terrain.height(places[..., 0], places[..., 1]).mean(-1), np.float64)


def softened(heights: Array) -> Array:
    """Return path heights `(..., 12)` with edges flattened towards the ground around the body, as input of the network.

    Steep stairs would make the network lose its style; the foot lock finds the treads.
    """
    middle = L // 2
    here = heights[..., middle - 1 : middle + 2].mean(-1, keepdims=True)
    return np.asarray(here + SEEN_RISE_FRACTION * (heights - here))


def ground_height(heights: Array) -> Array:
    """Return the reference ground height `(...)` of a frame: the mean centre height of the ±1 s window `(..., 12, 3)`.

    Unlike the height under the hips, the mean moves smoothly over steps (as in PFNN).
    """
    return np.asarray(np.add.reduce(heights[..., 1], -1) / heights.shape[-2])


@dataclass
class InputParts:
    """The parts of the network input x, in world space; joints are of the previous frame, the trajectory of this one."""

    root_position: Array  # (..., 2) XZ
    root_yaw: Array  # (...)
    trajectory_positions: Array  # (..., 12, 2)
    trajectory_directions: Array  # (..., 12, 2)
    heights: Array  # (..., 12, 3) right, centre, left
    gait: Array  # (..., 12, 6)
    phase: Array  # (..., 13, 5, 2)
    joint_positions: Array  # (..., 31, 3) relative to the previous root
    joint_velocities: Array  # (..., 31, 3) m/s, relative to the previous root


def build_input(parts: InputParts, ground: Array | None = None) -> Array:
    """Return the network input x `(..., 472)` of one frame, not normalised; `ground` is the `ground_height`, if known."""
    lead = np.shape(parts.root_yaw)
    yaw = np.asarray(parts.root_yaw)[..., None]
    centred = parts.trajectory_positions - parts.root_position[..., None, :]
    ground = ground_height(parts.heights) if ground is None else ground
    heights = parts.heights - ground[..., None, None]
    fields = [
        to_root(np.concatenate([centred, parts.trajectory_directions], axis=-2), yaw),
        heights,
        parts.joint_positions,
        parts.joint_velocities,
        parts.gait,
        parts.phase,
    ]
    return np.concatenate([f.reshape(*lead, -1) for f in fields], axis=-1).astype(np.float32)


@dataclass
class OutputParts:
    """The parts of the network output y; joints, rotations and root displacement are relative to the root of frame i."""

    trajectory_positions: Array  # (..., 6, 2) relative to the root of frame i+1
    trajectory_directions: Array  # (..., 6, 2)
    joint_positions: Array  # (..., 31, 3)
    joint_velocities: Array  # (..., 31, 3) m/s
    root: Array  # (..., 3) forward-frame velocity x, z in m/s and yaw rate in rad/s from frame i to i+1
    contacts: Array  # (..., 4)
    phase: Array  # (..., 7, 5, 2) present and future
    joint_rotations: Array  # (..., 31, 6) world orientation relative to the root, 6D


def build_output(parts: OutputParts) -> Array:
    """Return the network output y `(..., 473)` of one frame, not normalised."""
    lead = parts.root.shape[:-1]
    fields = [getattr(parts, name) for name in OUTPUT]
    return np.concatenate([f.reshape(*lead, -1) for f in fields], axis=-1).astype(np.float32)


def split_output(y: Array) -> OutputParts:
    """Split a network output into its parts; inverse of `build_output`."""
    lead = y.shape[:-1]
    return OutputParts(*(y[..., OUTPUT[name]].reshape(*lead, *shape) for name, shape in _SHAPES.items()))


_SHAPES = {
    "trajectory_positions": (L // 2, 2),
    "trajectory_directions": (L // 2, 2),
    "joint_positions": (J, 3),
    "joint_velocities": (J, 3),
    "root": (3,),
    "contacts": (4,),
    "phase": (L // 2 + 1, C, 2),
    "joint_rotations": (J, 6),
}


def relative_joints(positions: Array, root_xz: Array, ground: Array, yaw: Array) -> Array:
    """Return world joints `(..., 31, 3)` in the root frame: origin on the reference ground, rotated by -yaw."""
    origin = np.stack([root_xz[..., 0], np.asarray(ground), root_xz[..., 1]], axis=-1)
    return to_root(positions - origin[..., None, :], np.asarray(yaw)[..., None])


def relative_rotations(world: Array, yaw: Array) -> Array:
    """Return 6D orientations `(..., 31, 6)` of world rotations `(..., 31, 4)` relative to a root's yaw `(...)`."""
    turn = rotations.from_yaw(-np.asarray(yaw))[..., None, :]
    return rotations.to_6d(rotations.multiply(np.broadcast_to(turn, world.shape), world))
