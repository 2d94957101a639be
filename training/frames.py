"""From retargeted clips to the table of training frames: every x and y but their phases, which stage 0 adds."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.controls import Gait
from runtime.errors import FileError
from runtime.motion import features
from runtime.motion.features import FPS, InputParts, OutputParts
from runtime.skeleton import SPORT_SKELETON
from runtime.terrain.height_map import Terrain

Array = NDArray[np.floating]

PAD = 61  # frames of extrapolated root path at each end of a clip
FACING_SIGMA = 12.0  # frames; the root faces the forward direction smoothed by this Gaussian
MAX_PATCHES = 3
LAYERED = "layered"  # content of clips made by training.layering
PLAIN = "neutral"  # of the neutral styles the one that "a person walking normally" describes


@dataclass
class ClipFrames:
    """All frames of one clip, root-relative; ground heights are kept apart because terrain patches vary."""

    x: Array  # (T, 342) without heights' contribution of the reference ground; phases are added later
    y: Array  # (T, 473) phases zero
    heights: Array  # (T, K, 36) relative to `ground`
    ground: Array  # (T, K) reference ground of frame i
    previous_ground: Array  # (T, K)
    style: str
    content: str
    source: str
    mirrored: bool
    held_out: bool
    patches: int
    name: str


def smooth(values: Array, sigma: float) -> Array:
    """Gaussian smoothing along axis 0 with repeated edges."""
    reach = int(3 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    padded = np.concatenate([np.repeat(values[:1], reach, 0), values, np.repeat(values[-1:], reach, 0)])
    flat = padded.reshape(len(padded), -1)
    out = np.stack([np.convolve(flat[:, k], kernel, "valid") for k in range(flat.shape[1])], axis=1)
    return out.reshape(values.shape)


def extrapolate(path: Array, frames: int = 12) -> Array:
    """Pad a path `(T, n)` at both ends with its mean end velocity."""
    n = min(frames, len(path) - 1)
    steps = np.arange(1, PAD + 1)[:, None]
    before = path[0] - steps[::-1] * (path[n] - path[0]) / n
    after = path[-1] + steps * (path[-1] - path[-1 - n]) / n
    return np.concatenate([before, path, after])


def repeat_ends(values: Array) -> Array:
    """Pad values `(T, n)` at both ends with their first and last."""
    return np.concatenate([np.repeat(values[:1], PAD, 0), values, np.repeat(values[-1:], PAD, 0)])


def root_motion(positions: Array) -> tuple[Array, Array]:
    """Root path `(T, 2)` and unwrapped yaw `(T,)` of world joints `(T, 31, 3)`."""
    yaw = np.unwrap(features.facing_yaw(positions))
    return positions[:, 0][:, [0, 2]], smooth(yaw[:, None], FACING_SIGMA)[:, 0]


@dataclass(frozen=True)
class _Course:
    """Where a clip's root goes: every frame's path `(T, 2)`, yaw `(T,)`, and the same with padded ends."""

    root: Array
    yaw: Array
    padded_root: Array  # (T + 2 PAD, 2)
    padded_yaw: Array

    @staticmethod
    def of(positions: Array) -> _Course:
        root, yaw = root_motion(positions)
        return _Course(root, yaw, extrapolate(root), repeat_ends(yaw[:, None])[:, 0])

    @property
    def directions(self) -> Array:
        """Facing, padded, `(T + 2 PAD, 2)`."""
        return np.stack([np.sin(self.padded_yaw), np.cos(self.padded_yaw)], -1)

    @property
    def now(self) -> Array:
        """Each frame's row in the padded arrays."""
        return np.arange(len(self.root)) + PAD

    @property
    def window(self) -> Array:
        """Rows of the 12 samples around each frame."""
        return self.now[:, None] + features.TRAJECTORY_OFFSETS


def clip_frames(path: Path) -> ClipFrames:
    """Read one clip file of the importer and build its frames."""
    try:
        with np.load(path, allow_pickle=False) as file:
            clip = {key: file[key] for key in file.files}
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: not a clip file.", "Run the importer again.") from error
    hips, local = clip["hips_positions"].astype(np.float64), clip["local_rotations"]
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local.astype(np.float64))
    course = _Course.of(positions)
    heights, ground = _heights(clip, course)
    joints, velocity = _joints(positions, course)
    previous = np.maximum(np.arange(len(hips)) - 1, 0)
    gait = repeat_ends(clip["gait"].astype(np.float32))
    x = _inputs(course, gait, joints[previous], velocity[previous])
    y = _outputs(course, joints, velocity, clip["contacts"].astype(np.float32), world)
    return ClipFrames(
        x=x.astype(np.float16),
        y=y.astype(np.float16),
        heights=heights.astype(np.float16),
        ground=ground.astype(np.float32),
        previous_ground=ground[previous].astype(np.float32),
        style=str(clip["style"]),
        content=str(clip["content"]),
        source=str(clip["source"]),
        mirrored=bool(clip["mirrored"]),
        held_out=str(clip["split"]) == "held_out",
        patches=heights.shape[1],
        name=path.stem,
    )


def _heights(clip: dict[str, Array], course: _Course) -> tuple[Array, Array]:
    """Of every patch of ground under a clip: heights `(T, K, 36)` relative to the window's mean ground `(T, K)`."""
    points = features.height_points(course.padded_root[course.window], course.directions[course.window])
    patches = clip["patch_heights"].astype(np.float32)[:MAX_PATCHES]
    origin, cell = clip["patch_origin"], float(clip["patch_cell"])
    heights, ground = [], []
    for patch in patches:
        terrain = Terrain("patch", patch, cell, (float(origin[0]), float(origin[1])))
        sampled = terrain.height(points[..., 0], points[..., 1])
        ground.append(features.ground_height(sampled))
        heights.append((sampled - ground[-1][:, None, None]).reshape(len(course.root), -1))
    return np.stack(heights, 1), np.stack(ground, 1)


def _joints(positions: Array, course: _Course) -> tuple[Array, Array]:
    """Joints and their velocities (m/s), both `(T, 31, 3)` as the root sees them."""
    length = len(positions)
    joints = features.relative_joints(positions, course.root, np.zeros(length), course.yaw)
    velocity = np.gradient(positions, axis=0) if length < 3 else np.diff(positions, axis=0, prepend=0)
    velocity[0] = velocity[1]
    return joints, features.to_root(velocity * FPS, course.yaw[:, None])


def _inputs(course: _Course, gait: Array, joints: Array, velocity: Array) -> Array:
    """x without heights and phase `(T, 342)`; joints and velocities are those of the frame before."""
    length, window = len(course.root), course.window
    parts = InputParts(
        root_position=course.root,
        root_yaw=course.yaw,
        trajectory_positions=course.padded_root[window],
        trajectory_directions=course.directions[window],
        heights=np.zeros((length, features.L, 3)),
        gait=gait[window],
        phase=np.zeros((length, features.L + 1, features.C, 2)),
        joint_positions=joints,
        joint_velocities=velocity,
    )
    return features.build_input(parts)[:, : features.MOTION_INPUT_SIZE]


def _outputs(course: _Course, joints: Array, velocity: Array, contacts: Array, world: Array) -> Array:
    """y without phase `(T, 473)`; `world` are the joints' rotations."""
    now = course.now
    following = now[:, None] + 1 + features.FUTURE_OFFSETS
    next_root, next_yaw = course.padded_root[now + 1], course.padded_yaw[now + 1]
    displacement = features.to_root(next_root - course.root, course.yaw) * FPS
    turn = (next_yaw - course.yaw) * FPS
    parts = OutputParts(
        trajectory_positions=features.to_root(
            course.padded_root[following] - next_root[:, None], next_yaw[:, None]
        ),
        trajectory_directions=features.to_root(course.directions[following], next_yaw[:, None]),
        joint_positions=joints,
        joint_velocities=velocity,
        root=np.concatenate([displacement, turn[:, None]], 1),
        contacts=contacts,
        phase=np.zeros((len(now), 7, features.C, 2)),
        joint_rotations=features.relative_rotations(world, course.yaw),
    )
    return features.build_output(parts)


@dataclass
class FrameTable:
    """All clips one after the other. `clip` `(N,)` is each frame's clip, `start` `(clips + 1,)` their bounds."""

    x: Array  # (N, 342) float16
    y: Array  # (N, 473) float16
    heights: Array  # (N, K, 36) float16
    ground: Array  # (N, K) float32
    previous_ground: Array  # (N, K) float32
    clip: Array  # (N,) int32
    start: Array  # (clips + 1,) int64
    styles: list[str]  # per clip
    sources: list[str]
    contents: list[str]
    names: list[str]
    mirrored: Array  # (clips,) bool
    held_out: Array  # (clips,) bool
    patches: Array  # (clips,) int

    def __len__(self) -> int:
        return len(self.x)

    @property
    def velocities(self) -> Array:
        """j^v `(N, 31, 3)`."""
        return self.y[:, features.OUTPUT["joint_velocities"]].reshape(len(self), -1, 3)


def load_frames(clips: Path, workers: int = 2, limit: int | None = None) -> FrameTable:
    """Build the table from every `*.npz` under `clips`; FileError when there is none."""
    paths = sorted(clips.glob("*.npz"))[:limit]
    if not paths:
        raise FileError(f"{clips}: no clips (*.npz).", "Run `sport train import --data DIR --out DIR` first.")
    if workers > 1:
        with ProcessPoolExecutor(workers) as pool:
            parts = list(pool.map(clip_frames, paths, chunksize=16))
    else:
        parts = [clip_frames(p) for p in paths]
    count = np.array([len(p.x) for p in parts])
    k = max(p.patches for p in parts)
    fields = ("x", "y", "heights", "ground", "previous_ground")

    def stack(name: str) -> Array:
        arrays = [getattr(p, name) for p in parts]
        if name in ("heights", "ground", "previous_ground"):  # clips with fewer patches repeat their first
            arrays = [a[:, np.minimum(np.arange(k), a.shape[1] - 1)] for a in arrays]
        for part in parts:  # free each field as it is joined: the table is gigabytes
            setattr(part, name, None)
        return np.concatenate(arrays)

    return FrameTable(
        **{n: stack(n) for n in fields},
        clip=np.repeat(np.arange(len(parts), dtype=np.int32), count),
        start=np.concatenate([[0], np.cumsum(count)]),
        styles=[p.style for p in parts],
        sources=[p.source for p in parts],
        contents=[p.content for p in parts],
        names=[p.name for p in parts],
        mirrored=np.array([p.mirrored for p in parts]),
        held_out=np.array([p.held_out for p in parts]),
        patches=np.array([p.patches for p in parts]),
    )


FAVOUR = 3.0
TERRAIN_SHARE, LAYERED_SHARE = 0.22, 0.42  # of the frames drawn; the rest is capture


def sampling_weights(
    table: FrameTable,
    terrain_share: float = TERRAIN_SHARE,
    layered_share: float = LAYERED_SHARE,
    favoured: NDArray[np.bool_] | None = None,
) -> Array:
    """Per-frame weight `(N,)`: shares for the terrain rollouts and layered clips, the rest equal over styles by root.

    Frames of `favoured` clips `(clips,)` count FAVOUR times. Held-out frames and each clip's first frame (it has no
    previous pose) weigh nothing.
    """
    weights = np.zeros(len(table))
    styles = np.array(table.styles)[table.clip]
    layered = np.array([c == LAYERED for c in table.contents])[table.clip]
    rollouts = np.array([s == "pfnn_rollouts" for s in table.sources])[table.clip] & ~layered
    usable = ~table.held_out[table.clip]
    usable[table.start[:-1]] = False
    captured = usable & ~rollouts & ~layered
    for style in np.unique(styles):
        chosen = captured & (styles == style)
        if chosen.any():
            weights[chosen] = 1.0 / np.sqrt(chosen.sum())
    groups = [(captured, 1.0 - terrain_share - layered_share), (usable & rollouts, terrain_share)]
    for chosen, share in [*groups, (usable & layered, layered_share)]:
        if chosen.any():
            own = np.where(weights[chosen] > 0, weights[chosen], 1.0)
            if favoured is not None:
                own *= np.where(favoured[table.clip[chosen]], FAVOUR, 1.0)
            weights[chosen] = share * own / own.sum()
    weights *= np.where(_starts_or_stops(table), TRANSITION_BOOST, 1.0)
    return weights / weights.sum()


TRANSITION_BOOST = 4.0  # starting and stopping is a small part of the capture and much of what a player does


def _starts_or_stops(table: FrameTable) -> NDArray[np.bool_]:
    """Frames `(N,)` whose ±1 s window holds both standing and moving."""
    gait = table.x[:, features.INPUT["gait"]].reshape(len(table), features.L, features.GAITS)
    standing = gait[:, :, Gait.STAND]
    return (standing.min(1) < 0.3) & (standing.max(1) > 0.7)
