"""The table of training frames from retargeted clips: x and y without phases, which stage 0 adds."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime import rotations
from runtime.arrays import Array
from runtime.atomic import write_atomic
from runtime.errors import FileError
from runtime.motion import features
from runtime.motion.features import FPS, InputParts, OutputParts
from runtime.safe_read import open_npz
from runtime.skeleton import PART_JOINTS, SPORT_SKELETON
from training.data.clips import Patches

PAD = 61  # frames of extrapolated root path at each end of a clip
FACING_SIGMA_FRAMES = 12.0  # of the Gaussian that smooths the body's forward direction to the root's facing
MAX_PATCHES = 3
LAYERED = "layered"  # content of clips made by training.augmentation
FIRST_OF_UPPER = 11  # joints from LowerBack on are the upper body
FIXED_POINT_SCALE = 32767.0  # of rotations stored as int16: 16 times finer than float16 near 1
PLAIN = "neutral"  # the neutral style that "a person walking normally" describes


@dataclass
class ClipFrames:
    """All frames of one clip, root-relative; ground heights are separate because terrain patches vary."""

    x: Array  # (T, 342) heights not yet relative to the reference ground; phases are added later
    y: Array  # (T, 473) phases zero
    heights: Array  # (T, K, 36) relative to `ground`
    ground: Array  # (T, K) reference ground of each frame
    previous_ground: Array  # (T, K)
    upper: Array  # (T, 20, 6) fixed point, see `_upper`
    style: str
    content: str
    source: str
    mirrored: bool
    held_out: bool
    patches: int
    name: str


def smooth(values: Array, sigma: float) -> Array:
    """Gaussian smoothing along axis 0 with repeated edges."""
    from scipy.ndimage import gaussian_filter1d

    return gaussian_filter1d(
        np.asarray(values, np.float64), sigma, axis=0, mode="nearest", radius=int(3 * sigma)
    )


def extrapolate(path: Array, pad: int = PAD) -> Array:
    """Extend a path `(T, n)` by `pad` frames at both ends at the mean velocity of the twelve frames there."""
    n = min(12, len(path) - 1)
    steps = np.arange(1, pad + 1)[:, None]
    before = path[0] - steps[::-1] * (path[n] - path[0]) / n
    after = path[-1] + steps * (path[-1] - path[-1 - n]) / n
    return np.concatenate([before, path, after])


def repeat_ends(values: Array) -> Array:
    """Pad values `(T, n)` at both ends by repeating the first and the last."""
    return np.concatenate([np.repeat(values[:1], PAD, 0), values, np.repeat(values[-1:], PAD, 0)])


def root_motion(positions: Array) -> tuple[Array, Array]:
    """Return root path `(T, 2)` and unwrapped yaw `(T,)` of world joints `(T, 31, 3)`."""
    yaw = np.unwrap(features.facing_yaw(positions))
    return positions[:, 0][:, [0, 2]], smooth(yaw[:, None], FACING_SIGMA_FRAMES)[:, 0]


@dataclass(frozen=True)
class RootPath:
    """Root path of a motion: position `(T, 2)` and yaw `(T,)` of every frame, and the same with padded ends."""

    root: Array
    yaw: Array
    padded_root: Array  # (T + 2 PAD, 2)
    padded_yaw: Array

    @staticmethod
    def of(positions: Array) -> RootPath:
        root, yaw = root_motion(positions)
        return RootPath(root, yaw, extrapolate(root), repeat_ends(yaw[:, None])[:, 0])

    @property
    def directions(self) -> Array:
        """Padded facing directions `(T + 2 PAD, 2)`."""
        return np.stack([np.sin(self.padded_yaw), np.cos(self.padded_yaw)], -1)

    @property
    def now(self) -> NDArray[np.intp]:
        """Row of each frame in the padded arrays."""
        return np.arange(len(self.root)) + PAD

    @property
    def window(self) -> NDArray[np.intp]:
        """Rows of the 12 samples around each frame."""
        return self.now[:, None] + features.TRAJECTORY_OFFSETS

    @property
    def velocity(self) -> Array:
        """Root velocity to the next frame `(T, 3)` in root space: m/s in x and z, rad/s."""
        following = self.now + 1
        displacement = features.to_root(self.padded_root[following] - self.root, self.yaw)
        turn = self.padded_yaw[following] - self.yaw
        return np.concatenate([displacement, turn[:, None]], 1) * FPS


def clip_frames(path: Path) -> ClipFrames:
    """Read one clip file of the importer and build its frames."""
    with open_npz(path, "Run the importer again.") as file:
        clip = {key: file[key] for key in file.files}
    hips, local = clip["hips_positions"].astype(np.float64), clip["local_rotations"]
    positions, world = SPORT_SKELETON.forward_kinematics(hips, local.astype(np.float64))
    course = RootPath.of(positions)
    heights, ground = _heights(Patches.of(clip), course)
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
        upper=np.rint(_upper(world, course.yaw) * FIXED_POINT_SCALE).astype(np.int16),
        style=str(clip["style"]),
        content=str(clip["content"]),
        source=str(clip["source"]),
        mirrored=bool(clip["mirrored"]),
        held_out=str(clip["split"]) == "held_out",
        patches=heights.shape[1],
        name=path.stem,
    )


def _heights(patches: Patches, path: RootPath) -> tuple[Array, Array]:
    """Return heights `(T, K, 36)` of every ground patch relative to the window's mean ground `(T, K)`, and the latter."""
    places, ways = path.padded_root[path.window], path.directions[path.window]
    heights, ground = [], []
    for k in range(min(len(patches.heights), MAX_PATCHES)):
        _, sampled = features.sampled_heights(patches.terrain(k), places, ways)
        ground.append(features.ground_height(sampled))
        heights.append((sampled - ground[-1][:, None, None]).reshape(len(path.root), -1))
    return np.stack(heights, 1), np.stack(ground, 1)


def _joints(positions: Array, path: RootPath) -> tuple[Array, Array]:
    """Return joint positions and velocities (m/s), both `(T, 31, 3)` in root space."""
    length = len(positions)
    joints = features.relative_joints(positions, path.root, np.zeros(length), path.yaw)
    velocity = np.gradient(positions, axis=0) if length < 3 else np.diff(positions, axis=0, prepend=0)
    velocity[0] = velocity[1]
    return joints, features.to_root(velocity * FPS, path.yaw[:, None])


def _inputs(path: RootPath, gait: Array, joints: Array, velocity: Array) -> Array:
    """Return x without heights and phase `(T, 342)`; its joints and velocities are the previous frame's."""
    length, window = len(path.root), path.window
    parts = InputParts(
        root_position=path.root,
        root_yaw=path.yaw,
        trajectory_positions=path.padded_root[window],
        trajectory_directions=path.directions[window],
        heights=np.zeros((length, features.L, 3)),
        gait=gait[window],
        phase=np.zeros((length, features.L + 1, features.C, 2)),
        joint_positions=joints,
        joint_velocities=velocity,
    )
    return features.build_input(parts)[:, : features.MOTION_INPUT_SIZE]


def _outputs(path: RootPath, joints: Array, velocity: Array, contacts: Array, world: Array) -> Array:
    """Return y without phase `(T, 473)`; `world` are joint rotations."""
    now = path.now
    following = now[:, None] + 1 + features.FUTURE_OFFSETS
    next_root, next_yaw = path.padded_root[now + 1], path.padded_yaw[now + 1]
    parts = OutputParts(
        trajectory_positions=features.to_root(
            path.padded_root[following] - next_root[:, None], next_yaw[:, None]
        ),
        trajectory_directions=features.to_root(path.directions[following], next_yaw[:, None]),
        joint_positions=joints,
        joint_velocities=velocity,
        root=path.velocity,
        contacts=contacts,
        phase=np.zeros((len(now), 7, features.C, 2)),
        joint_rotations=features.relative_rotations(world, path.yaw),
    )
    return features.build_output(parts)


def _upper(world: Array, yaw: Array) -> Array:
    """Return 6D rotations `(T, 20, 6)` of the upper body: arms and head relative to the chest, torso to the facing."""
    upper = world[:, FIRST_OF_UPPER:]
    against = np.repeat(world[:, None, SPORT_SKELETON.index("Spine1")], upper.shape[1], axis=1)
    against[:, [j - FIRST_OF_UPPER for j in PART_JOINTS["torso"] if j]] = rotations.from_yaw(yaw)[:, None]
    return rotations.to_6d(rotations.multiply(rotations.inverse(against), upper))


@dataclass
class FrameTable:
    """Frames of all clips, concatenated. `clip` `(N,)` is the clip of each frame, `start` `(clips + 1,)` the bounds."""

    x: Array  # (N, 342) float16
    y: Array  # (N, 473) float16
    heights: Array  # (N, K, 36) float16
    ground: Array  # (N, K) float32
    previous_ground: Array  # (N, K) float32
    upper: Array  # (N, 20, 6) int16: upper bodies for training.composition
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


_ARRAYS = {
    "x": (np.float16, (features.MOTION_INPUT_SIZE,)),
    "y": (np.float16, (features.OUTPUT_SIZE,)),
    "heights": (np.float16, (MAX_PATCHES, 3 * features.L)),
    "ground": (np.float32, (MAX_PATCHES,)),
    "previous_ground": (np.float32, (MAX_PATCHES,)),
    "upper": (np.int16, (len(SPORT_SKELETON.names) - FIRST_OF_UPPER, 6)),
}


def load_frames(clips: Path, folder: Path) -> FrameTable:
    """Load the table of all `*.npz` under `clips`; FileError if there are none.

    Its arrays, gigabytes, are written into `folder` once and memory-mapped afterwards, so that resumed runs, or others
    with the same clips, start at once.
    """
    paths = sorted(clips.glob("*.npz"))
    if not paths:
        raise FileError(f"{clips}: no clips (*.npz).", "Run `sport train import --data DIR --out DIR` first.")
    files = _files(paths)
    if _stored_files(folder) != files:
        _write_table(paths, files, folder)
    return _mapped(folder)


def stored_for(folder: Path, clips: Path) -> bool:
    """Return whether `load_frames` of these clips would find its table in `folder`."""
    return _stored_files(folder) == _files(sorted(clips.glob("*.npz")))


def _files(paths: list[Path]) -> list[list[Any]]:
    return [[path.name, path.stat().st_size] for path in paths]


def _stored_files(folder: Path) -> object:
    """Return names and sizes of the clips of a stored table, or None."""
    try:
        return json.loads((folder / "table.json").read_text("utf-8"))["files"]
    except (OSError, ValueError, KeyError):
        return None


def _write_table(paths: list[Path], files: list[list[Any]], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "table.json").unlink(missing_ok=True)
    clips: list[dict[str, Any]] = []
    with ExitStack() as stack:
        outputs = {name: stack.enter_context((folder / f"{name}.bin").open("wb")) for name in _ARRAYS}
        pool = stack.enter_context(ProcessPoolExecutor())
        for part in pool.map(clip_frames, paths, chunksize=16):
            for name, output in outputs.items():
                array = getattr(part, name)
                if name in ("heights", "ground", "previous_ground"):  # fewer patches: the last is repeated
                    array = array[:, np.minimum(np.arange(MAX_PATCHES), array.shape[1] - 1)]
                output.write(np.ascontiguousarray(array, _ARRAYS[name][0]).tobytes())
            clips.append({"frames": len(part.x)} | {name: getattr(part, name) for name in _OF_CLIP})
    write_atomic(folder / "table.json", json.dumps({"files": files, "clips": clips}))


_OF_CLIP = ("style", "source", "content", "name", "mirrored", "held_out", "patches")


def _mapped(folder: Path) -> FrameTable:
    clips = json.loads((folder / "table.json").read_text("utf-8"))["clips"]
    count = np.array([clip["frames"] for clip in clips])
    arrays = {
        # "c": pages are read on demand and never written back
        name: np.memmap(folder / f"{name}.bin", dtype, "c", shape=(int(count.sum()), *shape))
        for name, (dtype, shape) in _ARRAYS.items()
    }
    return FrameTable(
        **arrays,
        clip=np.repeat(np.arange(len(clips), dtype=np.int32), count),
        start=np.concatenate([[0], np.cumsum(count)]),
        styles=[clip["style"] for clip in clips],
        sources=[clip["source"] for clip in clips],
        contents=[clip["content"] for clip in clips],
        names=[clip["name"] for clip in clips],
        mirrored=np.array([clip["mirrored"] for clip in clips]),
        held_out=np.array([clip["held_out"] for clip in clips]),
        patches=np.array([clip["patches"] for clip in clips]),
    )
